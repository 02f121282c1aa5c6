#!/usr/bin/env python3
"""What a laser scanner adds to the heads of a camera: how far off they are and how sure they are, by size and with it.

Visits to a scenario with scanners and a camera are rendered, one picture every few seconds; the head cue finds heads
with `ranges/scans` on and off, told the truth about where the robot is. A find belongs to the person the middle of
whose head it covers, the best one only. Of heads whose distance the scanner changed: error along the ray, by size and
with the scanner, mean and standard deviation; how many lie more than half a metre off; NEES, on average 3 where
covariances are right, and the share within the ellipsoid of 95 %. The last rows are of all heads.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses

import numpy as np
import yaml

from people_fusion.core.config import parse
from people_fusion.core.images import Image
from people_fusion.core.poses import Pose
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.heads import HeadCue, HeadCueConfig
from people_fusion.cues.heads.people import heads_of_boxes
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import BASE_HEIGHT, START_NS, Simulation

SAME, VISIBLE = 0.3, 0.5  # intersection over union of a head that is found; share of it that is seen
ELLIPSE = 7.815  # chi-square of 3 degrees of freedom, 95 %
FAR_OFF = 0.5  # metres


class Truth(TransformSource):
    """Where the robot and its sensors really are."""

    def __init__(self, simulation):
        self._history = simulation.history
        self._mounts = {each.config.frame: each.config.base_from_camera for each in simulation.cameras}
        for each in simulation.scanners:
            x, y, yaw = each.config.mount
            self._mounts[each.config.frame] = Pose.from_xy_yaw(x, y, yaw, each.config.at[2])

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        x, y, yaw = self._history.at("robot", np.array([to_seconds(stamp_ns - START_NS)]))[0]
        return Pose.from_xy_yaw(x, y, yaw, BASE_HEIGHT) @ self._mounts[source_frame]


def looks(name, seed, pictures, every_s, parameters):
    """Of each picture: the cue's look, heads by size, and the truth (N, 3) in level axes with each find's row of it."""
    simulation = Simulation(dataclasses.replace(load_scenario(name), duration_s=pictures * every_s + 1.0), seed)
    camera, transforms = simulation.cameras[0], Truth(simulation)
    cue = HeadCue(parse(HeadCueConfig, parameters), "camera/head", FramesConfig())
    box = parse(HeadCueConfig, parameters).detector.box
    for number in range(pictures):
        time_s = 1.0 + number * every_s
        stamp_ns = START_NS + from_seconds(time_s)
        for scanner in simulation.scanners:
            rate, offset_s = scanner.config.rate, scanner.config.offset_s
            scan_s = offset_s + np.floor((time_s - offset_s) * rate) / rate
            cue.note(scanner.scan(simulation.history, scan_s, START_NS + from_seconds(scan_s)))
        picture = camera.picture(simulation.history, time_s, stamp_ns)
        image = Image(stamp_ns, camera.config.frame, picture.pixels, camera.camera)
        cue.measure(image, transforms)
        level = transforms.lookup("odom", image.frame_id, stamp_ns).rotation
        look, kept = cue.look, cue.look.kept
        corners = look.boxes.corners[kept]
        holds = (overlaps(corners, picture.heads.corners) > SAME) & (picture.heads.visibility > VISIBLE)
        first = holds & (holds.cumsum(axis=0) == 1)  # boxes come with the best first
        found, head = np.nonzero(first & (first.cumsum(axis=1) == 1))
        rows = np.flatnonzero(kept)[found]
        size = heads_of_boxes(look.boxes.corners[rows], camera.camera, level, box, look.boxes.confidences[rows])
        yield size, type(size)(*(each[rows] for each in look.heads)), picture.heads.positions[head] @ level.T


def print_row(title, heads, truth):
    """One table row of heads (N)."""
    if not len(truth):
        print(f"  {title:18s}     0")
        return
    errors = heads.positions - truth
    ahead = truth[:, :2] / np.linalg.norm(truth[:, :2], axis=1)[:, None]
    along = np.einsum("ni,ni->n", errors[:, :2], ahead)
    values = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(heads.covariances), errors)
    std = np.sqrt(np.einsum("ni,nij,nj->n", ahead, heads.covariances[:, :2, :2], ahead)).mean()
    print(
        f"  {title:18s} {len(truth):5d}  {along.mean():+.2f} +- {along.std():.2f} m  told {std:.2f} m  "
        f"{100 * (np.abs(along) > FAR_OFF).mean():4.1f} %  NEES {values.mean():5.2f}  "
        f"within 95 %: {100 * (values < ELLIPSE).mean():3.0f} %"
    )


def main():
    """Entry."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="*", default=["museum_cameras", "sitting_camera"])
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--pictures", type=int, default=40, help="of each visit")
    parser.add_argument("--every", type=float, default=2.9, help="seconds from one to the next")
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="parameters of `ranges`")
    options = parser.parse_args()
    ranges = {key: yaml.safe_load(value) for key, value in (each.split("=", 1) for each in options.set)}
    parameters = {"ranges": {"scans": True, **ranges}}
    for name in options.scenarios:
        every = [
            each for seed in options.seeds for each in looks(name, seed, options.pictures, options.every, parameters)
        ]
        size, ranged = (
            type(every[0][0])(*(np.concatenate(column) for column in zip(*(each[number] for each in every))))
            for number in (0, 1)
        )
        truth = np.concatenate([each[2] for each in every])
        changed = (size.positions != ranged.positions).any(axis=1)
        print(f"{name}: error along the ray, far off, NEES")
        for title, rows in (("with legs", changed), ("all", np.ones(len(truth), dtype=bool))):
            for kind, heads in (("size", size), ("ranges", ranged)):
                print_row(f"{title}, {kind}", type(heads)(*(each[rows] for each in heads)), truth[rows])


if __name__ == "__main__":
    main()
