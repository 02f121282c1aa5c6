"""What a leg looks like has a vote in how far a detection is believed, or decides alone."""

from __future__ import annotations

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.transforms import FramesConfig
from people_fusion.cues.cue import CUES
from people_fusion.cues.legs.legs import LegCueConfig

ANGLES = np.radians(np.arange(-90, 90.25, 0.5))


def scan(circles=(), box=None):
    """Legs (x, y, radius) and a plate (x, half width) across the view, in an empty hall."""
    ranges = np.full(len(ANGLES), 20.0)
    for x, y, radius in circles:
        along = x * np.cos(ANGLES) + y * np.sin(ANGLES)
        across = np.abs(x * np.sin(ANGLES) - y * np.cos(ANGLES))
        hit = (across < radius) & (along > 0)
        depth = along - np.sqrt(np.where(hit, radius**2 - across**2, 0.0))
        ranges = np.where(hit, np.minimum(ranges, depth), ranges)
    if box is not None:
        x, half = box
        plate = x / np.maximum(np.cos(ANGLES), 1e-3)
        ranges = np.where(np.abs(x * np.tan(ANGLES)) < half, np.minimum(ranges, plate), ranges)
    return Scan(10**9, "laser", ranges, float(ANGLES[0]), float(ANGLES[1] - ANGLES[0]), 0.05, 15.0)


def cue(**options):
    return CUES.build(parse(LegCueConfig, options), name="scan", frames=FramesConfig())


LEGS = scan(circles=[(1.5, 0.12, 0.06), (1.6, -0.12, 0.06)])
PLATE = scan(box=(1.5, 0.12))


def test_what_looks_like_legs_is_believed_more_than_a_plate():
    voting = cue(model="legs")
    legs, plate = (voting.measure(each, None).confidences for each in (LEGS, PLATE))
    assert len(legs) == len(plate) == 1
    assert legs[0] > 0.8 and plate[0] < 0.7


def test_without_a_model_nothing_is_said_of_looks():
    assert cue(pair_confidence=0.7).measure(LEGS, None).confidences.tolist() == [0.7]


def test_positions_are_not_voted_on():
    ours, theirs = (each.measure(LEGS, None) for each in (cue(model="legs"), cue()))
    np.testing.assert_array_equal(ours.positions, theirs.positions)
    np.testing.assert_array_equal(ours.covariances, theirs.covariances)


def test_with_a_map_that_explains_it_less_is_needed_to_be_believed():
    class Still:
        def lookup(self, *_):
            return Pose.identity()

    free = OccupancyGrid("map", 0.1, Pose.from_xy_yaw(-5.0, -5.0, 0.0), np.zeros((100, 100), dtype=np.int8))
    mapped = cue(model="legs")
    mapped.set_map(free)
    assert mapped.measure(LEGS, Still()).confidences[0] > cue(model="legs").measure(LEGS, None).confidences[0]
    assert mapped.measure(PLATE, Still()).confidences[0] > cue(model="legs").measure(PLATE, None).confidences[0]


@pytest.mark.parametrize("ranges", [np.full(361, np.nan), np.full(361, np.inf), np.zeros(361), np.full(361, 1e-3)])
@pytest.mark.parametrize("options", [{}, {"classified_above": 0.1}])
def test_scans_without_returns_have_no_vote(ranges, options):
    empty = Scan(10**9, "laser", ranges, -1.5, 0.01, 0.05, 15.0)
    assert len(cue(model="legs", **options).measure(empty, None)) == 0


def test_the_model_alone_finds_pairs_of_legs_and_no_plate():
    deciding = cue(model="legs", classified_above=0.5)
    found = deciding.measure(LEGS, None)
    assert found.legs.shape == (2, 2) and found.leg_owners.tolist() == [0, 0]
    np.testing.assert_allclose(found.positions[0, :2], [1.55, 0.0], atol=0.06)
    assert found.confidences[0] > 0.8
    assert len(deciding.measure(PLATE, None)) == 0 and len(cue().measure(PLATE, None)) == 1


def test_rules_have_no_say_where_the_model_decides():
    """A rule that thinks nothing of a leg drops it, or doubts it."""
    rules = {"min_leg_width": 0.2, "max_segment_width": 0.1, "pair_confidence": 0.1}
    assert len(cue(**rules).measure(LEGS, None)) == 0
    free, bound = (cue(model="legs", classified_above=0.5, **more).measure(LEGS, None) for more in ({}, rules))
    np.testing.assert_array_equal(free.positions, bound.positions)
    np.testing.assert_array_equal(free.confidences, bound.confidences)


def test_the_more_it_takes_to_be_a_leg_the_fewer_there_are():
    scene = scan(circles=[(1.5, 0.12, 0.06), (1.6, -0.12, 0.06), (4.0, 2.0, 0.15), (3.0, -1.5, 0.1)], box=(8.0, 0.6))
    counts = [len(cue(model="legs", classified_above=least).measure(scene, None).legs) for least in (1e-6, 0.1, 1.0)]
    assert counts[0] > counts[1] >= 2 and counts[2] == 0


def test_where_the_map_explains_a_leg_the_model_finds_none_either():
    class Still:
        def lookup(self, *_):
            return Pose.identity()

    full = OccupancyGrid("map", 0.1, Pose.from_xy_yaw(-5.0, -5.0, 0.0), np.full((100, 100), 100, dtype=np.int8))
    deciding = cue(model="legs", classified_above=0.1)
    deciding.set_map(full)
    assert len(deciding.measure(LEGS, Still())) == 0


def test_legs_across_the_seam_of_a_full_circle_are_one_person():
    angles = np.radians(np.arange(-180.0, 180.0, 0.5))
    turned = scan(circles=[(1.5, 0.12, 0.06), (1.6, -0.12, 0.06)])
    ranges = np.full(len(angles), 20.0)
    ranges[:181], ranges[-180:] = turned.ranges[180:], turned.ranges[:180]  # straight behind
    behind = Scan(10**9, "laser", ranges, float(angles[0]), float(angles[1] - angles[0]), 0.05, 15.0)
    found = cue(model="legs", classified_above=0.5).measure(behind, None)
    ahead = cue(model="legs", classified_above=0.5).measure(turned, None)
    np.testing.assert_allclose(found.positions[:, :2], -ahead.positions[:, :2], atol=1e-9)


def test_a_threshold_needs_a_model():
    with pytest.raises(ConfigError, match="classified_above"):
        cue(classified_above=0.5)


def test_a_model_that_is_not_there_is_named():
    with pytest.raises(ConfigError, match="arms"):
        cue(model="arms")
