#!/usr/bin/env python3
"""How well targets and heads are followed in images of real people, in the form of Poschmann 2018, 5.3 and 6.3.

Short-term trackers start at an annotated box and follow it: people of PETS 2009 S2.L1 (frames 1 to 200, 768x576, 55 to
100 pixels high) and one head that turns around (rgbd_person, 640x480, 145 pixels). Where the overlap is 0 the target is
lost; the tracker starts anew five frames later, and the ten frames after a start do not count towards the overlap, as
in VOT. `until lost`: frames from the first start to the first loss, or to the end where there is none. OpenCV's tracker
MIL (Babenko et al. 2009) is the peer where this OpenCV has it.

Head trackers start by detection. A head is found where a box overlaps its true one by `--overlap` or more, and nothing
else may be reported. True heads: in rgbd_person 24 cm below the top of the person's mask, at the depth there; in PETS
the upper 0.24 / 1.75 of the person's box, so heads of 8 to 14 pixels, found in enlarged images. Stochastic trackers run
with several seeds; means.

Times are of the process, a frame and a target, on one core.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import time
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from people_fusion.core.config import parse
from people_fusion.cues.heads.appearance import AppearanceConfig
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.short_term import ShortTermConfig, ShortTermTracker
from people_fusion.replay.track_head import TrackHeadConfig, scored
from people_fusion.tracking.image_heads import ImageHeads

RATES = (0.0, 0.02, 0.1, 0.5, 1.0)
SKIPPED, SETTLING = 5, 10  # frames after a loss, and after a start (5.3.1)
HEAD, PERSON = 0.24, 1.75  # metres
FOCAL = 525.0  # of rgbd_person
LOST = {False: (0.0, -0.5, -1.0, -2.0), True: (0.5, 0.25, 0.0, -0.5)}  # thresholds, by `adaptive`


class Sequence(NamedTuple):
    """Pictures, and of each target its first frame and its boxes (N, 4) from there on."""

    name: str
    pictures: list
    targets: list


class Mil:
    """OpenCV's MIL as a short-term tracker."""

    def __init__(self, pixels, box):
        cv2.setRNGSeed(0)
        self._tracker, self.box = cv2.TrackerMIL_create(), box
        self._tracker.init(pixels, _whole(box))

    def update(self, pixels):
        """Follow into the next picture."""
        found, (left, top, width, height) = self._tracker.update(pixels)
        if found:
            self.box = np.array([left, top, left + width, top + height], dtype=float)


class Hst:
    """HST."""

    def __init__(self, rate, seed, pixels, box):
        config = ShortTermConfig(appearance=AppearanceConfig(rate=rate, reach=1.0))
        self._tracker = ShortTermTracker(config, _grey(pixels), box, np.random.default_rng(seed))

    def update(self, pixels):
        """Follow into the next picture."""
        self._tracker.update(_grey(pixels))

    @property
    def box(self):
        """Of the target."""
        return self._tracker.box


def pets(folder):
    """The people of PETS, as bodies, and their heads."""
    rows = np.loadtxt(folder / "gt_frames_1_200.txt", delimiter=",")
    pictures = [cv2.imread(str(name)) for name in sorted((folder / "img1").glob("*.jpg"))]
    bodies = []
    for person in np.unique(rows[:, 1]):
        its = rows[rows[:, 1] == person]
        frames = its[:, 0].astype(int) - 1
        # A person who comes again is another target.
        for part in np.split(np.arange(len(frames)), np.nonzero(np.diff(frames) > 1)[0] + 1):
            boxes = its[part, 2:6]
            bodies.append((int(frames[part[0]]), np.hstack([boxes[:, :2], boxes[:, :2] + boxes[:, 2:]])))
    heads = []
    for first, boxes in bodies:
        middles, sizes = 0.5 * (boxes[:, 0] + boxes[:, 2]), (boxes[:, 3] - boxes[:, 1]) * HEAD / PERSON
        tops = boxes[:, 1]
        heads.append((first, np.column_stack([middles - 0.5 * sizes, tops, middles + 0.5 * sizes, tops + sizes])))
    return Sequence("PETS, people", pictures, bodies), Sequence("PETS, heads", pictures, heads)


