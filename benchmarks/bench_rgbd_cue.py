#!/usr/bin/env python3
"""The RGB-D cue on simulated depth images: who is found, how well its covariances hold, and what it costs.

Who counts is between NEAREST and FARTHEST metres of depth with at least VISIBLE of his head to be seen; of the others
finds are neither right nor wrong. A find is right within BOUND metres of the head's middle. NEES is of the position in
the camera's frame, whose pose is known here: 3 is honest. Time is the CPU's, of whole frames, on one core; the ratio is
to the work of reading a frame's points alone.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses
import time

import numpy as np
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.optimize import linear_sum_assignment

from people_fusion.core.depth_images import DepthImage
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.rgbd.rgbd import RgbdCue, RgbdCueConfig
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import BASE_HEIGHT, Simulation

NEAREST, FARTHEST, VISIBLE, BOUND = 0.8, 4.0, 0.5, 0.5


class Stand(TransformSource):
    """The base's place is known."""

    def __init__(self, pose):
        self.pose = pose

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        return self.pose


def score(measurement, heads):
    """Rows of people who count (distance, found, NEES or NaN), and whether each other find is false."""
    offsets = measurement.positions[:, None] - heads.positions[None]
    distances = np.linalg.norm(offsets, axis=2)
    finds, people = linear_sum_assignment(np.minimum(distances, BOUND)) if distances.size else ((), ())
    pairs = {person: find for find, person in zip(finds, people) if distances[find, person] < BOUND}
    rows = []
    for person, position in enumerate(heads.positions):
        if not NEAREST <= position[2] <= FARTHEST or heads.visibility[person] < VISIBLE:
            continue
        nees = np.nan
        if person in pairs:
            error = offsets[pairs[person], person]
            nees = error @ np.linalg.solve(measurement.covariances[pairs[person]], error)
        rows.append((position[2], person in pairs, nees))
    others = [find for find in range(len(measurement)) if find not in pairs.values()]
    return rows, sum(NEAREST <= measurement.positions[find, 2] <= FARTHEST for find in others)


def run(scenario, seed, config, every_s):
    """Rows of all people who count, false finds, and CPU milliseconds by frame."""
    simulation = Simulation(scenario, seed)
    (camera,) = simulation.depth_cameras
    base = camera.beside.config.base_from_camera
    stand = Stand(Pose(base.rotation, base.translation + [0.0, 0.0, BASE_HEIGHT]))
    cue = RgbdCue(config, "kinect", FramesConfig())
    rows, false, took = [], 0, []
    times = np.arange(0.5, scenario.duration_s, every_s)
    for number, at in enumerate(track(times, f"seed {seed}", transient=True)):
        picture = camera.picture(simulation.history, float(at), number + 1)
        colour = picture.colour.pixels if config.colour else None
        image = DepthImage(number + 1, picture.config.frame, picture.depths, camera.beside.camera, colour)
        began = time.process_time()
        measurement = cue.measure(image, stand)
        took.append(1e3 * (time.process_time() - began))
        found, more = score(measurement, picture.heads)
        rows += found
        false += more
    return rows, false, took


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenarios", nargs="+", default=["sitting_depth", "crowd_depth"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--every", type=float, default=1.0, help="seconds from image to image")
    parser.add_argument("--colour", action="store_true", help="look for heads in the colour images, too")
    options = parser.parse_args()
    config = dataclasses.replace(RgbdCueConfig(), colour=options.colour)
    table = Table("scenario", "people", "recall", "precision", "NEES", "ms median", "ms 95 %", "ms most")
    for name in options.scenarios:
        scenario = load_scenario(name)
        rows, false, took = [], 0, []
        for seed in range(options.first_seed, options.first_seed + options.seeds):
            more_rows, more_false, more_took = run(scenario, seed, config, options.every)
            rows, false, took = rows + more_rows, false + more_false, took + more_took[2:]
        distances, found, nees = (np.array(column) for column in zip(*rows))
        hits = found.sum()
        figures = [f"{hits / len(found):.3f}", f"{hits / max(hits + false, 1):.3f}", f"{np.nanmean(nees):.2f}"]
        times = [f"{each:.1f}" for each in np.quantile(took, [0.5, 0.95, 1.0])]
        table.add_row(name, str(len(found)), *figures, *times)
        for low, high in ((0.8, 1.5), (1.5, 2.5), (2.5, 4.0)):
            part = (distances >= low) & (distances < high)
            if part.any():
                honest = f"{np.nanmean(nees[part]):.2f}"
                table.add_row(f"  {low} to {high} m", str(part.sum()), f"{found[part].mean():.3f}", "", honest)
    Console().print(table)


if __name__ == "__main__":
    main()
