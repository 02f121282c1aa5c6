"""Scans that no leg cue should make, and some that it may: the leg tracker survives all of them with bounded work."""

import warnings

import numpy as np
import pytest

from people_fusion.association import k_best
from people_fusion.core.config import parse
from people_fusion.core.measurements import Measurement
from people_fusion.tracking.tracker import TRACKERS

SECOND_NS = 10**9


@pytest.fixture(autouse=True)
def _no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def scan(time_s, legs):
    legs = np.asarray(legs, dtype=float).reshape(-1, 2)
    return Measurement(
        round(time_s * SECOND_NS), "scan", "legs", "odom", np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0),
        sequence=round(10 * time_s), legs=legs,
    )  # fmt: skip


def gait(time_s):
    """Two legs that swing in turn, 20 cm apart across."""
    swing = 0.2 * np.sin(5.0 * time_s)
    return [(time_s + swing, 0.1), (time_s - swing, -0.1)]


def tracker(**options):
    return TRACKERS.build(parse(TRACKERS.config_of("leg_mht", "tracker"), options))


def walked(seconds, **options):
    """A tracker that has followed one person for a while."""
    each = tracker(**options)
    for step in range(round(10 * seconds)):
        each.process(scan(0.1 * step, gait(0.1 * step)))
    assert len(each.tracks()) == 1
    return each


def sound(each):
    """Everything is finite, and probabilities sum to one."""
    tracks, forest = each.tracks(), each.snapshot().forest
    assert np.exp([entry.log_p for entry in forest.hypotheses]).sum() == pytest.approx(1.0)
    for values in (tracks.means, tracks.covariances, forest.tracks.means, forest.tracks.covariances):
        assert np.isfinite(values).all()
    assert np.linalg.eigvalsh(forest.tracks.covariances).min(initial=0.0) > -1e-9
    assert len(each.leg_tracks.ids) == len(set(each.leg_tracks.ids.tolist()))


@pytest.mark.parametrize("nothing", [[], [(np.nan, np.nan)] * 3, [(np.inf, 0.0), (0.0, -np.inf)]])
def test_scans_without_a_leg_leave_nobody_when_they_come_first_and_end_who_was_there(nothing):
    each = tracker()
    each.process(scan(0.0, nothing))
    assert len(each.leg_tracks.ids) == 0 and each.hypotheses == 1
    sound(each)
    each = walked(4.0)
    for step in range(40, 140):
        each.process(scan(0.1 * step, nothing))
        sound(each)
    assert len(each.tracks()) == 0


def test_legs_at_no_place_change_nothing_about_the_others():
    one, other = walked(3.0), walked(3.0)
    for step in range(30, 40):
        one.process(scan(0.1 * step, gait(0.1 * step)))
        other.process(scan(0.1 * step, [*gait(0.1 * step), (np.nan, 1.0)]))
    np.testing.assert_array_equal(one.tracks().means, other.tracks().means)


def test_a_single_leg_is_tracked_and_is_nobody():
    each = tracker()
    for step in range(40):
        each.process(scan(0.1 * step, [(0.05 * step, 0.0)]))
        sound(each)
    assert len(each.leg_tracks.ids) == 1 and len(each.tracks()) == 0


@pytest.mark.parametrize("box_m", [10.0, 1.0, 0.0])
def test_five_hundred_legs_in_a_scan_take_bounded_work_and_are_counted(box_m, monkeypatch):
    solved, solve = [], k_best.linear_sum_assignment
    monkeypatch.setattr(k_best, "linear_sum_assignment", lambda costs: solved.append(costs.shape) or solve(costs))
    each, rng = tracker(), np.random.default_rng(0)
    legs = rng.uniform(-box_m, box_m, (500, 2))
    for step in range(12):
        solved.clear()
        each.process(scan(0.1 * step, legs))
        sound(each)
        assert len(solved) <= 2 * 50 + 1 and max(rows for rows, _ in solved or [(0, 0)]) <= 100
    assert each.counters()["legs shed: too many"] == 12 * 400
    assert each.counters()["hypotheses shed: too many"] >= 11
    assert len(each.snapshot().forest.tracks.ids) < 500


def test_a_person_is_followed_through_scans_of_five_hundred_legs():
    each, rng = walked(4.0), np.random.default_rng(0)
    name = each.tracks().ids[0]
    for step in range(40, 60):
        others = rng.uniform(5.0, 20.0, (498, 2)) * [1.0, -1.0]
        each.process(scan(0.1 * step, [*others, *gait(0.1 * step)]))
        assert name in each.tracks().ids
    mean = each.tracks().means[each.tracks().ids == name][0]
    np.testing.assert_allclose(mean[:2], [5.9, 0.0], atol=0.3)


@pytest.mark.parametrize("copies", [2, 20])
def test_legs_at_one_place_are_one_leg_and_false_alarms(copies):
    each = tracker()
    for step in range(30):
        each.process(scan(0.1 * step, [(0.05 * step, 0.0)] * copies))
        sound(each)
    assert each.leg_tracks.seen_ns.max() == round(2.9 * SECOND_NS) and 1 <= len(each.leg_tracks.ids) <= copies


def test_a_pause_of_two_seconds_and_the_person_walks_on():
    each = walked(4.0)
    for step in range(60, 80):
        each.process(scan(0.1 * step, gait(0.1 * step)))
        sound(each)
    tracks = each.tracks()
    assert tracks.matched.sum() == 1 and (tracks.matched == tracks.confirmed).all()
    np.testing.assert_allclose(tracks.means[tracks.matched, :2], [[7.9, 0.0]], atol=0.3)


@pytest.mark.parametrize("late_s", [0.1, 2.0, 1000.0])
def test_a_stamp_before_the_last_does_not_turn_time_back(late_s):
    each = walked(4.0)
    stamp_ns, name = each.stamp_ns, each.tracks().ids.tolist()
    each.process(scan(3.9 - late_s, gait(3.9 - late_s)))
    sound(each)
    assert each.stamp_ns == stamp_ns and each.tracks().ids.tolist() == name
    assert each.counters()["measurements predicted forward"] == 1


def test_one_scan_twice_leaves_one_person():
    each = walked(4.0)
    for step in range(40, 60):
        for _ in range(2):
            each.process(scan(0.1 * step, gait(0.1 * step)))
        sound(each)
    assert len(each.tracks()) == 1