def turning_head(folder):
    """The one person who turns around."""
    pictures, boxes = [], []
    for name in sorted(folder.glob("*_mask.jpg")):
        stem = name.name[: -len("_mask.jpg")]
        pictures.append(cv2.imread(str(folder / f"{stem}.jpg")))
        mask = cv2.morphologyEx(cv2.imread(str(name), 0), cv2.MORPH_OPEN, np.ones((9, 9), np.uint8)) > 127
        depth = cv2.imread(str(folder / f"{stem}_depth.png"), cv2.IMREAD_UNCHANGED)
        _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
        mask = labels == 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])
        top = int(np.nonzero(mask.any(axis=1))[0][0])
        size = HEAD * FOCAL / (np.median(depth[mask]) / 1000.0)
        cols = np.nonzero(mask[top : top + int(0.6 * size)].any(axis=0))[0]
        middle = 0.5 * (cols[0] + cols[-1] + 1)
        boxes.append([middle - 0.5 * size, top, middle + 0.5 * size, top + size])
    return Sequence("turning head", pictures, [(0, np.array(boxes))])


def short_term(sequence, make):
    """Overlap, share above one half, losses a frame, frames until lost (mean over targets), ms a frame."""
    counted, losses, frames, until, spent, updates = [], 0, 0, [], 0.0, 0
    for first, boxes in sequence.targets:
        tracker, started, restart, lost_at = None, 0, 0, None
        for number, box in enumerate(boxes):
            pixels = sequence.pictures[first + number]
            frames += 1
            if tracker is None:
                if number >= restart:
                    tracker, started = make(pixels, box), number
                continue
            start = time.process_time()
            tracker.update(pixels)
            spent, updates = spent + time.process_time() - start, updates + 1
            shared = float(overlaps(tracker.box[None], box[None])[0, 0])
            if shared == 0.0:
                lost_at = number if lost_at is None else lost_at
                tracker, restart, losses = None, number + SKIPPED, losses + 1
            elif number - started >= SETTLING or started == 0:
                counted.append(shared)
        until.append(len(boxes) if lost_at is None else lost_at)
    return {
        "overlap": float(np.mean(counted)),
        "above_half": float(np.mean(np.array(counted) > 0.5)),
        "losses": losses / frames,
        "until_lost": float(np.mean(until)),
        "ms": 1000.0 * spent / updates,
    }


def found_in(true, reported, overlap):
    """How many true heads are found, how many reported ones are none, and the overlaps of those found."""
    shared, found = overlaps(true, reported), []
    while shared.size and shared.max() >= overlap:
        row, col = np.unravel_index(np.argmax(shared), shared.shape)
        found.append(float(shared[row, col]))
        shared[row], shared[:, col] = 0.0, 0.0
    return len(found), len(reported) - len(found), found


class Tally:
    """Misses, false positives a picture, mean overlap, ms a picture of `report`, which gives boxes of HeadScores."""

    def __init__(self, report, overlap):
        self._report, self._overlap = report, overlap
        self._there, self._found, self._false, self._shared, self._spent, self._pictures = 0, 0, 0, [], 0.0, 0

    def see(self, scores, true):
        """One more picture with heads (N, 4)."""
        start = time.process_time()
        reported = self._report(scores)
        self._spent += time.process_time() - start
        hits, misfits, values = found_in(true, reported, self._overlap)
        self._there, self._found, self._false = self._there + len(true), self._found + hits, self._false + misfits
        self._shared, self._pictures = self._shared + values, self._pictures + 1

    def row(self):
        """Means."""
        return {
            "misses": 1.0 - self._found / self._there,
            "false": self._false / self._pictures,
            "overlap": float(np.mean(self._shared)) if self._shared else 0.0,
            "ms": 1000.0 * self._spent / self._pictures,
        }


def detections(threshold):
    """`report` of Tally."""
    return lambda scores: scores.corners[scores.box_scores > threshold].reshape(-1, 4)


def particles(config, seed, threshold):
    """`report` of Tally; what scores less than the threshold is no detection."""
    tracker = ImageHeads(config, np.random.default_rng(seed))

    def report(scores):
        tracker.update(scores.select(scores.box_scores > threshold))
        return np.array([head.box for head in tracker.heads]).reshape(-1, 4)

    return report


