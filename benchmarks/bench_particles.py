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

import cv2
import numpy as np

from people_fusion.core.camera_models import Panorama, PanoramaConfig
from people_fusion.core.config import parse
from people_fusion.core.head_scores import FEATURES
from people_fusion.core.images import Image
from people_fusion.core.measurements import XYZ_OBSERVED, Measurement
from people_fusion.core.poses import Pose
from people_fusion.cues.heads.appearance import length
from people_fusion.cues.heads.detector import Search
from people_fusion.cues.heads.detectors.fhog_head import FhogHead, FhogHeadConfig
from people_fusion.tracking.tracker import TRACKERS
from people_fusion.tracking.weighing import MEASUREMENT_MODELS, Belief, Pairing


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


def scored_image(seed=0):
    """Scores and cells of a panorama of noise, as the head cue gives them to a tracker that learns how people look."""
    rng = np.random.default_rng(seed)
    pixels = cv2.resize(rng.integers(0, 256, (60, 352, 3)).astype(np.uint8), (1406, 240))
    image = Image(0, "panorama", pixels, Panorama(PanoramaConfig(1406, 240)))
    detector = FhogHead(FhogHeadConfig())
    detector.wanted_scores = FEATURES
    boxes = detector.detect(image, Search.everywhere(image, 32.0, 120.0))
    return dataclasses.replace(
        detector.scores(image, boxes.take(np.zeros(0, dtype=int))), pose=Pose(np.eye(3), np.array([0.0, 0.0, 1.6]))
    )


def weighing(people, particles, adaptive, rounds=100):
    """Milliseconds of each weighing by the scores of an image, everybody in it."""
    rng = np.random.default_rng(0)
    scores = scored_image()
    model = MEASUREMENT_MODELS.build(parse(MEASUREMENT_MODELS.config_of("heads", "model"), {"adaptive": adaptive}))
    angles = np.arange(people) * 2.0 * np.pi / people
    means = np.column_stack([1.3 * np.cos(angles), 1.3 * np.sin(angles), np.full(people, 1.6), *np.zeros((2, people))])
    states = means[:, None] + 0.05 * rng.standard_normal((people, particles, 5))
    size = length(scores.window, scores.layers[0].features.shape[2]) if adaptive else 0
    memory = (0.01 * rng.standard_normal((people, size))).astype(np.float32)
    weights = np.full((people, particles), 1.0 / particles)
    belief = Belief(states, weights, means, np.tile(0.01 * np.eye(5), (people, 1, 1)), np.ones(people, bool), memory)
    nobody = np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0)
    measurement = Measurement(0, "camera", "head", "map", *nobody, XYZ_OBSERVED, 0.1, scores=scores)
    took = []
    for _ in range(rounds):
        began = time.perf_counter()
        model.weigh(belief, measurement, Pairing.nothing(people, 0), rng)
        took.append(1e3 * (time.perf_counter() - began))
    return np.array(took[5:])


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
    rows["weighing by scores, H2"] = weighing(options.people, options.particles, adaptive=False)
    rows["weighing by scores, H2A"] = weighing(options.people, options.particles, adaptive=True)
    for name, took in rows.items():
        middle = np.median(took)
        print(f"{name:28}{middle:9.2f}{np.percentile(took, 95):9.2f}{middle / np.median(kalman):9.1f}")


if __name__ == "__main__":
    main()
