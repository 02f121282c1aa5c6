"""The command `evaluate_tracks`: score tracks that were recorded from the live graph against annotated people."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import List, Optional, Sequence, Tuple

import numpy as np
from rich.console import Console

from people_fusion.core.errors import DataError, RecordingError, TransformUnavailable
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import TransformTree
from people_fusion.evaluation.clear_mot import THRESHOLD_M
from people_fusion.evaluation.report import run_report
from people_fusion.replay.conversions import occupancy_grid
from people_fusion.replay.discovery import find_ground_truth
from people_fusion.replay.ground_truth import Instant, read_ground_truth
from people_fusion.replay.image_plane import EVERYTHING_S, all_transforms, read_view, score_in_image
from people_fusion.replay.recording import Recording
from people_fusion.replay.replay import Selection, score
from people_fusion.replay.results import (
    figures,
    guarded,
    image_figures,
    positive,
    print_scores,
    save_report,
    write_json,
)
from people_fusion.replay.track_bag import PREDICTION_LIMIT_NS, TRACKS_TOPIC, predicted, read_tracks
from people_fusion.tracking.fusion import load_config


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/evaluate_tracks; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("evaluate_tracks", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Evaluate, print and write what was asked for.

    Raises:
        PeopleFusionError: a bag or topic is not usable.
    """
    selection = Selection(
        only_annotated=options.only_annotated, threshold_m=positive("--threshold", options.threshold)
    )
    with Recording(options.bag) as recording:
        tracks = read_tracks(recording, recording.topic(options.tracks))
    if not tracks:
        raise RecordingError(f"{options.bag}: no messages on {options.tracks}")
    frame_id = tracks[0].frame_id
    instants, transforms = read_truth(options.truth or options.bag, options.ground_truth, frame_id)
    samples = sample(tracks, instants, transforms)
    notes.print(f"{len(samples)} of {len(instants)} annotated instants lie within the tracks", highlight=False)
    truth, estimates, evaluation = score(samples, selection) if samples else (None, None, None)
    in_image = None
    if options.image is not None:
        view = read_view(options.truth or options.bag, options.image, load_config(options.config).panoramas)
        in_image, missing = score_in_image(samples, view, options.only_annotated)
        if missing:
            notes.print(f"{missing} annotated instants without the camera's place", highlight=False)
    print_scores(options.bag.stem, evaluation, options.image, in_image)
    if options.json is not None:
        write_json(options.json, {**figures(evaluation), **image_figures(options.image, in_image)})
    if options.report is not None:
        if truth is None or estimates is None or evaluation is None:
            raise RecordingError(f"{options.report}: nothing is annotated, so there is nothing to report")
        source = options.truth or options.bag
        said = [f"tracks of {options.bag.name}, people of {source.name}"]
        html = run_report(options.bag.stem, truth, estimates, evaluation, read_map(source, frame_id), notes=said)
        save_report(options.report, html)


def read_map(path: Path, frame_id: str) -> Optional[OccupancyGrid]:
    """The recording's newest map in this frame, or None."""
    grid = None
    with Recording(path) as recording:
        for recorded in recording.messages(recording.of_kind("OccupancyGrid")):
            try:
                found = occupancy_grid(recorded.read())
            except DataError:
                continue
            grid = found if found.frame_id == frame_id else grid
    return grid


def read_truth(path: Path, topic: Optional[str], frame_id: str) -> Tuple[List[Instant], TransformTree]:
    """Annotated people of a recording, and its transforms where the people are in another frame than `frame_id`.

    Raises:
        RecordingError: the recording is damaged or has no ground truth.
    """
    with Recording(path) as recording:
        found = find_ground_truth(recording, topic)
        if found is None:
            raise RecordingError(f"{path}: no ground truth in this recording")
        instants = read_ground_truth(recording, found, recording.of_kind("LaserScan"))
        transforms = TransformTree(EVERYTHING_S)
        if any(instant.frame_id != frame_id for instant in instants):
            transforms = all_transforms(recording)
    return instants, transforms


def sample(
    tracks: Sequence[Tracks], instants: Sequence[Instant], transforms: TransformTree
) -> List[Tuple[Instant, Tracks]]:
    """At each annotated instant within the tracks the newest tracks that are not newer, predicted to it.

    Where they are older than `PREDICTION_LIMIT_NS`, nobody was reported.
    """
    stamps_ns = np.array([entry.stamp_ns for entry in tracks], dtype=np.int64)
    order = np.argsort(stamps_ns, kind="stable")
    samples = []
    for instant in instants:
        place = int(np.searchsorted(stamps_ns[order], instant.stamp_ns, side="right"))
        if place == 0 or instant.stamp_ns > stamps_ns[order[-1]]:
            continue
        newest = tracks[order[place - 1]]
        shown = predicted(newest, instant.stamp_ns)
        if instant.stamp_ns - newest.stamp_ns > PREDICTION_LIMIT_NS:
            shown = shown.select(np.zeros(len(shown), dtype=bool))
        try:
            samples.append((instant.into(newest.frame_id, transforms), shown))
        except TransformUnavailable:
            continue
    return samples


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="evaluate_tracks", description=__doc__)
    add = parser.add_argument
    add("bag", type=Path, help="ROS 1 bag with tracks")
    add("--truth", type=Path, metavar="BAG", help="recording with annotated people (default: the same bag)")
    add("--tracks", default=TRACKS_TOPIC, metavar="TOPIC", help="topic of the tracks (default %(default)s)")
    add("--ground-truth", metavar="TOPIC", help="topic of the annotated people (default: found by name and type)")
    add(
        "--image",
        metavar="TOPIC",
        help="score people as boxes in this camera's images too (Volkhardt et al. 2013): overlap of 0.25 and more",
    )
    add("--config", metavar="FILE", help="preset that describes panoramas, with --image (default: default)")
    add("--json", type=Path, metavar="FILE", help="write the table")
    add("--report", type=Path, metavar="DIR", help="write an HTML report with plots")
    add("--only-annotated", action="store_true", help="not everybody is annotated: count no false positives")
    add("--threshold", type=float, default=THRESHOLD_M, metavar="M", help="largest distance of a match, default 0.5")
    return parser
