#!/usr/bin/env python3
"""How fast particles are weighed by how their people look: ten people of 500 particles in 640x480, on one core.

Times are of the process, medians: where in the image the particles' heads are, the detector's scores there, those of
each person's own model by the kernel in C and by NumPy, and learning how all ten look. Exits with 1 where the bound is
not held.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import sys
import time

import cv2
import numpy as np

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.head_scores import HeadScores, ScoreLayer, ScoreWindow
from people_fusion.core.poses import Pose
from people_fusion.cues.heads import native
from people_fusion.cues.heads.appearance import AppearanceConfig, learn, length, scores_of
from people_fusion.cues.heads.head_model import load_head_model
from people_fusion.cues.heads.places import Places, Seen, interpolated, places_of, seen
from people_fusion.cues.heads.pyramid import pyramid, score_maps

BOUND_MS, PEOPLE, PARTICLES = 3.0, 10, 500
CAMERA = Pinhole(640, 480, np.array([[525.0, 0.0, 319.5], [0.0, 525.0, 239.5], [0.0, 0.0, 1.0]]))
AHEAD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
SPREAD = (0.15, 0.15, 0.05)  # of particles, metres


def scored(model):
    """What a model says of textures."""
    rng = np.random.default_rng(0)
    grey = sum(
        cv2.resize(rng.normal(0.0, edge, (480 // edge, 640 // edge)), (640, 480), interpolation=cv2.INTER_CUBIC)
        for edge in (4, 8, 16, 32)
    )
    cells = pyramid(np.clip(128.0 + 2.0 * grey, 0, 255).astype(np.uint8), model.window, 30.0, 480.0)
    layers = [
        ScoreLayer(layer.scale, layer.row, layer.col, scores, layer.features)
        for layer, scores in zip(cells, score_maps(model, cells))
    ]
    window = ScoreWindow(model.window.rows, model.window.cols, model.window.features.cell, model.window.box)
    none = np.zeros((0, 4)), np.zeros(0)
    pose = Pose(AHEAD, np.array([0.0, 0.0, 1.2]))
    return HeadScores(CAMERA, window, model.platt_slope, 0.24, -0.01, 0, tuple(layers), *none, pose)


def milliseconds(rounds, call):
    """Median of the process's time."""
    call()
    times = []
    for _ in range(rounds):
        start = time.process_time()
        call()
        times.append(time.process_time() - start)
    return 1e3 * float(np.median(times))


def without_kernel(rounds, call):
    """The same by NumPy."""
    kernel, native._library = native._library, lambda: None
    try:
        return milliseconds(rounds, call)
    finally:
        native._library = kernel


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=50)
    options = parser.parse_args()
    rng = np.random.default_rng(1)
    scores = scored(load_head_model("heads"))
    distances = rng.uniform(1.5, 3.5, PEOPLE)
    heads = np.column_stack([distances, distances * rng.uniform(-0.4, 0.4, PEOPLE), rng.uniform(1.1, 1.6, PEOPLE)])
    particles = (heads[:, None] + rng.normal(0.0, SPREAD, (PEOPLE, PARTICLES, 3))).reshape(-1, 3)
    boxes: Seen = seen(scores, particles)
    flat = places_of(scores, boxes)
    places = Places(*(column.reshape(PEOPLE, PARTICLES) for column in flat))
    there = places_of(scores, seen(scores, heads))
    config = AppearanceConfig()
    empty = np.zeros((PEOPLE, length(scores.window, scores.layers[0].features.shape[2])), dtype=np.float32)
    models = learn(empty, scores, there, config, rng)
    maps = [layer.scores for layer in scores.layers]

    parts = {
        "where they are seen": lambda: seen(scores, particles),
        "which windows those are": lambda: places_of(scores, boxes),
        "the detector's scores": lambda: interpolated(maps, flat),
        "each one's own scores": lambda: scores_of(models, scores, places),
    }
    print(f"{PEOPLE} people of {PARTICLES} particles, kernel {'in C' if native.is_native() else 'missing: NumPy'}")
    took = {name: milliseconds(options.rounds, call) for name, call in parts.items()}
    for name, each in took.items():
        print(f"  {name:<26} {each:7.2f} ms")
    total = sum(took.values())
    own = took["each one's own scores"]
    slow = without_kernel(max(options.rounds // 10, 2), parts["each one's own scores"])
    print(f"  {'together':<26} {total:7.2f} ms")
    print(f"own scores by NumPy          {slow:7.2f} ms, {slow / own:.1f} times as long")
    learning = milliseconds(options.rounds, lambda: learn(models, scores, there, config, np.random.default_rng(2)))
    print(f"learning how they look       {learning:7.2f} ms")
    held = own <= BOUND_MS
    print(f"own scores in {BOUND_MS:.0f} ms: {'held' if held else 'NOT HELD'}")
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
