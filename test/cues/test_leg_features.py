"""Segments and their features, against a literal reading of Arras et al. 2012, 2.2."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.core.scans import Scan
from people_fusion.cues.legs.features import ALONE, FAR, MIN_POINTS, NAMES, NARROW, OURS, STRAIGHT, features
from people_fusion.cues.legs.segments import segment


def scan_of(ranges, angle_min=-1.5, increment=0.01):
    return Scan(0, "laser", np.asarray(ranges, dtype=float), angle_min, increment, 0.05, 30.0)


def segments_of(ranges, jump=0.15, jump_beams=0.0, **shape):
    scan = scan_of(ranges, **shape)
    return segment(scan, scan.ranges, jump, jump_beams)


def room(seed, beams=200, objects=12, missing=0.05):
    """A wall with things before it."""
    rng = np.random.default_rng(seed)
    ranges = 6.0 + np.cumsum(rng.normal(0.0, 0.02, beams))
    for _ in range(objects):
        first, width = rng.integers(0, beams - 10), rng.integers(1, 10)
        ranges[first : first + width] = rng.uniform(0.5, 5.0) + rng.normal(0.0, 0.02, width)
    ranges[rng.random(beams) < missing] = np.nan
    return ranges


def literal(found, index):
    """Features 1 to 13 of one segment, as the paper's text has them."""
    start, n = found.starts[index], found.counts[index]
    p = found.points[start : start + n]
    mean, median = p.mean(axis=0), np.median(p, axis=0)
    value = {"number": n}
    value["standard_deviation"] = math.sqrt(sum(np.sum((x - mean) ** 2) for x in p) / (n - 1))
    value["median_deviation"] = sum(np.linalg.norm(x - median) for x in p) / n
    first, last = index == 0, index == len(found) - 1
    before = ALONE if first else np.linalg.norm(p[0] - found.points[start - 1])
    after = ALONE if last else np.linalg.norm(p[-1] - found.points[start + n])
    value["jump_before"], value["jump_after"] = min(before, ALONE), min(after, ALONE)
    value["width"] = np.linalg.norm(p[-1] - p[0])
    sxx, syy = ((p[:, 0] - mean[0]) ** 2).sum(), ((p[:, 1] - mean[1]) ** 2).sum()
    sxy = ((p[:, 0] - mean[0]) * (p[:, 1] - mean[1])).sum()
    alpha = 0.5 * math.atan2(-2 * sxy, syy - sxx)
    r = mean[0] * math.cos(alpha) + mean[1] * math.sin(alpha)
    value["linearity"] = sum((x * math.cos(alpha) + y * math.sin(alpha) - r) ** 2 for x, y in p)
    a = np.column_stack([-2 * p, np.ones(n)])
    solved, _, rank, _ = np.linalg.lstsq(a, -(p**2).sum(axis=1), rcond=1e-12)
    radius = math.sqrt(max(solved[0] ** 2 + solved[1] ** 2 - solved[2], 0.0))
    if radius > STRAIGHT or rank < 3:
        value["radius"], value["circularity"] = STRAIGHT, value["linearity"]
    else:
        value["radius"] = radius
        value["circularity"] = sum((radius - math.hypot(solved[0] - x, solved[1] - y)) ** 2 for x, y in p)
    d = [np.linalg.norm(p[j] - p[j - 1]) for j in range(1, n)]
    value["boundary_length"], value["boundary_regularity"] = sum(d), np.std(d)
    curvature, angles = [], []
    for a, b, c in zip(p, p[1:], p[2:]):
        area = 0.5 * abs((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
        product = np.linalg.norm(b - a) * np.linalg.norm(c - b) * np.linalg.norm(c - a)
        curvature.append(4 * area / product)
        turn = math.atan2(*(c - b)[::-1]) - math.atan2(*(b - a)[::-1])
        angles.append(math.remainder(turn, 2 * math.pi))
    value["mean_curvature"], value["mean_angular_difference"] = np.mean(curvature), np.mean(angles)
    return value


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000))
def test_the_papers_features_equal_their_literal_definition(seed):
    found = segments_of(room(seed))
    values = features(found)
    for index in np.flatnonzero(found.counts >= MIN_POINTS):
        for name, expected in literal(found, index).items():
            if name == "circularity" and values[index, NAMES.index("radius")] > 0.9 * STRAIGHT:
                continue  # nearly a line: which of both it is may differ by rounding
            if name == "radius" and expected > 0.9 * STRAIGHT:
                continue
            assert values[index, NAMES.index(name)] == pytest.approx(expected, rel=1e-6, abs=1e-8), name


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), jump=st.floats(0.02, 1.0))
def test_segments_end_where_points_jump_and_nowhere_else(seed, jump):
    found = segments_of(room(seed), jump=jump)
    apart = np.hypot(*np.diff(found.points, axis=0).T)
    np.testing.assert_array_equal(np.diff(found.labels) > 0, apart > jump)
    assert found.counts.sum() == len(found.points) == np.isfinite(room(seed)).sum()


def test_the_threshold_may_follow_the_spacing_of_the_beams():
    ranges = np.full(40, 10.0)
    assert len(segments_of(ranges, jump=0.05, increment=0.02)) == 40
    assert len(segments_of(ranges, jump=0.05, jump_beams=1.5, increment=0.02)) == 1


