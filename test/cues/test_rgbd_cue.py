"""People in depth images."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from camera_scenes import Ideal
from depth_scenes import TABLE, Box, Drawn, Person, Stand, image_of, pose_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from people_fusion.core.depth_images import DepthImage
from people_fusion.core.errors import ConfigError, DataError, TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import FramesConfig, UncertainTransform
from people_fusion.cues.heads.boxes import Boxes
from people_fusion.cues.heads.detectors.fhog_head import FhogHeadConfig
from people_fusion.cues.heads.detectors.haar import HaarFaceConfig
from people_fusion.cues.rgbd.rgbd import RgbdCue, RgbdCueConfig
from people_fusion.cues.rgbd.sensors import SENSORS
from people_fusion.simulation.rendering_people import draw_looks
from people_fusion.tracking.fusion import place

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
            Box((2.0, 0.1, 0.4), (2.1, 0.6, 1.0)),
        ],
    ),
}
POSES = {"level": pose_of(1.5, 3.0), "high": pose_of(1.67, 12.0), "elsewhere": pose_of(1.4, 5.0, 0.2, -0.4, 0.3)}


@pytest.mark.parametrize("pose", POSES.values(), ids=POSES.keys())
@pytest.mark.parametrize(("people", "boxes"), SCENES.values(), ids=SCENES.keys())
def test_each_person_is_found_once(people, boxes, pose):
    assert_found(people, seen(people, boxes, pose)[1])


@pytest.mark.parametrize("y", [-0.48, 0.0, 0.48])
def test_heads_just_below_the_upper_edge_are_found_and_in_the_corners_too(y):
    person = Person(1.2, y, 1.78)
    pose = pose_of(1.35, 0.0)
    row = Ideal().project(pose.inverse().apply(np.array([[1.12, y, person.height]])))[0, 1]
    assert 0.0 < row < 45.0
    assert_found([person], seen([person], pose=pose)[1])


@pytest.mark.parametrize("cut", [0.03, 0.06])
def test_how_much_the_upper_edge_cuts_off_is_doubt_about_the_height(cut):
    pose = pose_of(1.35, 0.0)
    ray = Ideal().rays(np.array([[320.0, 0.0]]))[0]
    person = Person(1.4, 0.0, 1.35 - 1.32 * ray[1] / ray[2] + cut)
    measurement, positions = seen([person], pose=pose)
    assert_found([person], positions, within=0.12)
    whole, _ = seen([Person(1.4, 0.0, 1.7)], pose=pose)
    assert measurement.covariances[0, 1, 1] > whole.covariances[0, 1, 1] + 0.04**2  # y of the camera points down
    assert measurement.bodies.height_stds[0] > 0.045 > whole.bodies.height_stds[0]
    error = measurement.positions[0] - pose.inverse().apply(person.head[None])[0]
    assert error @ np.linalg.solve(measurement.covariances[0], error) < 9.0


def test_covariances_are_true_of_people_who_differ():
    rng = np.random.default_rng(3)
    squares, missed = [], 0
    for seed in range(40):
        distance, bearing = rng.uniform(1.2, 5.0), rng.uniform(-0.35, 0.35)
        sits = rng.random() < 0.35
        height = rng.normal(1.17, 0.05) if sits else rng.normal(1.6, 0.08)
        head = np.array([distance * np.cos(bearing), distance * np.sin(bearing), height])
        person = Drawn(head, rng.uniform(-np.pi, np.pi), sits, draw_looks(1, rng)[0])
        pose = pose_of(rng.uniform(1.4, 1.8), rng.uniform(3.0, 8.0))
        measurement, positions = seen([person], pose=pose, seed=seed)
        errors = (positions - person.head) @ pose.rotation
        near = np.linalg.norm(errors, axis=1) < 0.3
        missed += not near.any()
        squares += [e @ np.linalg.solve(P, e) for e, P in zip(errors[near], measurement.covariances[near])]
    assert missed <= 1
    assert 0.5 * 3 < np.mean(squares) < 2.0 * 3


def test_depth_is_less_sure_far_away():
    near, _ = seen([Person(1.5, 0.0)])
    far, _ = seen([Person(5.0, 0.0)])
    assert far.covariances[0, 2, 2] > 1.5 * near.covariances[0, 2, 2]  # z is along the view


def test_heights_and_postures_are_told():
    people = [Person(2.5, 0.8, 1.8), Person(2.6, -0.5, 1.25, sits=True)]
    measurement, positions = seen(people)
    bodies = measurement.bodies
    standing = np.argmax(positions[:, 2])
    assert bodies.heights[standing] == pytest.approx(1.8, abs=3.0 * bodies.height_stds[standing])
    assert bodies.heights[1 - standing] == pytest.approx(1.25, abs=3.0 * bodies.height_stds[1 - standing])
    assert bodies.sitting[standing] < 0.05 < 0.95 < bodies.sitting[1 - standing]


@pytest.mark.parametrize(("lift", "down"), [(0.08, 0.0), (-0.08, 0.0), (0.0, 2.5), (0.05, -2.0)])
def test_the_floor_that_is_seen_corrects_the_transform(lift, down):
    pose, person = pose_of(1.5, 10.0), Person(3.0, 0.2, 1.75)
    cue = cue_of()
    measurement, _ = seen([person], pose=pose, believed=pose_of(1.5 + lift, 10.0 + down), cue=cue)
    assert len(measurement) == 1
    assert measurement.bodies.heights[0] == pytest.approx(1.75, abs=0.05)
    assert np.degrees(abs(cue.look.floor.plane[1])) == pytest.approx(abs(down), abs=0.7)
    true = (person.head - pose.translation) @ pose.rotation  # where it is seen does not depend on the floor ...
    assert np.linalg.norm(measurement.positions[0] - true) < 0.08
    right, _ = seen([person], pose=pose)
    up = pose.rotation[2]  # ... but where that is in the world does
    assert up @ measurement.covariances[0] @ up > up @ right.covariances[0] @ up


def test_without_floor_the_transform_holds():
    pose = pose_of(1.5, -15.0)
    cue = cue_of()
    seen([Person(2.0, 0.0, 1.8)], pose=pose, cue=cue)
    assert not cue.look.floor.plane.any() and np.isnan(cue.look.floor.seen)


def test_a_floor_that_is_quite_wrong_is_told_and_finds_nobody_where_nobody_is():
    cue = cue_of()
    measurement, _ = seen([Person(3.0, 0.2)], pose=pose_of(1.5, 10.0), believed=pose_of(0.7, 10.0), cue=cue)
    assert len(measurement) <= 1
    assert np.isfinite(measurement.positions).all()


def tilted_images():
    for down in (-40.0, -20.0, 30.0, 60.0, 90.0):
        pose = pose_of(1.6, down)
        yield pytest.param(pose, id=f"{down} degrees down")


@pytest.mark.parametrize("pose", tilted_images())
def test_tilted_cameras_see_whom_they_can(pose):
    measurement, positions = seen([Person(1.8, 0.0, 1.7)], pose=pose)
    assert len(measurement) <= 1
    assert all(np.linalg.norm(position - Person(1.8, 0.0, 1.7).head) < 0.1 for position in positions)


def test_images_without_returns_tell_of_nobody_and_of_no_free_space():
    for value in (np.nan, 0.0, np.inf, -1.0):
        image = image_of(pose_of())
        image.depths[:] = value
        measurement = cue_of().measure(image, Stand(pose_of()))
        assert len(measurement) == 0 and np.isnan(measurement.sight.ranges).all()
        assert measurement.bodies.heights.shape == (0,)


def test_images_may_change_their_size():
    cue, people, pose = cue_of(), [Person(2.5, 0.3)], pose_of(1.5, 5.0)
    for width, height, focal in (
        (640, 480, 525.0),
        (320, 240, 262.5),
        (1280, 720, 900.0),
        (512, 424, 365.0),
        (64, 48, 52.5),
        (640, 480, 525.0),
    ):
        _, positions = seen(people, pose=pose, cue=cue, camera=Ideal(width, height, focal))
        assert_found(people if width > 64 else people[: len(positions)], positions)


def test_image_that_is_not_its_cameras_is_refused():
    image = image_of(pose_of())
    with pytest.raises(DataError, match="size"):
        cue_of().measure(dataclasses.replace(image, depths=image.depths[::2]), Stand(pose_of()))


def test_without_transforms_nothing_is_told():
    with pytest.raises(TransformUnavailable):
        cue_of().measure(image_of(pose_of()), None)


def test_image_is_not_written_to():
    image = image_of(pose_of(), [Person(2.0, 0.0)])
    before = image.depths.copy()
    image.depths.setflags(write=False)
    cue_of().measure(image, Stand(pose_of()))
    assert np.array_equal(image.depths, before, equal_nan=True)


def test_same_image_gives_the_same_people():
    image, cue = image_of(pose_of(), [Person(2.0, 0.0), Person(3.0, 1.0)]), cue_of()
    first, second = (cue.measure(image, Stand(pose_of())) for _ in range(2))
    assert np.array_equal(first.positions, second.positions) and np.array_equal(first.covariances, second.covariances)
    assert second.sequence == first.sequence + 1


@pytest.mark.parametrize("yaw", [0.0, 2.0])
def test_free_space_speaks_against_who_is_not_there_only(yaw):
    pose = pose_of(1.5, 8.0, yaw, 0.5, -0.3)
    heading = np.array([np.cos(yaw), np.sin(yaw)])
    aside = np.array([-heading[1], heading[0]])
    places = [
        3.0 * heading + 0.8 * aside,
        3.0 * heading - 0.8 * aside,
        -2.0 * heading,
        2.0 * heading + 5.0 * aside,
        7.0 * heading,
    ]
    places = np.array(places) + pose.translation[:2]
    there = Person(*places[0], 1.75)
    walls = [Box((x, -6.0, 0.0), (x + 0.1, 6.0, 3.0)) for x in (-6.0, 6.0)]
    walls += [Box((-6.0, y, 0.0), (6.0, y + 0.1, 3.0)) for y in (-6.0, 6.0)]
    measurement, _ = seen([there], walls, pose, wall=None)
    placed = place(measurement, UncertainTransform(pose, np.zeros((6, 6)), np.zeros((6, 6))), "odom", "none")
    ghosts = placed.sight.visible(places, 0.2)
    assert ghosts[1] > 0.9
    assert ghosts[0] < 0.3  # beside an arm it sees through
    assert not ghosts[2:].any()


def test_nobody_behind_a_cupboard_is_missed():
    pose = pose_of(1.5, 3.0)
    measurement, _ = seen([], [Box((2.0, -1.5, 0.0), (2.4, 1.5, 1.9))], pose=pose)
    placed = place(measurement, UncertainTransform(pose, np.zeros((6, 6)), np.zeros((6, 6))), "odom", "none")
    seen_through = placed.sight.visible(np.array([[3.0, 0.0], [1.4, 0.0]]), 0.2)
    assert seen_through[0] == 0.0 and seen_through[1] > 0.9


@pytest.mark.parametrize("sensor", sorted(SENSORS))
def test_every_sensor_finds_people(sensor):
    assert_found([Person(2.5, 0.0)], seen([Person(2.5, 0.0)], cue=cue_of(sensor=sensor))[1])


@settings(max_examples=25, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 90), st.integers(1, 120)),
    height=st.floats(-1.0, 3.0),
    down=st.floats(-90.0, 90.0),
    roll=st.floats(-180.0, 180.0),
    seed=st.integers(0, 1000),
)
def test_whatever_is_seen_the_measurement_is_whole(shape, height, down, roll, seed):
    rng = np.random.default_rng(seed)
    depths = rng.uniform(0.2, 9.0, shape).astype(np.float32)
    depths[rng.random(shape) < rng.random()] = np.nan
    turned = Rotation.from_euler("x", roll, degrees=True).as_matrix()
    pose = Pose(turned @ pose_of(0.0, down).rotation, np.array([0.0, 0.0, height]))
    camera = Ideal(shape[1], shape[0], 0.8 * max(shape))
    found = cue_of(min_confidence=0.0).measure(DepthImage(0, "depth", depths, camera), Stand(pose))
    assert found.positions.shape == (len(found), 3)
    assert np.isfinite(found.positions).all() and np.isfinite(found.covariances).all()
    assert (np.linalg.eigvalsh(found.covariances) > 0.0).all()
    assert ((found.confidences > 0.0) & (found.confidences <= 1.0)).all()
    assert not (found.sight.ranges > found.sight.range_max).any()


@pytest.mark.parametrize("name", ["head_heights", "head_width", "shoulder_width"])
def test_limits_that_are_none_are_refused(name):
    with pytest.raises(ConfigError, match=name):
        RgbdCueConfig(**{name: (1.0, 0.5)})


class Told:
    """A detector of heads that finds what it was told."""

    part = "head"
    box = FhogHeadConfig().box

    def __init__(self, *corners):
        self.corners = np.array(corners, dtype=float).reshape(-1, 4)

    def detect(self, image, search):  # noqa: ARG002
        return Boxes(self.corners, np.ones(len(self.corners)), np.full(len(self.corners), 0.8))


BENT = Person(2.2, 0.0, 1.5, bends=0.25)


def bent_with(rows=1.0, aside=0.0):
    """Whoever bends, and a box about his head `rows` times as high as heads are, `aside` pixels from it."""
    pose = pose_of(1.5, 5.0)
    image = dataclasses.replace(image_of(pose, [BENT], wall=5.5), colour=np.zeros((480, 640, 3), dtype=np.uint8))
    local = (BENT.head - pose.translation) @ pose.rotation
    middle, lower = image.camera.project(np.stack([local, local + [0.0, 0.24, 0.0]]))
    half = 0.5 * rows * np.linalg.norm(lower - middle)
    middle = middle + [aside, 0.0]
    return pose, image, Told([*(middle - half), *(middle + half)])


def found_with(pose, image, detector):
    cue = cue_of(colour=True)
    cue._detector = detector
    return cue.measure(image, Stand(pose))


def test_who_bends_is_found_by_colour():
    pose, image, detector = bent_with()
    assert len(cue_of().measure(image, Stand(pose))) == 0
    found = found_with(pose, image, detector)
    assert len(found) == 1 and found.confidences[0] == pytest.approx(0.8)
    assert np.linalg.norm(pose.apply(found.positions)[0] - BENT.head) < 0.08


@pytest.mark.parametrize(("rows", "aside"), [(0.5, 0.0), (1.8, 0.0), (1.0, 150.0)])
def test_what_colour_shows_is_as_large_as_a_head_at_its_depth(rows, aside):
    assert len(found_with(*bent_with(rows, aside))) == 0


def test_without_depth_colour_shows_nobody():
    pose, image, detector = bent_with()
    image.depths[:] = np.nan
    assert len(found_with(pose, image, detector)) == 0


def test_colour_changes_nothing_of_whom_depth_finds():
    pose, people = pose_of(1.5, 3.0), [Person(2.5, 0.3)]
    image = image_of(pose, people)
    alone = cue_of().measure(image, Stand(pose))
    image = dataclasses.replace(image, colour=np.zeros((480, 640, 3), dtype=np.uint8))
    found = found_with(pose, image, Told([300, 100, 340, 150]))
    assert np.array_equal(found.positions, alone.positions)
    assert np.array_equal(found.confidences, alone.confidences)


def test_a_detector_of_faces_is_refused():
    with pytest.raises(ConfigError, match="face"):
        cue_of(colour=True, detector=HaarFaceConfig())
