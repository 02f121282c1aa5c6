#!/usr/bin/env python3
"""Time of segments, features and classification of a scan of 541 beams, beside the paper's features segment by segment.

The scans are those of bench_leg_cue.py; the model is the shipped one. Times are those of the process.
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
from bench_leg_cue import PERIOD_NS, make_scan

from people_fusion.core.resources import directory
from people_fusion.cues.legs.classifier import load_leg_model
from people_fusion.cues.legs.features import MIN_POINTS
from people_fusion.cues.legs.segments import segment


def one_by_one(found):
    """The paper's features 1 to 13, as its text has them, in a loop over the segments."""
    rows = []
    for start, n in zip(found.starts, found.counts):
        if n < MIN_POINTS:
            continue
        p = found.points[start : start + n]
        mean, median = p.mean(axis=0), np.median(p, axis=0)
        deviation = math.sqrt(((p - mean) ** 2).sum() / (n - 1))
        around = np.linalg.norm(p - median, axis=1).mean()
        before = np.linalg.norm(p[0] - found.points[start - 1])
        after = np.linalg.norm(p[-1] - found.points[(start + n) % len(found.points)])
        line = np.linalg.eigvalsh((p - mean).T @ (p - mean))[0]
        circle, *_ = np.linalg.lstsq(np.column_stack([-2 * p, np.ones(n)]), -(p**2).sum(axis=1), rcond=None)
        radius = math.sqrt(max(circle[0] ** 2 + circle[1] ** 2 - circle[2], 0.0))
        roundness = ((radius - np.linalg.norm(p - circle[:2], axis=1)) ** 2).sum()
        steps = np.diff(p, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        chords = np.linalg.norm(p[2:] - p[:-2], axis=1)
        cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
        curvature = (2 * abs(cross) / (lengths[:-1] * lengths[1:] * chords)).mean()
        turning = np.arctan2(cross, (steps[:-1] * steps[1:]).sum(axis=1)).mean()
        width = np.linalg.norm(p[-1] - p[0])
        rows.append([n, deviation, around, before, after, width, line, roundness, radius, lengths.sum(), lengths.std(),
                     curvature, turning])  # fmt: skip
    return np.array(rows)


def times_ms(work, scans):
    for scan in scans[:20]:
        work(scan)
    times = []
    for scan in scans:
        began = time.process_time()
        work(scan)
        times.append(1e3 * (time.process_time() - began))
    return np.array(times)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scans", type=int, default=300)
    parser.add_argument("--people", type=int, default=6)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    arguments = parser.parse_args()
    rng = np.random.default_rng(arguments.seed)
    scans = [make_scan(k * PERIOD_NS, rng, arguments.people) for k in range(arguments.scans)]
    model = load_leg_model(directory("config") / "models" / "legs.json")

    def cut(scan):
        return segment(scan, scan.ranges, model.jump, model.jump_beams)

    baseline = times_ms(lambda scan: one_by_one(cut(scan)), scans)
    ours = times_ms(lambda scan: model.probabilities(cut(scan)), scans)
    count = np.mean([len(cut(scan)) for scan in scans])
    table = {}
    print(f"{count:.0f} segments a scan, {len(model.stumps.weights)} stumps")
    for name, times in (("segments one by one, 13 features", baseline), ("ours, 28 features and 300 stumps", ours)):
        median, p95 = np.percentile(times, [50, 95])
        table[name] = {"median_ms": median, "p95_ms": p95, "ratio": median / np.median(baseline)}
        print(f"{name:34s} median {median:6.2f} ms  95 % {p95:6.2f} ms  ratio {median / np.median(baseline):5.2f}")
    if arguments.json:
        arguments.json.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
