"""People in depth images."""

from __future__ import annotations

import numpy as np
import pytest
from depth_scenes import TABLE, Box, Person, Stand, image_of, pose_of

from people_fusion.core.transforms import FramesConfig
from people_fusion.cues.rgbd.rgbd import RgbdCue, RgbdCueConfig

KINECT = 1.4e-3  # noise, 1/m


def cue_of(**config):
    return RgbdCue(RgbdCueConfig(**config), name="kinect", frames=FramesConfig())


def seen(people, boxes=(), pose=None, believed=None, cue=None, seed=1, **scene):
    """Measurement, and its positions in the world."""
    pose = pose or pose_of(1.5, 5.0)
    image = image_of(pose, people, boxes, noise=KINECT, rng=np.random.default_rng(seed), **scene)
    measurement = (cue or cue_of()).measure(image, Stand(believed or pose))
    return measurement, pose.apply(measurement.positions)


def assert_found(people, positions, within=0.08):
    """Each once, and nobody else."""
    assert len(positions) == len(people)
    for person in people:
        assert np.linalg.norm(positions - person.head, axis=1).min() < within, person


SCENES = {
    "one who stands": ([Person(2.5, 0.3)], ()),
    "seen from the side": ([Person(2.5, 0.3, 1.7, np.pi / 2)], ()),
    "seen from behind": ([Person(3.5, -0.3, 1.9, 0.0)], ()),
    "three": ([Person(1.3, -0.2, 1.6, 0.5), Person(3.0, 0.9, 1.85, 1.5), Person(4.2, 0.2, 1.7, 3.0)], ()),
    "two who touch": ([Person(2.5, 0.25, 1.75), Person(2.5, -0.25, 1.72)], ()),
    "one before the other": ([Person(2.0, 0.15, 1.6), Person(2.5, -0.2, 1.8)], ()),
    "one who sits": ([Person(2.5, 0.3, 1.28, sits=True)], ()),
    "two who sit behind a table": ([Person(2.5, 0.4, 1.28, sits=True), Person(2.6, -0.5, 1.22, sits=True)], [TABLE]),
    "a child": ([Person(2.2, 0.0, 1.05)], ()),
    "who leans at a wall": ([Person(3.0, 0.0, 1.75)], [Box((3.22, -2.0, 0.0), (3.4, 2.0, 2.6))]),
    "nobody": ([], ()),
    "nobody, but furniture": (
        [],
        [
            TABLE,
            Box((2.5, -1.5, 0.0), (3.0, -1.0, 1.7)),
            Box((2.6, 0.6, 0.0), (2.8, 0.8, 1.4)),
            Box((2, 1, 0.4), (2.1, 1.5, 1)),
        ],
    ),
}
POSES = {"level": pose_of(1.5, 3.0), "high": pose_of(1.67, 12.0), "elsewhere": pose_of(1.4, 5.0, 0.2, -0.4, 0.3)}


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES.keys())
@pytest.mark.parametrize(("people", "boxes"), SCENES.values(), ids=SCENES.keys())
def test_each_person_is_found_once(people, boxes, pose):
    assert_found(people, seen(people, boxes, pose)[1])
