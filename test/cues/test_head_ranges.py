"""Heads' distances by the legs that a laser scanner sees below them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from camera_scenes import SECOND, Ideal, ToldConfig, boxes_of, image, tilted
from hypothesis import given, settings
from hypothesis import strategies as st
from leg_scenes import scan_of, scan_with

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError, DataError, TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.heads.boxes import BoxConfig, Boxes
from people_fusion.cues.heads.heads import HeadCue, HeadCueConfig
from people_fusion.cues.heads.people import Heads, heads_of_boxes
from people_fusion.cues.heads.ranges import KEPT, Pieces, Ranges, RangesConfig, over_legs, pieces

HEIGHT, LASER, NOW = 1.67, 0.385, 5 * SECOND
FACE = BoxConfig(height=0.19)
CONFIG = RangesConfig(scans=True)
CAMERA = Ideal()

places = st.tuples(st.floats(0.8, 6.0), st.floats(-0.4, 0.4))
pieces_of = st.lists(st.tuples(st.floats(-8.0, 8.0), st.floats(-8.0, 8.0), st.floats(0.0, 0.2)), max_size=12)


class Robot(TransformSource):
    """A camera and scanners on a robot, which may drive and may not know where a scanner is."""

    def __init__(self, speed=0.0):
        self.speed = speed

    def lookup(self, target_frame, source_frame, stamp_ns):
        assert target_frame == "odom"
        mounts = {
            "camera": Pose(tilted(5.0), np.array([0.0, 0.0, HEIGHT])),
            "laser": Pose(np.eye(3), np.array([0.1, 0.0, LASER])),
            "rear": Pose.from_xy_yaw(-0.2, 0.0, math.pi, LASER),
        }
        if source_frame not in mounts:
            raise TransformUnavailable(f"{source_frame} is not known", may_arrive=True)
        return Pose.from_xy_yaw(self.speed * (stamp_ns - NOW) / SECOND, 0.0, 0.0) @ mounts[source_frame]


def seen_heads(*found):
    """By size, in level axes, from distance, bearing and how wrong the distance is, in standard deviations."""
    heads = np.array([[d * np.cos(b), d * np.sin(b), -0.1] for d, b in found]).reshape(-1, 3)
    rotation = tilted(0.0)
    return heads_of_boxes(boxes_of(heads, CAMERA, rotation, FACE), CAMERA, rotation, FACE)


def legs_of(*rows):
    rows = np.array(rows, dtype=float).reshape(-1, 3)
    return Pieces(rows[:, :2], rows[:, 2])


def scan(distance, bearing=0.0, stamp_ns=NOW, frame_id="laser", speed_m=0.0):
    """Both legs of one who stands so far from the camera, in a hall, from the scanner 10 cm before the camera."""
    middle = distance * np.array([np.cos(bearing), np.sin(bearing)]) - [0.1 + speed_m, 0.0]
    across = np.array([-np.sin(bearing), np.cos(bearing)])
    legs = np.array([middle + 0.1 * across, middle - 0.1 * across])
    return dataclasses.replace(scan_of(legs, room=9.0), stamp_ns=stamp_ns, frame_id=frame_id)


def told(head, size=1.0, height=1.6):
    """Cue that finds one head, which is taken for so much farther than it is."""
    place = np.array([[head[0] * np.cos(head[1]), head[0] * np.sin(head[1]), height - HEIGHT]])
    corners = boxes_of(place, CAMERA, tilted(5.0), FACE, np.array([FACE.height / size]))
    config = HeadCueConfig(ToldConfig(FACE), ranges=CONFIG)
    cue = HeadCue(config, "camera/told", FramesConfig())
    cue._detector.boxes = Boxes(corners, np.ones(1), np.full(1, 0.9))
    return cue


def horizontal(measurement):
    """Distance of the only head from the camera, and its standard deviation, along the floor."""
    rotation = tilted(5.0)
    (position,), (covariance,) = measurement.positions @ rotation.T, rotation @ measurement.covariances @ rotation.T
    flat = np.hypot(*position[:2])
    ahead = position[:2] / flat
    return flat, np.sqrt(ahead @ covariance[:2, :2] @ ahead)


def test_scanners_are_asked_only_where_that_is_wanted():
    assert told((3.0, 0.0)).notes == (Scan,)
    assert HeadCue(HeadCueConfig(), "camera/head", FramesConfig()).notes == ()
    with pytest.raises(ConfigError, match="ranges"):
        parse(HeadCueConfig, {"ranges": {"widths": [0.5, 0.1]}})


@pytest.mark.parametrize("size", [0.85, 1.0, 1.2])
def test_distance_lies_between_size_and_legs_and_is_surer_than_either(size):
    cue = told((3.0, 0.2), size)
    by_size, size_std = horizontal(cue.measure(image(), Robot()))
    cue.note(scan(3.0, 0.2))
    distance, std = horizontal(cue.measure(image(), Robot()))
    weight = CONFIG.std**-2 / (CONFIG.std**-2 + size_std**-2)
    assert distance == pytest.approx(weight * 3.0 + (1.0 - weight) * by_size, abs=0.03)
    assert std == pytest.approx((CONFIG.std**-2 + size_std**-2) ** -0.5, rel=1e-3)


def test_scan_of_before_is_seen_from_where_the_robot_was():
    speed, age_s = 1.0, 0.15
    cue = told((3.0, 0.0), 1.15)
    cue.note(scan(3.0, stamp_ns=NOW - int(age_s * SECOND), speed_m=-speed * age_s))
    distance, std = horizontal(cue.measure(image(), Robot(speed)))
    fresh = told((3.0, 0.0), 1.15)
    fresh.note(scan(3.0))
    expected, surer = horizontal(fresh.measure(image(), Robot(speed)))
    assert distance == pytest.approx(expected, abs=0.1) and std > surer


def test_scans_that_are_newer_too_old_unplaced_or_of_before_a_jump_change_nothing():
    for noted in (
        scan(3.0, stamp_ns=NOW + 1),
        scan(3.0, stamp_ns=NOW - int(0.21 * SECOND)),
        scan(3.0, frame_id="nobody knows"),
    ):
        cue = told((3.0, 0.0), 1.15)
        alone = horizontal(cue.measure(image(), Robot()))
        cue.note(noted)
        assert horizontal(cue.measure(image(), Robot())) == alone
        cue.note(scan(3.0))
        assert horizontal(cue.measure(image(), Robot())) != alone
        cue.reset()
        assert horizontal(cue.measure(image(), Robot())) == alone


def test_the_newest_scan_of_each_scanner_counts_however_many_came_since_the_image():
    cue = told((3.0, 0.0), 1.15)
    cue.note(scan(2.9, stamp_ns=NOW - SECOND // 10))
    cue.note(scan(3.0, stamp_ns=NOW - SECOND // 100))
    expected = horizontal(cue.measure(image(), Robot()))
    late = told((3.0, 0.0), 1.15)
    late.note(scan(3.0, stamp_ns=NOW - SECOND // 100))
    assert horizontal(late.measure(image(), Robot())) == expected
    for number in range(KEPT - 2):
        cue.note(scan(2.9, stamp_ns=NOW + number + 1))
    assert horizontal(cue.measure(image(), Robot())) == expected


def test_who_sits_has_the_legs_elsewhere():
    sitting = told((3.0, 0.0), 1.15, height=1.2)
    alone = horizontal(sitting.measure(image(), Robot()))
    sitting.note(scan(3.0))
    assert horizontal(sitting.measure(image(), Robot())) == alone


def test_unusable_scan_is_refused_and_does_no_harm():
    ranges = Ranges(CONFIG)
    with pytest.raises(DataError):
        ranges.note(scan_with([]))
    cue = told((3.0, 0.0))
    for ranges in ([np.nan] * 50, [np.inf] * 50, [1.0], [1e-9] * 100):
        cue.note(dataclasses.replace(scan_with(ranges), stamp_ns=NOW, frame_id="laser"))
        assert np.isfinite(horizontal(cue.measure(image(), Robot()))).all()


def test_legs_are_pieces_walls_and_what_is_seen_of_them_between_people_are_not():
    found = pieces(scan_of(np.array([[3.0, 0.1], [3.0, -0.1]]), room=9.0), CONFIG)
    assert len(found) == 2
    assert np.allclose(np.abs(found), [3.0, 0.1], atol=0.02)  # the middles of the legs, not what the beams hit
    wall = np.full(541, 4.0)
    wall[200:210] = wall[230:240] = 2.0  # two pillars before it, 17 cm wide; between them 1.4 m of wall
    wall[216:224] = 2.5  # and one between
    assert len(pieces(scan_with(wall, angle_increment=math.radians(0.5)), CONFIG)) == 3
    gap = np.full(541, 4.0)
    gap[200:215] = gap[218:233] = 1.5  # between these 10 cm of the wall can be seen
    assert np.allclose(
        np.hypot(*pieces(scan_with(gap, angle_increment=math.radians(0.5)), CONFIG).T), 1.5 + 0.25 * np.pi * 0.06,
        atol=0.01,
    )  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(st.lists(places, min_size=1, max_size=4), pieces_of)
def test_no_head_is_less_sure_than_by_its_size_and_none_leaves_its_direction(found, legs):
    heads = seen_heads(*found)
    after = over_legs(heads, legs_of(*legs), np.ones(len(found), dtype=bool), CONFIG)
    gained = heads.covariances - after.covariances
    assert (np.linalg.eigvalsh(gained) >= -1e-12).all()
    assert (np.linalg.eigvalsh(after.covariances) > 0.0).all()
    assert np.allclose(np.cross(heads.positions[:, :2], after.positions[:, :2]), 0.0, atol=1e-9)
    moved = after.positions[:, :2] - heads.positions[:, :2]
    stds = np.sqrt(np.trace(heads.covariances[:, :2, :2], axis1=1, axis2=2))
    assert (np.hypot(*moved.T) <= CONFIG.gate * stds + 1e-9).all()


@settings(max_examples=200, deadline=None)
@given(st.lists(places, min_size=1, max_size=4), pieces_of, st.randoms(use_true_random=False))
def test_the_order_of_pieces_and_of_heads_does_not_matter(found, legs, shuffler):
    heads, wanted = seen_heads(*found), np.ones(len(found), dtype=bool)
    rows, order = list(range(len(found))), list(legs)
    shuffler.shuffle(order)
    shuffler.shuffle(rows)
    first = over_legs(heads, legs_of(*legs), wanted, CONFIG)
    second = over_legs(Heads(*(each[rows] for each in heads)), legs_of(*order), wanted, CONFIG)
    assert np.allclose(first.positions[rows], second.positions)
    assert np.allclose(first.covariances[rows], second.covariances)


@settings(max_examples=200, deadline=None)
@given(places, st.floats(0.8, 7.5), st.floats(-1.0, 1.0))
def test_pieces_outside_the_gate_or_beside_the_person_change_nothing(head, along, aside):
    heads = seen_heads(head)
    ahead = np.array([np.cos(head[1]), np.sin(head[1])])
    there = along * ahead + aside * np.array([-ahead[1], ahead[0]])
    std = head[0] * FACE.height_std / FACE.height
    flat = np.hypot(*heads.positions[0, :2])
    inside = abs(aside) < CONFIG.half_width and abs(along - flat) < CONFIG.gate * np.hypot(std, CONFIG.std)
    near_edge = abs(abs(aside) - CONFIG.half_width) < 1e-6
    near_edge |= abs(abs(along - flat) - CONFIG.gate * np.hypot(std, CONFIG.std)) < 0.02
    after = over_legs(heads, legs_of((*there, 0.0)), np.ones(1, dtype=bool), CONFIG)
    assert near_edge or (np.array_equal(after.covariances, heads.covariances) != inside)


def test_something_behind_the_legs_is_a_doubt_and_size_alone_counts():
    heads, wanted = seen_heads((5.0, 0.0)), np.ones(1, dtype=bool)
    legs, behind = (4.8, 0.1, 0.0), (5.8, -0.1, 0.0)
    alone = over_legs(heads, legs_of(legs), wanted, CONFIG)
    both = over_legs(heads, legs_of(legs, behind), wanted, CONFIG)
    assert not np.array_equal(alone.positions, heads.positions)
    assert np.array_equal(both.positions, heads.positions) and np.array_equal(both.covariances, heads.covariances)


def test_legs_are_those_of_the_head_they_fit_better():
    heads = seen_heads((3.0, 0.0), (4.0, 0.0))
    after = over_legs(heads, legs_of((3.1, 0.0, 0.0)), np.ones(2, dtype=bool), CONFIG)
    assert after.positions[0, 0] > heads.positions[0, 0]
    assert np.array_equal(after.positions[1], heads.positions[1])
    nobody = over_legs(heads, legs_of((3.1, 0.0, 0.0)), np.array([False, False]), CONFIG)
    assert np.array_equal(nobody.positions, heads.positions)


def test_covariance_is_that_of_people_who_stride_and_scanners_that_are_late():
    rng, count = np.random.default_rng(4), 3000
    truth, age_s, rotation = np.array([[4.0, 1.0, -0.1]]), 0.1, tilted(0.0)
    ahead = truth[0, :2] / np.hypot(*truth[0, :2])
    aside = np.array([-ahead[1], ahead[0], 0.0])
    values = []
    for _ in range(count):
        middle = truth + rng.normal(0.0, FACE.across_std) * aside
        middle[:, 2] += rng.normal(0.0, FACE.head_above_std)
        height = np.array([rng.normal(FACE.height, FACE.height_std)])
        heads = heads_of_boxes(boxes_of(middle, CAMERA, rotation, FACE, height), CAMERA, rotation, FACE)
        legs = truth[0, :2] + rng.normal(0.0, np.hypot(CONFIG.std, age_s)) * ahead
        after = over_legs(heads, legs_of((*legs, age_s)), np.ones(1, dtype=bool), CONFIG)
        error = (after.positions - truth)[0]
        values.append(error @ np.linalg.solve(after.covariances[0], error))
    assert 2.7 < np.mean(values) < 3.5
