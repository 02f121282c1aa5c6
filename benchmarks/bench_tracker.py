#!/usr/bin/env python3
"""The tracker alone, on detections made from the truth, beside Stone Soup's GNN and JPDA on the same draws.

Prints MOTA and IDF1 for five, ten and twenty people, and the time per measurement with its ratio to Stone Soup's global
nearest neighbour in the same run; `--scale` adds the time with 100 people and the memory over an hour.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import json
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path

import numpy as np

from people_fusion.evaluation.evaluate import Scores, evaluate
from people_fusion.evaluation.truth import Estimates, Truth
from people_fusion.simulation.detections import DetectionsConfig, detections
from people_fusion.tracking.fusion import load_config
from people_fusion.tracking.tracker import TRACKERS

REPOSITORY = Path(__file__).resolve().parent.parent
ORACLES = Path(os.environ.get("PEOPLE_FUSION_ORACLE_PYTHON", str(REPOSITORY / ".workspace/oracles/bin/python")))


def ours(config, measurements):
    """Reported tracks after each measurement, and the seconds that each took."""
    tracker, tracks, seconds = TRACKERS.build(config), [], []
    for measurement in measurements:
        began = time.perf_counter()
        tracker.process(measurement)
        seconds.append(time.perf_counter() - began)
        tracks.append(tracker.tracks())
    return Estimates.from_tracks(tracks), np.array(seconds)


def stone_soup(method, measurements, std):
    """The same of Stone Soup, in its own environment."""
    scans = [
        {"time_s": (m.stamp_ns - measurements[0].stamp_ns) / 1e9, "positions": m.positions[:, :2].tolist(), "std": std}
        for m in measurements
    ]
    script = str(Path(__file__).resolve().parent / "stone_soup_trackers.py")
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    done = subprocess.run(
        [str(ORACLES), script, method], input=json.dumps(scans), stdout=subprocess.PIPE, text=True, check=True,
        env=environment,
    )  # fmt: skip
    result = json.loads(done.stdout)
    frames = [np.array(rows, dtype=float).reshape(-1, 3) for rows in result["tracks"]]
    estimates = Estimates.from_frames([f[:, 0].astype(int) for f in frames], [f[:, 1:] for f in frames])
    return estimates, result["seconds"] / len(measurements)


def in_view(estimates, measurements):
    """Only people in view are in the truth, so that only tracks in view are compared with it, of whichever tracker."""
    bounds = estimates.bounds(len(measurements))
    inside = np.zeros(len(estimates.ids), dtype=bool)
    for frame, measurement in enumerate(measurements):
        rows = slice(bounds[frame], bounds[frame + 1])
        inside[rows] = measurement.sight.visible(estimates.points[rows], half_width_m=0.05, depth_m=0.0) > 0.5
    return estimates.select(inside)


def quality(config, crowds, seeds, methods):
    """Rows of the table: people, tracker, scores, milliseconds a measurement."""
    for people in crowds:
        totals, milliseconds = {}, {}
        for seed in range(seeds):
            drawn = DetectionsConfig(people=people)
            measurements, truths = detections(drawn, seed)
            truth = Truth.from_frames(*zip(*truths))
            runs = {"ours": ours(config, measurements)}
            for method in methods:
                runs[f"stone soup {method}"] = stone_soup(method, measurements, drawn.std)
            for name, (estimates, seconds) in runs.items():
                totals[name] = totals.get(name, Scores()) + evaluate(truth, in_view(estimates, measurements)).scores
                milliseconds.setdefault(name, []).append(1e3 * float(np.mean(seconds)))
        for name, scores in totals.items():
            yield people, name, scores.to_dict(), float(np.mean(milliseconds[name]))


def scale(config):
    """Milliseconds a measurement with 100 people (median, 95th percentile) and memory before and after an hour."""
    measurements, _ = detections(DetectionsConfig(people=100, hall=40.0, reach=30.0, duration_s=30.0), 0)
    _, seconds = ours(config, measurements)
    settled = seconds[50:]
    measurements, _ = detections(DetectionsConfig(people=10, duration_s=60.0), 0)
    tracker = TRACKERS.build(config)
    lap_ns = measurements[-1].stamp_ns - measurements[0].stamp_ns + 10**8
    tracemalloc.start()
    memory = []
    for lap in range(60):
        for measurement in measurements:
            shifted = dict(measurement.__dict__, stamp_ns=measurement.stamp_ns + lap * lap_ns)
            tracker.process(type(measurement)(**shifted))
        memory.append(tracemalloc.get_traced_memory()[0] / 1024)
    return {
        "people": 100,
        "median_ms": float(np.median(settled) * 1e3),
        "p95_ms": float(np.percentile(settled, 95) * 1e3),
        "memory_kib_after_10_minutes": memory[9],
        "memory_kib_after_an_hour": memory[-1],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--config", default=None, help="preset; default: default")
    parser.add_argument("--people", type=int, nargs="+", default=[5, 10, 20])
    parser.add_argument(
        "--peers", nargs="*", choices=("gnn", "jpda"), default=["gnn", "jpda"],
        help="of Stone Soup; JPDA of 20 people takes a quarter of an hour a seed",
    )  # fmt: skip
    parser.add_argument("--scale", action="store_true")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    config = load_config(options.config).tracker
    peers = options.peers if ORACLES.exists() else []
    if options.peers and not peers:
        print(f"{ORACLES} is not there: without Stone Soup", file=sys.stderr)
    rows, baseline = [], {}
    print("people  tracker            MOTA   IDF1   HOTA   miss  false switch   NEES       ms")
    for people, name, scores, milliseconds in quality(config, options.people, options.seeds, peers):
        rows.append({"people": people, "tracker": name, "ms": milliseconds, **scores})
        baseline[people, name] = milliseconds
        nees = f"{scores['nees']:6.2f}" if scores["nees"] is not None else "     -"
        print(
            f"{people:6}  {name:16} {scores['mota']:6.3f} {scores['idf1']:6.3f} {scores['hota']:6.3f}"
            f" {scores['miss_rate']:6.3f} {scores['false_positive_rate']:6.3f} {scores['mismatch_rate']:6.3f}"
            f" {nees} {milliseconds:8.3f}"
        )
    for people in options.people if "gnn" in peers else ():
        ratio = baseline[people, "ours"] / baseline[people, "stone soup gnn"]
        print(f"{people} people: ours takes {ratio:.3f} of the time of Stone Soup's global nearest neighbour")
    result = {"quality": rows}
    if options.scale:
        result["scale"] = scale(config)
        print(json.dumps(result["scale"], indent=2))
    if options.json:
        options.json.write_text(json.dumps(result, indent=2))


if __name__ == "__main__":
    main()
