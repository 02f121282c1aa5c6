#!/usr/bin/env python3
"""Time of the leg cue on scans of 541 beams, with its ratio to the same steps written plainly with SciPy's linkage.

The scans are made here: people on two legs in a furnished room, a scanner of 270 degrees with noise that drives through
it and sweeps in 40 ms. `room` has no map, so that all walls go through clustering; `limits` is the same with the limits
that replace a map (the plain steps have none); `map` subtracts the room. All include de-skewing. Times are those of the
process, so that a busy machine disturbs them little.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import json
import math
import time
from pathlib import Path

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import NANOSECONDS, to_seconds
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.cue import CUES
from people_fusion.cues.legs import beams
from people_fusion.cues.legs.legs import LegCueConfig

BEAMS, INCREMENT = 541, math.radians(0.5)
SWEEP_S, PERIOD_NS = 0.04, NANOSECONDS // 12
ROOM = (6.0, 4.0)  # half of its edges, metres
CELL = 0.05
LIMITS = {"max_segment_width": 0.5, "min_segment_step": 0.1, "segment_gap_beams": 2.5}


class Drive(TransformSource):
    """A robot that drives to and fro through the room."""

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        phase = to_seconds(stamp_ns) * 0.2
        return Pose.from_xy_yaw(3.0 * math.sin(phase), 1.5 * math.cos(phase), 0.8 * phase)


def make_scan(stamp_ns, rng, people):
    """Scan of the furnished room with walking people at a stamp."""
    time_s, angles = to_seconds(stamp_ns), INCREMENT * (np.arange(BEAMS) - BEAMS // 2)
    phases = np.arange(people) * 2.4
    middles = np.stack([4.0 * np.cos(phases + 0.15 * time_s), 3.0 * np.sin(1.3 * phases + 0.15 * time_s)], axis=1)
    swing = 0.25 * np.sin(5.0 * time_s + phases)[:, None] * np.stack([np.cos(phases), np.sin(phases)], axis=1)
    side = 0.1 * np.stack([-np.sin(phases), np.cos(phases)], axis=1)
    chairs = np.array([[x + a, y + b] for x, y in ((-4.0, -2.5), (4.5, 2.0)) for a in (0.0, 0.45) for b in (0.0, 0.45)])
    circles = np.concatenate([middles + side + swing, middles - side - swing, chairs])
    radii = np.where(np.arange(len(circles)) < 2 * people, 0.065, 0.02)
    instants = stamp_ns + np.linspace(0.0, SWEEP_S, BEAMS) * NANOSECONDS
    poses = [Drive().lookup("map", "laser", int(instant)) for instant in instants]
    origins = np.array([pose.translation[:2] for pose in poses])
    angles = angles + np.array([float(pose.yaw) for pose in poses])
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ranges = ((np.sign(directions) * ROOM - origins) / directions).min(axis=1)
    to_circles = circles - origins[:, None]
    along = (to_circles * directions[:, None]).sum(axis=2)
    across = directions[:, None, 0] * to_circles[..., 1] - directions[:, None, 1] * to_circles[..., 0]
    hit = (abs(across) < radii) & (along > 0.0)
    depths = np.where(hit, along - np.sqrt(np.maximum(radii**2 - across**2, 0.0)), np.inf)
    ranges = np.minimum(ranges, depths.min(axis=1)) + rng.normal(0.0, 0.01, BEAMS)
    first_angle, time_increment = -INCREMENT * (BEAMS // 2), SWEEP_S / (BEAMS - 1)
    return Scan(stamp_ns, "laser", ranges, first_angle, INCREMENT, 0.05, 30.0, time_increment, to_seconds(PERIOD_NS))


def make_map():
    """Occupancy grid of the room's walls and the chairs."""
    half = np.array(ROOM) + 0.5
    width, height = np.round(2.0 * half / CELL).astype(int)
    x, y = (np.arange(width) + 0.5) * CELL - half[0], (np.arange(height) + 0.5) * CELL - half[1]
    walls = np.maximum(abs(x)[None, :] - ROOM[0], abs(y)[:, None] - ROOM[1])
    occupancy = np.where(abs(walls) < CELL, 100, 0).astype(np.int8)
    return OccupancyGrid("map", CELL, Pose.from_xy_yaw(-half[0], -half[1], 0.0), occupancy)


