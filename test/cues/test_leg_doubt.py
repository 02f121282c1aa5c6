"""When the leg cue doubts: near the map, too thin, too wide; and what its sight says of the background."""

from __future__ import annotations

import math

import numpy as np
import pytest
from leg_scenes import LEG_RADIUS, Motion, scan_of, scan_with
from test_leg_cue import cue, nearest, person, room_map

from people_fusion.core.measurements import PERSON_DEPTH_M
from people_fusion.core.poses import Pose

WALL = 4.0
DILATION = 0.12


def at_the_wall(gap, distance=WALL, localisation=None, **parameters):
    """Confidences of a person whose nearest points are `gap` before the map's wall."""
    legs = cue(**{"map_dilation": DILATION, "doubtful_confidence": 0.1, **parameters})
    legs.set_map(room_map(distance))
    if localisation is not None:
        legs.set_localisation(localisation)
    return legs.measure(scan_of(person(distance - gap, 0.0)), Motion()).confidences.tolist()


def test_legs_near_the_map_are_doubted_up_to_the_given_distance():
    assert at_the_wall(0.30) == [1.0]
    assert at_the_wall(0.30, map_doubt=0.6) == [0.1]
    assert at_the_wall(0.60, map_doubt=0.4) == [1.0]


def test_doubt_grows_with_the_distance_from_the_scanner():
    assert at_the_wall(0.35, map_doubt_per_metre=0.12) == [0.1]
    assert at_the_wall(0.35, distance=2.0, map_doubt_per_metre=0.12) == [1.0]


@pytest.mark.parametrize(
    ("position_std", "yaw_std", "doubted"), [(0.0, 0.0, False), (0.2, 0.0, True), (0.0, 0.06, True)]
)
def test_doubt_follows_the_covariance_of_the_localisation(position_std, yaw_std, doubted):
    covariance = np.diag([position_std**2, position_std**2, 0.0, 0.0, 0.0, yaw_std**2])
    assert at_the_wall(0.35, localisation=covariance, map_doubt_stds=2.5) == [0.1 if doubted else 1.0]
    assert at_the_wall(0.35, localisation=covariance) == [1.0]


def test_doubt_without_a_map_is_none():
    found = cue(map_doubt=2.0, doubtful_confidence=0.1).measure(scan_of(person(2.0, 0.0)), Motion())
    assert found.confidences.tolist() == [1.0]


def test_doubtful_confidence_never_raises_another():
    assert at_the_wall(0.3, map_doubt=0.6, doubtful_confidence=0.9, pair_confidence=0.4) == [0.4]


def test_walls_of_a_misplaced_robot_are_background_by_the_fit_and_legs_before_them_are_not():
    error = (0.08, 0.06, 0.035)
    scan = scan_of(person(2.0, 0.5), room=WALL)
    covariance = np.diag([0.05**2, 0.05**2, 0.0, 0.0, 0.0, 0.02**2])
    counts = []
    for fit in (False, True):
        legs = cue(map_dilation=DILATION, map_fit=fit)
        legs.set_map(room_map(WALL))
        legs.set_localisation(covariance)
        found = legs.measure(scan, Motion(start=error))
        counts.append(len(found))
        assert nearest(found.positions, (2.0, 0.5)) < 0.06  # in the scanner's frame: the fit moves nobody
    assert counts[0] > 2 and counts[1] == 1


def test_sight_ends_before_the_background_by_dilation_and_body():
    legs = cue(map_dilation=DILATION)
    legs.set_map(room_map(WALL))
    scan = scan_of(person(2.0, 0.0), room=WALL)
    sight = legs.measure(scan, Motion()).sight
    beam = round((math.radians(20.0) - scan.angle_min) / scan.angle_increment)
    at_wall = WALL / math.cos(math.radians(20.0))
    assert sight.ranges[beam] == pytest.approx(at_wall - DILATION - PERSON_DEPTH_M, abs=0.03)
    on_legs = round((math.atan2(0.15, 2.0) - scan.angle_min) / scan.angle_increment)
    assert sight.ranges[on_legs] == pytest.approx(2.0 - LEG_RADIUS, abs=0.03)  # who stands there was seen
    assert sight.visible(np.array([[WALL - 0.6, 1.0]]), 0.1).tolist() == [1.0]
    assert sight.visible(np.array([[WALL - 0.05, 1.0]]), 0.1).tolist() == [0.0]  # legs there would look like the wall


def test_sight_past_all_that_is_resolved_is_not_shortened_by_a_wall_far_behind():
    legs = cue(map_dilation=DILATION)
    legs.set_map(room_map(9.0))
    sight = legs.measure(scan_of([], room=9.0), Motion()).sight
    assert sight.range_max < 9.0 - DILATION - PERSON_DEPTH_M
    assert np.array_equal(sight.ranges, np.full(541, sight.range_max))


