"""People found by their legs in hand-made scans."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from leg_scenes import LEG_RADIUS, SECOND, Motion, scan_in_motion, scan_of, scan_with

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError, DataError, TransformUnavailable
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose
from people_fusion.core.stamps import from_seconds
from people_fusion.core.transforms import FramesConfig
from people_fusion.cues.legs.legs import ARC_DEPTH, LegCue, LegCueConfig

WITHOUT_MAP = {"max_segment_width": 0.5, "min_segment_step": 0.1, "segment_gap_beams": 2.5}


def cue(**parameters):
    return LegCue(LegCueConfig(**parameters), name="scan", frames=FramesConfig())


def seen(legs, room=None, **parameters):
    return cue(**parameters).measure(scan_of(legs, room), None)


def person(x, y, half_step=0.15):
    return [(x, y - half_step), (x, y + half_step)]


def nearest(positions, place):
    return np.hypot(*(np.atleast_2d(positions)[:, :2] - place).T).min()


def test_person_is_between_the_legs():
    found = seen(person(2.0, 0.5), leg_radius=LEG_RADIUS)
    assert len(found) == 1 and len(found.legs) == 2
    assert nearest(found.positions, (2.0, 0.5)) < 0.01
    assert found.positions[0, 2] == 0.0 and found.observed == (True, True, False)


def test_without_correction_legs_are_on_their_near_side():
    found = seen([(2.0, 0.0)])
    assert found.positions[0, 0] == pytest.approx(2.0 - ARC_DEPTH * LEG_RADIUS, abs=0.01)


def test_single_leg_is_a_person_of_less_certainty():
    pair, single = seen(person(2.0, 0.0)), seen([(2.0, 0.0)], single_confidence=0.6)
    assert len(single) == 1 and single.confidences.tolist() == [0.6] and pair.confidences.tolist() == [1.0]
    assert np.linalg.det(single.covariances[0, :2, :2]) > np.linalg.det(pair.covariances[0, :2, :2])


def test_hidden_leg_leaves_the_other_one():
    found = seen([(2.0, 0.0), (2.3, 0.0)])
    assert len(found) == 1 and len(found.legs) == 1


def test_single_leg_is_least_certain_along_the_beam():
    beam = np.array([math.cos(0.8), math.sin(0.8)])
    covariance = seen([2.0 * beam]).covariances[0, :2, :2]
    assert beam @ covariance @ beam == pytest.approx(0.15**2, rel=1e-3)
    assert covariance[0, 1] > 0.0


def test_people_apart_are_people_of_two_groups():
    found = seen(person(2.0, 1.0) + person(2.0, -1.0))
    assert len(found) == 2
    assert max(nearest(found.positions, (2.0, 1.0)), nearest(found.positions, (2.0, -1.0))) < 0.06
    assert found.covariances[0, 0, 0] == pytest.approx(0.08**2, rel=0.05)


def test_people_of_one_group_are_less_certain():
    found = seen(person(2.0, 0.35, 0.12) + person(2.0, -0.35, 0.12))
    assert len(found) == 2
    assert found.covariances[0, 0, 0] == pytest.approx((2.0 * 0.08) ** 2, rel=0.05)


def test_nearest_legs_are_paired_first():
    found = seen([(2.0, 0.0), (2.0, 0.3), (2.0, 0.85)])
    assert len(found) == 2
    assert sorted(np.bincount(found.leg_owners).tolist()) == [1, 2]
    assert nearest(found.positions, (1.95, 0.15)) < 0.02


def test_legs_farther_apart_than_a_step_are_two_people():
    assert len(seen([(2.0, -0.4), (2.0, 0.4)], group_gap=1.0)) == 2
    assert len(seen([(2.0, -0.33), (2.0, 0.33)], group_gap=1.0)) == 1


def test_legs_of_different_groups_are_never_paired():
    assert len(seen([(2.0, -0.37), (2.0, 0.37)], pair_distance=0.9)) == 2  # 62 cm between their points


def test_lone_point_is_noise():
    ranges = np.full(101, np.inf)
    ranges[[20, 60, 61, 62]] = 2.0
    found = cue().measure(scan_with(ranges), None)
    assert len(found) == 1 and len(found.points) == 3


def test_scan_of_nothing_sees_nobody_and_says_how_far():
    found = cue().measure(scan_with([np.inf] * 100, angle_increment=0.005), None)
    assert len(found) == 0 and found.covariances.shape == (0, 3, 3)
    assert found.sight.range_max == pytest.approx(10.0)  # 5 cm between beams
    assert np.array_equal(found.sight.ranges, np.full(100, found.sight.range_max))


def test_sight_has_no_information_where_ranges_have_none():
    found = cue().measure(scan_with([np.nan, 0.0, 2.0, np.inf, -np.inf]), None)
    assert found.sight.ranges == pytest.approx([np.nan, np.nan, 2.0, 5.0, 0.0], nan_ok=True)


def test_points_belong_to_legs_and_legs_to_people():
    found = seen(person(2.0, 1.0) + person(3.0, -1.0) + [(0.5, 2.5)])
    assert len(found.points) == len(found.point_labels) and found.point_labels.max() + 1 == len(found.legs) == 5
    for leg, centre in enumerate(found.legs):
        assert np.allclose(found.points[found.point_labels == leg].mean(axis=0), centre)
    for index, position in enumerate(found.positions):
        assert np.allclose(found.legs[found.leg_owners == index].mean(axis=0), position[:2])


def test_walls_are_taken_for_legs_by_the_paper_without_a_map_and_not_by_the_limits():
    legs = person(2.0, 0.5) + person(-1.0, 2.0)
    assert len(seen(legs, room=4.0)) > 20
    found = seen(legs, room=4.0, **WITHOUT_MAP)
    assert len(found) == 2
    assert max(nearest(found.positions, (2.0, 0.5)), nearest(found.positions, (-1.0, 2.0))) < 0.1


def test_far_legs_are_seen_where_the_gap_follows_the_beams():
    legs = person(8.0, 0.0)
    assert len(seen(legs)) == 0
    found = seen(legs, segment_gap_beams=1.5)
    assert len(found) == 1
    assert found.sight.range_max < 8.0  # may be seen, but a miss would say nothing


def test_lost_beam_does_not_part_a_leg_where_the_gap_follows_the_beams():
    ranges = np.full(101, np.inf)
    ranges[[50, 52]] = 5.0
    assert len(cue(segment_gap_beams=2.5).measure(scan_with(ranges), None)) == 1
    assert len(cue(segment_gap_beams=1.5).measure(scan_with(ranges), None)) == 0


def room_map(room=4.0, resolution=0.05, frame="map"):
    cells = round(2.0 * (room + 0.5) / resolution)
    centres = (np.arange(cells) + 0.5) * resolution - room - 0.5
    distance = np.maximum(abs(centres)[None, :], abs(centres)[:, None])
    occupancy = np.where(abs(distance - room) < resolution, 100, 0).astype(np.int8)
    return OccupancyGrid(frame, resolution, Pose.from_xy_yaw(-room - 0.5, -room - 0.5, 0.0), occupancy)


def test_map_explains_the_walls_until_it_is_removed():
    legs, walls = person(2.0, 0.5), cue()
    scan = scan_of(legs, room=4.0)
    without = len(walls.measure(scan, Motion()))
    walls.set_map(room_map())
    found = walls.measure(scan, Motion())
    assert len(found) == 1 and nearest(found.positions, (2.0, 0.5)) < 0.06
    walls.set_map(None)
    assert len(walls.measure(scan, Motion())) == without > 20


def test_map_lies_where_the_pose_says():
    mapped, scan = cue(), scan_of(person(2.0, 0.5), room=4.0)
    mapped.set_map(room_map())
    assert len(mapped.measure(scan, Motion(start=(0.0, 0.0, math.pi / 2)))) == 1  # the room looks the same
    assert len(mapped.measure(scan, Motion(start=(1.0, 0.0, 0.0)))) > 10


def test_wall_within_the_dilation_is_background_and_farther_is_not():
    mapped, scan = cue(), scan_of([], room=4.0)
    mapped.set_map(room_map(room=4.15))
    assert len(mapped.measure(scan, Motion())) == 0
    mapped.set_map(room_map(room=4.35))
    assert len(mapped.measure(scan, Motion())) > 20


def test_recording_without_transforms_is_used_without_its_map():
    mapped, scan = cue(), scan_of(person(2.0, 0.5))
    mapped.set_map(room_map())
    assert len(mapped.measure(scan, None)) == 1


def test_moving_scanner_is_straightened_to_the_stamp():
    motion = Motion(velocity=(1.5, 0.5), turn=1.5, start=(1.0, -1.0, 0.3))
    places = np.array([[3.0, -0.5], [0.5, 1.5], [0.5, -3.0]])
    legs = np.concatenate([places, places + [0.0, 0.25]])
    scan = scan_in_motion(motion, legs)
    middles = np.column_stack([places + [0.0, 0.125], np.zeros(3)])
    truth = motion.pose(scan.stamp_ns).inverse().apply(middles)[:, :2]
    straight = cue(leg_radius=LEG_RADIUS).measure(scan, motion)
    skewed = cue(leg_radius=LEG_RADIUS, deskew=False).measure(scan, motion)
    assert len(straight) == len(skewed) == 3
    assert max(nearest(straight.positions, place) for place in truth) < 0.02
    assert max(nearest(skewed.positions, place) for place in truth) > 0.1


def test_missing_transform_is_raised_and_leaves_the_cue_as_it_was():
    late = Motion(until_ns=5 * SECOND + 50_000_000)
    scan = scan_in_motion(late, [(2.0, 0.0)])
    legs = cue()
    with pytest.raises(TransformUnavailable):
        legs.measure(scan, late)
    late.until_ns = 10 * SECOND
    assert legs.measure(scan, late).sequence == 1


@pytest.mark.parametrize("odom", ["odom", ""])
def test_cue_asks_for_the_transforms_that_it_says_it_needs(odom):
    legs = LegCue(LegCueConfig(), name="scan", frames=FramesConfig(odom=odom))
    legs.set_map(room_map())
    motion = Motion()
    scan = scan_in_motion(motion, [(2.0, 0.0)])
    needed = legs.transforms_needed(scan)
    legs.measure(scan, motion)
    on_map, newest = needed
    before = newest._replace(stamp_ns=newest.stamp_ns - SECOND // 10)  # known where a newer one is
    assert set(motion.asked) == {on_map, newest, before}
    assert (on_map.target_frame, newest.target_frame) == ("map", odom or "map")
    assert newest.stamp_ns == scan.stamp_ns + 60 * SECOND // 1000


@pytest.mark.parametrize("lag_s, newest_s", [(0.04, 0.0), (0.02, 0.01), (0.0, 0.03)])
def test_motion_during_a_short_sweep_is_that_of_just_before_so_that_nobody_waits_for_odometry(lag_s, newest_s):
    scan = scan_with([2.0] * 31, time_increment=0.001)
    (newest,) = cue(deskew_lag_s=lag_s).transforms_needed(scan)
    assert newest.stamp_ns - scan.stamp_ns == from_seconds(newest_s)


def test_first_scan_of_a_recording_is_taken_as_it_is():
    motion = Motion(velocity=(1.5, 0.5), turn=1.5, since_ns=5 * SECOND)
    scan = scan_in_motion(motion, [(3.0, -0.5), (3.0, -0.25)])
    first = cue(deskew_lag_s=0.1).measure(scan, motion)
    np.testing.assert_array_equal(first.positions, cue(deskew=False).measure(scan, motion).positions)


def test_standing_scan_needs_no_transform():
    assert cue().transforms_needed(scan_of([(2.0, 0.0)])) == ()


def test_period_is_the_median_of_the_last_stamps_and_ignores_steps_back():
    legs, nothing = cue(), [np.inf] * 3

    def period(time_s, **fields):
        scan = scan_with(nothing, **{"stamp_ns": round(time_s * SECOND), **fields})
        return legs.measure(scan, None).period_s

    assert period(0.0) == 0.1
    assert period(0.0, scan_time=0.05) == 0.05
    assert period(1.0) == 1.0
    for step in range(1, 12):
        latest = period(1.0 + 0.04 * step)
    assert latest == pytest.approx(0.04)
    for _ in range(12):
        assert period(1.44) == period(0.5) == pytest.approx(0.04)
    assert period(60.0) == pytest.approx(0.04)
    legs.reset()
    assert period(0.0) == 0.1


def test_sequence_orders_measurements_of_one_stamp():
    legs = cue()
    first, second = (legs.measure(scan_of([(2.0, 0.0)]), None) for _ in range(2))
    assert first.order < second.order


def without_ties(scan):
    """The scan with ranges off by micrometres: where distances tie to the last bit, linkage has several solutions."""
    return dataclasses.replace(scan, ranges=scan.ranges + np.random.default_rng(0).normal(0.0, 1e-6, len(scan.ranges)))


@settings(max_examples=40, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.6, 4.0), st.floats(-2.0, 2.0)), min_size=1, max_size=10),
    st.floats(-math.pi, math.pi),
    st.booleans(),
)
def test_turned_scanner_sees_the_same_people_turned(places, turn, limits):
    legs = [(distance * math.cos(angle), distance * math.sin(angle)) for distance, angle in places]
    scan = without_ties(scan_of(legs))
    turned = dataclasses.replace(scan, angle_min=scan.angle_min + turn)
    parameters = WITHOUT_MAP if limits else {}
    before, after = (cue(**parameters).measure(each, None) for each in (scan, turned))
    rotation = Pose.from_xy_yaw(0.0, 0.0, turn).rotation
    assert np.allclose(after.positions, before.positions @ rotation.T, atol=1e-9)
    assert np.allclose(after.covariances, rotation @ before.covariances @ rotation.T, atol=1e-9)


@settings(max_examples=40, deadline=None)
@given(st.lists(st.tuples(st.floats(0.6, 4.0), st.floats(-2.0, 2.0)), min_size=1, max_size=10))
@example([(0.6796875, 0.19984273334020886), (0.62109375, 0.0)])
def test_scanner_upside_down_sees_the_same_people(places):
    legs = [(distance * math.cos(angle), distance * math.sin(angle)) for distance, angle in places]
    scan = without_ties(scan_of(legs))
    flipped = dataclasses.replace(
        scan, ranges=scan.ranges[::-1], angle_min=scan.angles[-1], angle_increment=-scan.angle_increment
    )
    before, after = (cue(**WITHOUT_MAP).measure(each, None).positions for each in (scan, flipped))
    assert len(before) == len(after)
    assert all(nearest(after, place[:2]) < 1e-9 for place in before)


def test_leg_larger_than_a_group_is_refused():
    with pytest.raises(ConfigError, match="leg_diameter"):
        parse(LegCueConfig, {"leg_diameter": 0.7})


@pytest.mark.parametrize("name", ["pair_std", "segment_gap", "min_segment_points", "map_dilation"])
def test_negative_parameter_is_refused(name):
    value = -1 if name == "min_segment_points" else -1.0
    with pytest.raises(ConfigError, match=f"cue/{name}"):
        parse(LegCueConfig, {name: value}, "cue")


def test_unusable_scan_leaves_the_cue_as_it_was():
    legs = cue()
    with pytest.raises(DataError):
        legs.measure(scan_with([]), None)
    with pytest.raises(DataError):
        legs.transforms_needed(scan_with([]))
    assert legs.measure(scan_of([(2.0, 0.0)]), None).sequence == 1