def test_a_segment_across_the_seam_of_a_full_circle_is_one():
    ranges = np.full(360, 5.0)
    ranges[[*range(355, 360), *range(5)]] = 1.0
    found = segments_of(ranges, angle_min=-np.pi, increment=2 * np.pi / 360, jump=0.3)
    assert sorted(found.counts.tolist()) == [10, 350]
    half = segments_of(ranges[:300], angle_min=-np.pi, increment=2 * np.pi / 360, jump=0.3)
    assert sorted(half.counts.tolist()) == [5, 295]


def test_on_a_full_circle_the_first_segment_follows_the_last():
    ranges = np.full(360, 5.0)
    ranges[100:110] = 1.0
    found = segments_of(ranges, angle_min=-np.pi, increment=2 * np.pi / 360, jump=0.3)
    jumps = features(found)[:, [NAMES.index("jump_before"), NAMES.index("jump_after")]]
    assert (jumps < ALONE).all() and (jumps > 3.9).all()


@pytest.mark.parametrize("turn", [0.0, 0.7, 2.0, -3.0])
def test_our_features_do_not_depend_on_the_direction(turn):
    ranges = room(3, missing=0.0)
    ours = [NAMES.index(name) for name in OURS]
    values = features(segments_of(ranges, angle_min=-1.0))[:, ours]
    turned = features(segments_of(ranges, angle_min=-1.0 + turn))[:, ours]
    np.testing.assert_allclose(turned, values, atol=1e-7)


@pytest.mark.parametrize("increment", [np.radians(0.25), np.radians(0.5)])
def test_our_features_of_a_leg_hardly_depend_on_the_resolution(increment):
    """A leg of 6 cm radius, 1.2 m away, sampled by 1/8 and by coarser steps."""

    def leg(step):
        angles = np.arange(-0.05, 0.05, step)
        with np.errstate(invalid="ignore"):
            reach = 1.2 * np.cos(angles) - np.sqrt(0.06**2 - (1.2 * np.sin(angles)) ** 2)
        found = segments_of(reach, angle_min=-0.05, increment=step)
        return dict(zip(NAMES, features(found)[np.argmax(found.counts)].tolist()))

    fine, coarse = leg(np.radians(0.02)), leg(increment)
    assert coarse["radius"] == pytest.approx(fine["radius"], abs=0.005)
    assert coarse["across"] == pytest.approx(fine["across"], rel=0.2)
    assert coarse["bulge_share"] == pytest.approx(fine["bulge_share"], rel=0.35)
    assert coarse["number"] < 0.2 * fine["number"]


def test_a_leg_bulges_towards_the_scanner_and_a_corner_away():
    angles = np.arange(-0.04, 0.04, 0.005)
    leg = 1.2 * np.cos(angles) - np.sqrt(0.06**2 - (1.2 * np.sin(angles)) ** 2)
    corner = 1.0 / (np.cos(angles) + np.abs(np.sin(angles)))
    bulge = [features(segments_of(r, angle_min=-0.04, increment=0.005))[0, NAMES.index("bulge")] for r in (leg, corner)]
    assert bulge[0] > 0.005 and bulge[1] < -0.003


def test_the_companion_is_the_nearest_other_narrow_segment():
    ranges = np.full(300, 9.0)
    ranges[100:106], ranges[115:121], ranges[200:260] = 2.0, 2.0, 3.0
    found = segments_of(ranges)
    values = dict(zip(NAMES, features(found).T))
    legs = np.flatnonzero(found.counts == 6)
    expected = np.linalg.norm(found.centres[legs[0]] - found.centres[legs[1]])
    np.testing.assert_allclose(values["companion_distance"][legs], expected)
    np.testing.assert_array_equal(values["companions"][legs], 1)
    assert values["companion_distance"][np.argmax(found.counts == 60)] == FAR


def test_alone_there_is_no_companion():
    values = dict(zip(NAMES, features(segments_of([2.0] * 6)).T))
    assert values["companion_distance"] == FAR and values["companions"] == 0 and values["companion_width"] == NARROW


def test_mean_speed_is_the_mean_change_of_range_over_time():
    ranges, previous = np.full(20, 2.0), np.full(20, 2.1)
    previous[3] = np.nan
    found = segments_of(ranges)
    speed = features(found, previous, ranges, 0.1)[0, NAMES.index("mean_speed")]
    assert speed == pytest.approx(-1.0)
    assert features(found)[0, NAMES.index("mean_speed")] == 0.0


DEGENERATE = {
    "nothing": [np.nan] * 50,
    "one beam": [1.0],
    "two points": [np.nan, 1.0, 1.01],
    "one point each": np.tile([1.0, 5.0], 100),
    "points that coincide": [1e-9] * 10,
    "on the scanner": [0.0] * 10,
    "far": [1e6] * 10,
    "ten thousand beams": np.full(10_000, 3.0),
    "five hundred segments": np.repeat(np.tile([2.0, 3.0], 250), 4),
}


@pytest.mark.parametrize("ranges", DEGENERATE.values(), ids=DEGENERATE.keys())
def test_degenerate_segments_have_finite_features(ranges):
    found = segments_of(ranges, increment=6.28 / max(len(ranges), 100), angle_min=-3.14)
    values = features(found)
    assert values.shape == (len(found), len(NAMES)) and np.isfinite(values).all()


def test_points_on_a_line_have_the_radius_of_a_line():
    angles = np.arange(-0.2, 0.2, 0.01)
    values = dict(zip(NAMES, features(segments_of(1.0 / np.cos(angles), angle_min=-0.2)).T))
    assert values["radius"] == STRAIGHT
    assert values["circularity"] == values["linearity"] == pytest.approx(0.0, abs=1e-12)