def thing(width, distance, increment, beams_lost=0):
    """Scan of something flat before a background 3 m behind it."""
    count = 201
    ranges = np.full(count, distance + 3.0)
    wide = max(1, round(width / (distance * increment)))
    first = count // 2 - wide // 2
    ranges[first : first + wide] = distance
    for lost in range(beams_lost):
        ranges[first + wide + lost] = np.inf
    return scan_with(ranges, angle_min=-increment * (count // 2), angle_increment=increment)


@pytest.mark.parametrize("increment", np.radians([0.25, 0.5, 1.0]))
def test_what_is_certainly_thinner_than_a_shin_is_none(increment):
    distance = 0.02 / increment  # two centimetres between beams
    legs = cue(min_leg_width=0.08, max_segment_width=0.5)
    assert len(legs.measure(thing(0.04, distance, increment), None)) == 0
    assert len(legs.measure(thing(0.08, distance, increment), None)) == 1
    assert len(legs.measure(thing(0.04, 2.5 * distance, increment), None)) == 0  # a single beam is noise
    assert len(cue(max_segment_width=0.5).measure(thing(0.04, distance, increment), None)) == 1


def test_thin_thing_may_be_a_leg_where_a_beam_beside_it_was_lost_or_something_nearer_hides_the_rest():
    legs, increment = cue(min_leg_width=0.08, max_segment_width=0.5), math.radians(0.5)
    assert len(legs.measure(thing(0.04, 2.0, increment, beams_lost=1), None)) == 1
    hidden = thing(0.04, 2.0, increment)
    hidden.ranges[: np.flatnonzero(hidden.ranges == 2.0)[0]] = 1.0
    assert len(legs.measure(hidden, None)) == 1


def round_thing(radius, distance=2.0):
    """Scan of a bin."""
    angles = np.arange(-100, 101) * math.radians(0.5)
    half = math.asin(radius / distance)
    across = distance * np.sin(angles)
    hit = abs(angles) < half
    ranges = np.full(201, 6.0)
    ranges[hit] = distance * np.cos(angles[hit]) - np.sqrt(radius**2 - across[hit] ** 2)
    return scan_with(ranges, angle_min=angles[0], angle_increment=math.radians(0.5))


def test_one_wide_piece_is_one_thing_of_little_confidence_and_two_legs_are_not():
    legs = cue(max_leg_width=0.25, one_piece_confidence=0.3, max_segment_width=0.6)
    found = legs.measure(round_thing(0.18), None)
    assert len(found.legs) == 1 and found.confidences.tolist() == [0.3]
    assert cue(max_segment_width=0.6).measure(round_thing(0.18), None).confidences.tolist() == [1.0]
    assert legs.measure(round_thing(0.10), None).confidences.tolist() == [1.0]
    legs = cue(max_leg_width=0.2, leg_dent=0.025, one_piece_confidence=0.3, segment_gap=0.1)
    touching = legs.measure(scan_of([(2.0, -LEG_RADIUS - 0.01), (2.0, LEG_RADIUS + 0.01)]), None)
    assert touching.confidences.tolist() == [1.0]


def test_a_turn_of_the_seam_of_a_full_circle_changes_nothing():
    parameters = {"segment_gap_beams": 2.5, "min_segment_step": 0.1, "max_segment_width": 0.5}
    legs = person(2.0, 0.0, 0.0) + person(0.4, 2.0) + person(-5.0, 1.0) + person(1.0, -3.0)
    increment = math.radians(1.0)
    whole = scan_of(legs, room=6.5, beams=360, angle_min=0.0, increment=increment)
    expected = cue(**parameters, min_leg_width=0.06).measure(whole, None)
    assert len(expected) == 4
    for shift in range(0, 360, 3):
        scan = scan_with(
            np.roll(whole.ranges, -shift), angle_min=shift * increment, angle_increment=increment, range_max=30.0
        )
        found = cue(**parameters, min_leg_width=0.06).measure(scan, None)
        assert len(found) == len(expected), shift
        assert all(nearest(found.positions, place[:2]) < 1e-9 for place in expected.positions)
        for leg, centre in enumerate(found.legs):
            assert np.allclose(found.points[found.point_labels == leg].mean(axis=0), centre)


def test_scanner_elsewhere_on_the_map_has_the_map_turned_along():
    legs = cue(map_dilation=DILATION, map_doubt=0.4, doubtful_confidence=0.1)
    legs.set_map(room_map(WALL))
    pose = (1.0, -0.5, 0.6)
    wall_person = np.array([[WALL - 0.3, 0.0, 0.0], [WALL - 0.3, 0.3, 0.0]])
    seen = Pose.from_xy_yaw(*pose).inverse().apply(wall_person)[:, :2]
    assert legs.measure(scan_of(seen), Motion(start=pose)).confidences.tolist() == [0.1]
    assert legs.measure(scan_of(seen), Motion(start=(0.0, 0.0, 0.6))).confidences.tolist() == [1.0]