def head_rows(sequence, settings, thresholds, arguments):
    """Of the detector at several thresholds, and of trackers with several `lost`."""
    tallies = {f"detector above {least:g}": [Tally(detections(least), arguments.overlap)] for least in thresholds}
    for adaptive, limits in LOST.items():
        for lost in limits:
            particle = {"adaptive": adaptive, "own_lost" if adaptive else "lost": lost}
            config = parse(TrackHeadConfig, {"particle": particle}).particle
            tallies[f"{'adaptive' if adaptive else 'class only'}, lost below {lost:g}"] = [
                Tally(particles(config, seed, arguments.threshold), arguments.overlap)
                for seed in range(arguments.seeds)
            ]
    detector = {"threshold": min(thresholds), **settings.get("detector", {})}
    search, spent = scored(parse(TrackHeadConfig, {**settings, "detector": detector})), 0.0
    for number, pixels in enumerate(sequence.pictures):
        start = time.process_time()
        scores = search(pixels)
        spent += time.process_time() - start
        true = [boxes[number - first] for first, boxes in sequence.targets if 0 <= number - first < len(boxes)]
        for runs in tallies.values():
            for tally in runs:
                tally.see(scores, np.array(true).reshape(-1, 4))
    rows = {"detector's search": {"ms": 1000.0 * spent / len(sequence.pictures)}}
    for name, runs in tallies.items():
        each = [tally.row() for tally in runs]
        rows[name] = {key: float(np.mean([row[key] for row in each])) for key in each[0]}
    return rows


def _whole(box):
    left, top, right, bottom = np.round(box).astype(int).tolist()
    return left, top, right - left, bottom - top


def _grey(pixels):
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder that holds pets09_s2l1 and rgbd_person")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--threshold", type=float, default=1.0, help="of the detections that start tracks")
    parser.add_argument("--overlap", type=float, default=0.3, help="from which a head is found")
    parser.add_argument("--json", type=Path)
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    bodies, heads = pets(arguments.data / "pets09_s2l1")
    turning = turning_head(arguments.data / "rgbd_person")

    result = {"short_term": {}, "heads": {}}
    makers = {}
    for rate in RATES:
        makers[f"HST, rate {rate:g}"] = [
            lambda *start, rate=rate, seed=seed: Hst(rate, seed, *start) for seed in range(arguments.seeds)
        ]
    if hasattr(cv2, "TrackerMIL_create"):
        makers[f"MIL, OpenCV {cv2.__version__}"] = [Mil]
    print("short-term trackers           overlap  above 0.5  losses/frame  until lost  ms/frame")
    for sequence in (bodies, turning):
        boxes = sum(len(boxes) for _, boxes in sequence.targets)
        print(f"{sequence.name}: {len(sequence.targets)} targets, {boxes} boxes")
        for name, seeds in makers.items():
            runs = [short_term(sequence, make) for make in seeds]
            row = {key: float(np.mean([run[key] for run in runs])) for key in runs[0]}
            result["short_term"][f"{sequence.name}: {name}"] = row
            print(
                f"  {name:26s}  {row['overlap']:7.3f}  {100 * row['above_half']:7.1f} %  {100 * row['losses']:10.2f} %"
                f"  {row['until_lost']:10.1f}  {row['ms']:8.2f}",
                flush=True,
            )
    print("\nhead trackers                 misses  false/picture  overlap  ms/picture")
    for sequence, settings in ((turning, {}), (heads, {"largest": 24, "detector": {"enlarge": 4.0}})):
        print(sequence.name)
        rows = head_rows(sequence, settings, (1.0, 0.5, 0.0, -0.5), arguments)
        result["heads"][sequence.name] = rows
        for name, row in rows.items():
            if "misses" in row:
                print(
                    f"  {name:26s}  {100 * row['misses']:5.1f} %  {row['false']:13.2f}  {row['overlap']:7.3f}"
                    f"  {row['ms']:10.2f}",
                    flush=True,
                )
            else:
                print(f"  {name:26s}  {'':30s}  {row['ms']:10.2f}")
    if arguments.json:
        arguments.json.write_text(json.dumps(result, indent=2) + "\n")


if __name__ == "__main__":
    main()
