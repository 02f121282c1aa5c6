"""Legs that multiple hypotheses give to people, as measurements of the Kalman tracker."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.measurements import XY_OBSERVED, Measurement
from people_fusion.core.tracks import NOBODY
from people_fusion.tracking.tracker import TRACKERS
from people_fusion.tracking.trackers.kalman_over_legs import KalmanOverLegsConfig, regrouped

CONFIG = KalmanOverLegsConfig(free_confidence=0.5)


def scan(*detections):
    """Detections, each of its legs (x, y), with a variance of its own, in cm^2, and a confidence."""
    legs = np.array([leg for detection in detections for leg in detection], dtype=float).reshape(-1, 2)
    owners = np.repeat(np.arange(len(detections)), [len(detection) for detection in detections])
    count = len(detections)
    covariances = np.zeros((count, 3, 3))
    covariances[:, [0, 1], [0, 1]] = 1e-4 * (1.0 + np.arange(count))[:, None]
    middles = [np.mean(detection, axis=0) for detection in detections]
    positions = np.column_stack([np.reshape(middles, (-1, 2)), np.full(count, 0.4)])
    jacobians = np.arange(count)[:, None, None] * np.ones((1, 3, 6))
    return Measurement(
        10**9, "scan", "legs", "odom", positions, covariances, np.linspace(0.6, 0.8, count), XY_OBSERVED,
        legs=legs, leg_owners=owners, shared_jacobians=jacobians, shared_covariance=np.eye(6),
    )  # fmt: skip


def owners(*names):
    return np.array(names, dtype=np.int64)


def test_a_person_whose_legs_the_cue_paired_is_what_the_cue_says():
    entry = scan([(1.0, 0.1), (1.0, -0.1)], [(4.0, 0.0)])
    found = regrouped(entry, owners(7, 7, 8), CONFIG)
    for name in ("positions", "covariances", "confidences", "shared_jacobians"):
        np.testing.assert_array_equal(getattr(found, name), getattr(entry, name))


def test_legs_that_the_cue_paired_across_two_people_go_back_to_them():
    crossed = scan([(1.0, 0.0), (1.6, 0.0)], [(1.2, 0.0), (1.8, 0.0)])
    found = regrouped(crossed, owners(7, 8, 7, 8), CONFIG)
    np.testing.assert_allclose(found.positions, [[1.1, 0.0, 0.4], [1.7, 0.0, 0.4]])
    np.testing.assert_allclose(found.covariances[:, 0, 0], 1.5e-4)
    np.testing.assert_array_equal(found.confidences, [0.8, 0.8])
    assert found.shared_jacobians[:, 0, 0].tolist() == [1.0, 1.0]


def test_two_detections_of_one_person_become_one_that_is_no_better_known():
    found = regrouped(scan([(1.0, 0.1)], [(1.0, -0.1)]), owners(7, 7), CONFIG)
    np.testing.assert_allclose(found.positions, [[1.0, 0.0, 0.4]])
    np.testing.assert_allclose(found.covariances[0, 0, 0], 1.5e-4)


def test_a_leg_that_the_cue_paired_with_a_person_is_the_second_of_one_who_shows_no_other():
    entry = scan([(1.0, 0.1), (1.0, -0.3)])
    found = regrouped(entry, owners(7, NOBODY), CONFIG)
    np.testing.assert_array_equal(found.positions, entry.positions)
    np.testing.assert_array_equal(found.confidences, entry.confidences)


def test_a_leg_that_the_cue_paired_with_one_of_a_whole_person_is_half_a_step_from_its_body():
    found = regrouped(scan([(1.0, 0.1), (1.0, 0.5)], [(1.0, -0.1)]), owners(7, NOBODY, 7), CONFIG)
    half_step = CONFIG.legs.people.half_step_std
    np.testing.assert_allclose(found.positions[:, :2], [[1.0, 0.0], [1.0, 0.5]])
    np.testing.assert_allclose(found.covariances[:, 0, 0], [1.5e-4, 1e-4 + half_step**2])
    np.testing.assert_allclose(found.confidences, [0.8, 0.3])
    assert not found.covariances[:, 2].any() and not found.covariances[:, :, 2].any()


def test_two_legs_too_far_apart_are_what_the_cue_says():
    entry = scan([(1.0, 0.0)], [(2.0, 0.0)])
    found = regrouped(entry, owners(7, 7), CONFIG)
    np.testing.assert_array_equal(found.positions, entry.positions)
    np.testing.assert_allclose(found.confidences, 0.5 * entry.confidences)


def test_free_legs_are_believed_less_or_left_out():
    entry = scan([(1.0, 0.1), (1.0, -0.1)], [(4.0, 0.0)])
    believed = regrouped(entry, owners(7, 7, NOBODY), CONFIG)
    assert sorted(believed.confidences) == pytest.approx([0.4, 0.6])
    left_out = regrouped(entry, owners(7, 7, NOBODY), KalmanOverLegsConfig(free_confidence=0.0))
    np.testing.assert_allclose(left_out.positions[:, :2], [[1.0, 0.0]])
    assert len(regrouped(scan(), owners(), CONFIG)) == 0


def tracker(**options):
    return TRACKERS.build(parse(TRACKERS.config_of("kalman_over_legs", "tracker"), options))


def walk(each, detect, steps, start=0):
    for step in range(start, start + steps):
        each.process(detect(0.1 * step, (0.1 * step, 1.0), sequence=step))


def test_a_hidden_person_is_not_measured_where_the_filter_thinks_it_is(detect):
    """Two seconds in which nobody is seen make the Kalman tracker as uncertain as if there were no leg tracker."""
    over, alone = tracker(), TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), {}))
    for each in (over, alone):
        walk(each, detect, 40)
        for step in range(40, 60):
            each.process(detect(0.1 * step, sequence=step))
    np.testing.assert_array_equal(over.tracks().covariances, alone.tracks().covariances)
    np.testing.assert_array_equal(over.tracks().means, alone.tracks().means)


def test_other_cues_feed_the_people_and_tell_nothing_of_legs(detect):
    each = tracker()
    walk(each, detect, 40)
    legs, before = each.legs(), each.tracks()
    head = detect(3.95, (3.95, 1.0), cue="camera", sequence=0)
    nobody = np.zeros((0, 2))
    head = dataclasses.replace(head, modality="head", legs=nobody, leg_owners=np.zeros(0, dtype=int))
    each.process(head)
    assert each.tracks().matched.all() and each.tracks().stamp_ns == head.stamp_ns
    assert np.trace(each.tracks().covariances[0, :2, :2]) < np.trace(before.covariances[0, :2, :2])
    assert each.legs().seen.all()
    np.testing.assert_array_equal(each.legs().positions, legs.positions)


def test_legs_are_those_of_the_tracks(detect):
    each = tracker()
    walk(each, detect, 40)
    assert each.legs().owners.tolist() == each.tracks().ids.tolist() * 2
    assert len(tracker().legs()) == 0
