"""The command `track_head`: heads followed in a video, a folder of pictures or a bag, in the image alone."""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.config import parameter, parse, section
from people_fusion.core.errors import ConfigError, DataError, RecordingError
from people_fusion.core.head_scores import FEATURES, HeadScores
from people_fusion.core.images import Image
from people_fusion.cues.heads.detector import Search
from people_fusion.cues.heads.detectors.fhog_head import FhogHead, FhogHeadConfig
from people_fusion.cues.heads.short_term import ShortTermConfig, ShortTermTracker
from people_fusion.replay.frames import Frames, Writer
from people_fusion.replay.replay_bag import overrides
from people_fusion.replay.results import guarded, write_json
from people_fusion.tracking.image_heads import ImageHead, ImageHeads, ImageHeadsConfig

COLOURS = ((80, 220, 60), (60, 160, 250), (240, 180, 60), (220, 90, 220), (80, 230, 240), (200, 200, 80))  # BGR
Follow = Callable[[np.ndarray], List[ImageHead]]


@dataclass(frozen=True)
class TrackHeadConfig:
    """How heads are found and followed."""

    least: float = parameter(0.0, "height of heads, pixels; 0: the least that the detector finds", low=0.0)
    largest: float = parameter(400.0, "height of heads, pixels", low=1.0)
    detector: FhogHeadConfig = section(lambda: FhogHeadConfig(threshold=1.0), "that starts tracks: few of them false")
    particle: ImageHeadsConfig = section(ImageHeadsConfig, "--tracker particle")
    hst: ShortTermConfig = section(ShortTermConfig, "--tracker hst")


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/track_head; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("track_head", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Follow, print and write what was asked for.

    Raises:
        PeopleFusionError: a file, topic, box or parameter is not usable.
    """
    config = parse(TrackHeadConfig, overrides(options.set))
    box = None if options.box is None else _box(options.box)
    if options.seed < 0:
        raise ConfigError(f"--seed: {options.seed} is negative")
    frames = Frames(options.recording, options.image)
    rng = np.random.default_rng(options.seed)
    follow = followed_by_particles(config, box, rng) if options.tracker == "particle" else short_term(config, box, rng)
    columns = (TextColumn("track_head"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    rows: List[Dict[str, Any]] = []
    seconds, count = 0.0, 0
    with Progress(*columns, console=notes, transient=True, disable=not notes.is_terminal) as bar:
        task = bar.add_task("", total=frames.count)
        with _writer(options.out, frames.fps) as writer:
            for pixels in frames:
                start = time.perf_counter()
                heads = _at(count, follow, pixels)
                seconds += time.perf_counter() - start
                rows.extend(_row(count, head) for head in heads)
                if writer is not None:
                    writer.write(annotated(pixels, heads))
                count += 1
                bar.update(task, completed=count)
    print(f"{count} pictures, {count / max(seconds, 1e-9):.0f} a second")
    for track in sorted({row["track"] for row in rows}):
        there = [row["frame"] for row in rows if row["track"] == track]
        print(f"head {track}: pictures {there[0]} to {there[-1]}, {len(there)} of them")
    if not rows:
        print("no head was found")
    if options.json is not None:
        write_json(options.json, {"tracker": options.tracker, "frames": count, "heads": rows})


def followed_by_particles(config: TrackHeadConfig, box: Optional[np.ndarray], rng: np.random.Generator) -> Follow:
    """Function of pictures in their order: the heads of each by ImageHeads; only that in `box` of the first if given.

    Raises:
        ConfigError: the detector's model cannot be loaded.
    """
    search, tracker = scored(config), ImageHeads(config.particle, rng)
    waiting = [box] if box is not None else []

    def follow(pixels: np.ndarray) -> List[ImageHead]:
        scores = search(pixels)
        tracker.update(scores, starts=box is None)
        while waiting:
            tracker.add(scores, _inside(waiting.pop(), pixels))
        return tracker.heads

    return follow


def short_term(config: TrackHeadConfig, box: Optional[np.ndarray], rng: np.random.Generator) -> Follow:
    """Function of pictures in their order: the target of each by HST; without a box the best head of the first that
    holds one.

    Raises:
        ConfigError: the detector's model cannot be loaded.
    """
    search = scored(config) if box is None else None
    trackers: List[ShortTermTracker] = []

    def follow(pixels: np.ndarray) -> List[ImageHead]:
        grey = _image(pixels).grey
        if trackers:
            trackers[0].update(grey)
        else:
            start = box
            if search is not None:
                found = search(pixels)
                if not len(found.corners):
                    return []
                start = found.corners[int(np.argmax(found.box_scores))]
            trackers.append(ShortTermTracker(config.hst, grey, np.asarray(start), rng))
        return [ImageHead(1, trackers[0].box, trackers[0].score, False)]

    return follow


def scored(config: TrackHeadConfig) -> Callable[[np.ndarray], HeadScores]:
    """Function of a picture: what the detector says of all of it, with features.

    Raises:
        ConfigError: the detector's model cannot be loaded.
    """
    detector = FhogHead(config.detector)
    detector.wanted_scores = FEATURES
    least = config.least or detector.model.window.head_height / config.detector.enlarge

    def search(pixels: np.ndarray) -> HeadScores:
        image = _image(pixels)
        scores = detector.scores(image, detector.detect(image, Search.everywhere(image, least, config.largest)))
        assert scores is not None  # they were wanted
        return scores

    return search


def annotated(pixels: np.ndarray, heads: List[ImageHead]) -> np.ndarray:
    """(H, W, 3) copy of a picture with the heads' boxes, numbers and scores; a line is thin where none is detected."""
    import cv2  # 100 MB: not for those who see no images

    canvas = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR) if pixels.ndim == 2 else pixels.copy()
    for head in heads:
        colour = COLOURS[(head.track - 1) % len(COLOURS)]
        limit = 4 * np.array([canvas.shape[1], canvas.shape[0]] * 2)
        left, top, right, bottom = (int(edge) for edge in np.clip(np.round(head.box), -limit, limit))
        cv2.rectangle(canvas, (left, top), (right - 1, bottom - 1), colour, 3 if head.detected else 1)
        said = f"{head.track}: {head.score:.2f}"
        for shade, width in (((0, 0, 0), 3), (colour, 1)):  # on any ground
            cv2.putText(canvas, said, (left, top - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.45, shade, width, cv2.LINE_AA)
    return canvas


class _Nothing:
    def __enter__(self) -> None:
        return None

    def __exit__(self, *_: object) -> None:
        return None


def _writer(out: Optional[Path], fps: float) -> Any:
    return _Nothing() if out is None else Writer(out, fps)


def _at(count: int, follow: Follow, pixels: np.ndarray) -> List[ImageHead]:
    try:
        return follow(pixels)
    except DataError as error:
        raise RecordingError(f"picture {count}: {error}") from error


def _image(pixels: np.ndarray) -> Image:
    height, width = pixels.shape[:2]
    return Image(0, "", pixels, Pinhole(width, height, np.eye(3)))  # nothing is taken from the camera but its size


def _inside(box: np.ndarray, pixels: np.ndarray) -> np.ndarray:
    rows, cols = pixels.shape[:2]
    if box[2] <= 0.0 or box[3] <= 0.0 or box[0] >= cols or box[1] >= rows:
        raise DataError("target outside of the image", f"{box.tolist()} in {cols} x {rows}")
    return box


def _box(text: str) -> np.ndarray:
    try:
        left, top, width, height = (float(number) for number in text.split(","))
    except ValueError as error:
        raise ConfigError(f"--box {text}: expected x,y,w,h in pixels") from error
    if not (all(math.isfinite(each) for each in (left, top, width, height)) and min(width, height) >= 1.0):
        raise ConfigError(f"--box {text}: no box of at least one pixel")
    return np.array([left, top, left + width, top + height])


def _row(frame: int, head: ImageHead) -> Dict[str, Any]:
    left, top, right, bottom = (round(float(edge), 3) for edge in head.box)
    box = [left, top, round(right - left, 3), round(bottom - top, 3)]
    score = round(head.score, 4) if math.isfinite(head.score) else None
    return {"frame": frame, "track": head.track, "box": box, "score": score, "detected": head.detected}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="track_head", description=__doc__)
    add = parser.add_argument
    add("recording", type=Path, help="video, folder of pictures (in order of their names), or ROS 1 bag")
    add("--tracker", choices=("particle", "hst"), default="particle", help="all heads, or a single target (HST)")
    add("--box", metavar="X,Y,W,H", help="follow what is there in the first picture (default: what is detected)")
    add("--image", metavar="TOPIC", help="of a bag with several cameras")
    add("--set", metavar="KEY=VALUE", action="append", default=[], help="e.g. detector/enlarge=2, particle/adaptive=no")
    add("--seed", type=int, default=0, help="of particles and negatives")
    add("--out", type=Path, metavar="PATH", help="annotated: a video (.avi, .mp4, .mkv), otherwise a folder of PNG")
    add("--json", type=Path, metavar="FILE", help="write boxes: x, y, w, h by picture")
    return parser
