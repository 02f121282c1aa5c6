#!/usr/bin/env python3
"""The particle tracker's own time for a measurement: predict, weigh, draw anew, summarise; beside the Kalman tracker's.

Ten tracks of 500 particles, all of them detected, on one core. The ratio's base is the Kalman tracker on the same
measurements in the same run.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import dataclasses
import time

import numpy as np

from people_fusion.core.config import parse
from people_fusion.core.measurements import XYZ_OBSERVED, Measurement
from people_fusion.tracking.tracker import TRACKERS


def walkers(people, count, seed=0):
    """Measurements of people on a circle, ten a second, each seen every time."""
    rng = np.random.default_rng(seed)
    phases = np.arange(people) * 2.0 * np.pi / people
    for step in range(count):
        angles = phases + 0.02 * step
        places = np.column_stack([6.0 * np.cos(angles), 6.0 * np.sin(angles), np.full(people, 1.7)])
        yield Measurement(
            stamp_ns=step * 100_000_000,
            cue="head",
            modality="head",
            frame_id="map",
            positions=places + rng.normal(0.0, 0.05, places.shape),
            covariances=np.repeat(0.05**2 * np.eye(3)[None], people, axis=0),
            confidences=np.full(people, 0.9),
            observed=XYZ_OBSERVED,
            sequence=step,
        )


def milliseconds(tracker, measurements):
    """Of each measurement, after the first ten."""
    took = []
    for measurement in measurements:
        began = time.perf_counter()
        tracker.process(measurement)
        took.append(1e3 * (time.perf_counter() - began))
    return np.array(took[10:])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--people", type=int, default=10)
    parser.add_argument("--particles", type=int, default=500)
    parser.add_argument("--measurements", type=int, default=300)
    options = parser.parse_args()
    measurements = list(walkers(options.people, options.measurements))
    kalman = milliseconds(TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), {})), measurements)
    config = parse(TRACKERS.config_of("particle", "tracker"), {"particles": options.particles})
    print(f"{options.people} people, {options.particles} particles each; ms a measurement")
    print(f"{'':28}{'median':>9}{'p95':>9}{'ratio':>9}")
    rows = {
        "Kalman": kalman,
        "particles": milliseconds(TRACKERS.build(config), measurements),
        "particles, always drawn anew": milliseconds(
            TRACKERS.build(dataclasses.replace(config, resample_below=1.0)), measurements
        ),
    }
    for name, took in rows.items():
        middle = np.median(took)
        print(f"{name:28}{middle:9.2f}{np.percentile(took, 95):9.2f}{middle / np.median(kalman):9.1f}")


if __name__ == "__main__":
    main()
