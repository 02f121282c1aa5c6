"""REP-117 and what drivers send beyond it; de-skewing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from leg_scenes import SECOND, Motion, scan_with

from people_fusion.core.errors import DataError
from people_fusion.core.poses import Pose
from people_fusion.cues.legs import beams

NAN, INF = math.nan, math.inf


@pytest.mark.parametrize(
    ("distance", "is_hit", "seen_m"),
    [
        (2.0, True, 2.0),
        (0.1, True, 0.1),  # range_min itself
        (9.0, True, 9.0),
        (INF, False, 10.0),
        (-INF, False, 0.0),
        (NAN, False, NAN),
        (0.0, False, NAN),
        (-1.0, False, NAN),
        (0.09, False, NAN),
        (10.0, False, 10.0),  # range_max itself: nothing within reach, of drivers older than REP-117
        (10.1, False, NAN),
        (1e300, False, NAN),
    ],
)
def test_range_means_what_rep_117_says(distance, is_hit, seen_m):
    ranges = np.array([distance])
    assert beams.hits(ranges, 0.1, 10.0).tolist() == [is_hit]
    assert beams.seen_through(ranges, 0.1, 10.0) == pytest.approx([seen_m], nan_ok=True)


def test_zero_is_no_distance_even_where_range_min_is_zero():
    assert not beams.hits(np.array([0.0]), 0.0, 10.0).any()


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"ranges": []}, "scan without beams"),
        ({"ranges": [[1.0, 2.0]]}, "scan with ranges that are not a list"),
        ({"ranges": ["far"]}, "scan with ranges that are not numbers"),
        ({"ranges": [1.0, 10**400]}, "scan with ranges that are not numbers"),
        ({"angle_min": NAN}, "scan with angles that are not finite"),
        ({"angle_min": INF}, "scan with angles that are not finite"),
        ({"angle_increment": NAN}, "scan with angles that are not finite"),
        ({"angle_increment": INF}, "scan with angles that are not finite"),
        ({"angle_increment": -4.0}, "scan with beams more than half a turn apart"),
        ({"angle_increment": 0.0}, "scan with all beams in one direction"),
        ({"range_max": 0.0}, "scan with no distance between its limits"),
        ({"range_max": 0.05}, "scan with no distance between its limits"),
        ({"range_max": NAN}, "scan with no distance between its limits"),
        ({"range_min": NAN}, "scan with no distance between its limits"),
        ({"range_min": -INF}, "scan with no distance between its limits"),
    ],
)
def test_scan_that_makes_no_sense_is_refused(fields, reason):
    with pytest.raises(DataError) as refused:
        beams.check(scan_with(fields.pop("ranges", [1.0, 2.0]), **fields))
    assert refused.value.reason == reason


def test_whole_numbers_are_ranges():
    assert beams.check(scan_with([1, 2**40])).tolist() == [1.0, 2.0**40]


@pytest.mark.parametrize("time_increment", [0.0, -1e-4, NAN, INF])
def test_without_a_time_increment_a_scan_is_an_instant(time_increment):
    assert beams.duration_ns(scan_with([1.0] * 3, time_increment=time_increment)) == 0


def test_duration_is_from_the_first_beam_to_the_last():
    assert beams.duration_ns(scan_with([1.0] * 5, time_increment=0.01)) == 40_000_000


def test_directions_follow_the_shape_of_the_scan():
    directions = beams.Directions()
    for scan in (scan_with([1.0] * 3), scan_with([1.0] * 4), scan_with([1.0] * 4, angle_min=0.5), scan_with([1.0] * 3)):
        assert np.allclose(directions.of(scan), np.stack([np.cos(scan.angles), np.sin(scan.angles)], axis=1))


def test_straightened_points_are_where_a_standing_scanner_would_have_seen_them():
    motion, rng = Motion(velocity=(1.0, -0.5), turn=1.2, start=(3.0, 2.0, 0.7)), np.random.default_rng(1)
    fractions = np.linspace(0.0, 1.0, 20)
    fixed = rng.uniform(-3.0, 3.0, (20, 2))
    stamps = [int(5 * SECOND + fraction * 0.1 * SECOND) for fraction in fractions]

    def seen(pose: Pose, point):
        return pose.inverse().apply(np.append(point, 0.0))[:2]

    points = np.array([seen(motion.pose(stamp), point) for stamp, point in zip(stamps, fixed)])
    expected = np.array([seen(motion.pose(stamps[0]), point) for point in fixed])
    straight = beams.straighten(points, fractions, motion.pose(stamps[0]), motion.pose(stamps[-1]))
    assert np.abs(points - expected).max() > 0.2
    assert np.allclose(straight, expected, atol=1e-9)
