"""Heads of rendered people whose distance a laser scanner tells: nearer to the truth, and as sure as they are right."""

import dataclasses

import numpy as np
import pytest

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

SAME = 0.3  # intersection over union of a head that is found
DIMENSION = 3
FIRST_S, EVERY_S, PICTURES = 1.03, 2.9, 16


class Truth(TransformSource):
    """Where the robot and its sensors really are."""

    def __init__(self, simulation):
        self.history = simulation.history
        self.mounts = {each.config.frame: each.config.base_from_camera for each in simulation.cameras}
        for each in simulation.scanners:
            x, y, yaw = each.config.mount
            self.mounts[each.config.frame] = Pose.from_xy_yaw(x, y, yaw, each.config.at[2])

    def lookup(self, target_frame, source_frame, stamp_ns):
        assert target_frame == "odom"
        x, y, yaw = self.history.at("robot", np.array([to_seconds(stamp_ns - START_NS)]))[0]
        return Pose.from_xy_yaw(x, y, yaw, BASE_HEIGHT) @ self.mounts[source_frame]


def heads(seed):
    """Positions and covariances by size and with the scanners, and the truth, of each picture's heads; level axes."""
    scenario = dataclasses.replace(load_scenario("museum_cameras"), duration_s=FIRST_S + PICTURES * EVERY_S)
    simulation = Simulation(scenario, seed)
    camera, transforms = simulation.cameras[0], Truth(simulation)
    config = parse(HeadCueConfig, {"ranges": {"scans": True}})
    cue = HeadCue(config, "camera/head", FramesConfig())
    for time_s in (FIRST_S + EVERY_S * np.arange(PICTURES)).tolist():
        stamp_ns = START_NS + from_seconds(time_s)
        for scanner in simulation.scanners:
            scan_s = np.floor(time_s * scanner.config.rate) / scanner.config.rate
            cue.note(scanner.scan(simulation.history, scan_s, START_NS + from_seconds(scan_s)))
        picture = camera.picture(simulation.history, time_s, stamp_ns)
        cue.measure(Image(stamp_ns, camera.config.frame, picture.pixels, camera.camera), transforms)
        level = transforms.lookup("odom", camera.config.frame, stamp_ns).rotation
        corners, confidences = cue.look.boxes.corners, cue.look.boxes.confidences
        holds = (overlaps(corners, picture.heads.corners) > SAME) & (picture.heads.visibility > 0.5)
        holds &= cue.look.kept[:, None]
        first = holds & (holds.cumsum(axis=0) == 1)  # boxes come with the best first
        box, head = np.nonzero(first & (first.cumsum(axis=1) == 1))
        by_size = heads_of_boxes(corners[box], camera.camera, level, config.detector.box, confidences[box])
        truth = picture.heads.positions[head] @ level.T
        yield (*by_size, cue.look.heads.positions[box], cue.look.heads.covariances[box], truth)


@pytest.mark.slow
def test_scanners_make_heads_better_and_as_sure_as_they_say():
    every = [each for seed in (7000, 7001) for each in heads(seed)]
    size, _, positions, covariances, truth = (np.concatenate(column) for column in zip(*every))
    changed = (size != positions).any(axis=1)
    assert changed.sum() > 40 and changed.mean() > 0.4
    errors = (positions - truth)[changed]
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances[changed]), errors)
    # Who looks at the robot is found better than all others, whom the errors of boxes allow for (docs/cameras.md).
    assert 0.3 * DIMENSION < nees.mean() < 2.0 * DIMENSION
    by_size, by_legs = (np.hypot(*(each - truth)[changed, :2].T) for each in (size, positions))
    assert np.sqrt((by_legs**2).mean()) < 0.75 * np.sqrt((by_size**2).mean())