def plain(config, grid):
    """The cue's steps as one would write them with SciPy's linkage."""

    def cut(points, method, threshold):
        if len(points) < 2:
            return np.ones(len(points), dtype=int)
        return fcluster(linkage(points, method), threshold, criterion="distance")

    def detect(scan, transforms):
        points = scan.ranges[:, None] * np.stack([np.cos(scan.angles), np.sin(scan.angles)], axis=1)
        ends_ns = (scan.stamp_ns, scan.stamp_ns + beams.duration_ns(scan))
        poses = [transforms.lookup("odom", scan.frame_id, end_ns) for end_ns in ends_ns]
        points = beams.straighten(points, np.linspace(0.0, 1.0, BEAMS), *poses)
        if grid is not None:
            pose = transforms.lookup("map", scan.frame_id, scan.stamp_ns)
            points_map = pose.apply(np.column_stack([points, np.zeros(len(points))]))
            points = points[~grid.occupied_at(points_map, config.map_dilation)]
        segments = cut(points, "single", config.segment_gap)
        points = points[np.bincount(segments)[segments] > 1]
        people, groups = [], cut(points, "single", config.group_gap)
        for group in np.unique(groups):
            members = points[groups == group]
            labels = cut(members, "complete", config.leg_diameter)
            legs = [members[labels == label].mean(axis=0) for label in np.unique(labels)]
            pairs = sorted(
                (math.dist(legs[a], legs[b]), a, b) for a in range(len(legs)) for b in range(a + 1, len(legs))
            )
            free = set(range(len(legs)))
            for distance, a, b in pairs:
                if distance <= config.pair_distance and a in free and b in free:
                    free -= {a, b}
                    people.append((legs[a] + legs[b]) / 2.0)
            people += [legs[leg] for leg in free]
        return people

    return detect


def times_ms(detect, scans):
    """Milliseconds that each scan takes, and the mean number of detections."""
    for scan in scans[:20]:
        detect(scan, Drive())
    times, found = [], 0
    for scan in scans:
        began = time.process_time()
        found += len(detect(scan, Drive()))
        times.append(1e3 * (time.process_time() - began))
    return np.array(times), found / len(scans)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=500, help="scans per row (default: 500)")
    parser.add_argument("--people", type=int, default=6, help="people in the room (default: 6)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    arguments = parser.parse_args()
    if arguments.scans < 1 or arguments.people < 0:
        parser.error("--scans must be positive and --people not negative")

    rng = np.random.default_rng(arguments.seed)
    scans = [make_scan(index * PERIOD_NS, rng, arguments.people) for index in range(arguments.scans)]
    rows = {}
    print(f"{BEAMS} beams   mean     p50     p95 ms   found   plain p50 ms   times faster")
    for name, parameters, grid in (("room", {}, None), ("limits", LIMITS, None), ("map", {}, make_map())):
        config = LegCueConfig(**parameters)
        cue = CUES.build(config, name="scan", frames=FramesConfig())
        cue.set_map(grid)
        ours, found = times_ms(cue.measure, scans)
        theirs, _ = times_ms(plain(config, grid), scans)
        p50, p95 = np.percentile(ours, [50, 95])
        plain_p50 = float(np.median(theirs))
        rows[name] = {
            "mean_ms": float(ours.mean()),
            "p50_ms": float(p50),
            "p95_ms": float(p95),
            "detections": found,
            "plain_p50_ms": plain_p50,
            "times_faster": plain_p50 / float(p50),
        }
        print(
            f"{name:9s} {ours.mean():6.2f}  {p50:6.2f}  {p95:6.2f}     {found:5.1f}   {plain_p50:12.2f}   "
            f"{plain_p50 / p50:12.1f}"
        )
    if arguments.json:
        arguments.json.write_text(json.dumps({"beams": BEAMS, "scans": arguments.scans, "rows": rows}, indent=2) + "\n")


if __name__ == "__main__":
    main()
