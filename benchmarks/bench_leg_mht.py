#!/usr/bin/env python3
"""Time of the multi-hypothesis leg tracker, a scan: the experiments of Arras et al. 2012, 3.4, and a crowd of twenty.

The legs are those of the preset's leg cue on simulated scans, computed beforehand. Times are those of the process, on
one core. The ratio is that of the 95th percentile to the paper's 44.5 ms a scan; nothing is asserted.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import gc
import json
import tempfile
import time
from pathlib import Path

import numpy as np

from people_fusion.replay.replay import Selection, replay
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.simulator import simulate
from people_fusion.simulation.trials import trials
from people_fusion.tracking.fusion import load_config
from people_fusion.tracking.trackers.leg_mht import LegMht

SCENARIOS = ("arras_eight", "arras_turning", "arras_corridor", "arras_moving", "crowd")
PAPER_MS = 44.5


def measurements_of(trial, config):
    """What a tracker gets of a recording, in the tracking frame."""
    found = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "recording.bag"
        write_bag(path, simulate(trial.scenario, trial.seed))
        replay(path, config, Selection(), watch=lambda _, update: found.append(update.measurement))
    return found


def run(measurements, config):
    """Milliseconds, hypotheses and legs of each scan; and what was shed or happened otherwise."""
    tracker, rows = LegMht(config), []
    gc.collect()
    gc.freeze()  # what the simulation left is not searched for garbage in between
    for measurement in measurements:
        began = time.process_time()
        tracker.process(measurement)
        elapsed_ms = 1e3 * (time.process_time() - began)
        rows.append((elapsed_ms, tracker.hypotheses, len(measurement.legs), len(tracker.leg_tracks.ids)))
    return np.array(rows).T, tracker.counters()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenarios", nargs="+", default=SCENARIOS, metavar="NAME")
    parser.add_argument("--preset", default="default", help="whose leg cue is used (default %(default)s)")
    parser.add_argument("--duration", type=float, default=60.0, metavar="S", help="simulated (default %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE")
    options = parser.parse_args()
    legs = load_config(options.preset, {"tracker": {"type": "leg_mht"}})
    plain = load_config(options.preset)
    table = {}
    print("scenario           legs  tracks  hypotheses   median     95 %      max   95 % / paper's 44.5 ms   shed")
    for trial in trials(options.scenarios, 1, options.duration):
        (times, hypotheses, seen, tracked), counts = run(measurements_of(trial, plain), legs.tracker)
        median, p95 = np.percentile(times, [50, 95])
        table[trial.name] = {
            "median_ms": median, "p95_ms": p95, "max_ms": times.max(), "ratio": p95 / PAPER_MS, "scans": len(times),
            "legs": seen.mean(), "tracks": tracked.mean(), "hypotheses": hypotheses.mean(), "counts": counts,
        }  # fmt: skip
        told = ", ".join(f"{name}: {count}" for name, count in counts.items())
        print(
            f"{trial.name:16s} {seen.mean():6.1f}  {tracked.mean():6.1f}  {hypotheses.mean():10.0f}  {median:7.2f}"
            f"  {p95:7.2f}  {times.max():7.2f}  {p95 / PAPER_MS:23.2f}   {told} in {len(times)} scans"
        )
    if options.json:
        options.json.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
