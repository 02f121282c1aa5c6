import dataclasses

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from people_fusion.simulation.detections import DetectionsConfig, detections

CONFIG = DetectionsConfig(people=8, duration_s=40.0)


@pytest.fixture(scope="module")
def made():
    return detections(CONFIG, seed=2)


def matched(measurements, truths):
    """Numbers of people in view, found and false, and the errors of what was found."""
    in_view = found = false = 0
    errors = []
    for measurement, (_, ids, positions) in zip(measurements, truths):
        offsets = measurement.positions[:, None, :2] - positions
        distances = np.linalg.norm(offsets, axis=2)
        rows, columns = linear_sum_assignment(np.minimum(distances, 0.3))
        close = distances[rows, columns] < 0.25
        errors += [offsets[row, column] for row, column in zip(rows[close], columns[close])]
        in_view, found = in_view + len(ids), found + int(close.sum())
        false += len(measurement) - int(close.sum())
    return in_view, found, false, np.array(errors)


def test_detections_have_the_configured_rates_and_noise(made):
    in_view, found, false, errors = matched(*made)
    assert found / in_view == pytest.approx(0.9, abs=0.02)
    assert false / len(made[0]) == pytest.approx(1.0, abs=0.15)
    np.testing.assert_allclose(errors.std(axis=0), 0.05, rtol=0.06)
    np.testing.assert_allclose(errors.mean(axis=0), 0.0, atol=0.005)


def test_measurements_are_well_formed_and_in_step_with_the_truth(made):
    measurements, truths = made
    assert len(measurements) == len(truths) == 400
    for sequence, (measurement, (stamp_ns, ids, positions)) in enumerate(zip(measurements, truths)):
        assert measurement.stamp_ns == stamp_ns
        assert measurement.sequence == sequence
        assert measurement.positions.shape == (len(measurement), 3)
        assert measurement.covariances.shape == (len(measurement), 3, 3)
        assert len(ids) == len(positions)
    assert {m.observed for m in measurements} == {(True, True, False)}


def test_people_in_view_are_within_the_sight_of_the_measurement(made):
    for measurement, (_, _, positions) in zip(*made):
        offset = positions - measurement.sight.position
        bearing = (np.arctan2(offset[:, 1], offset[:, 0]) - measurement.sight.yaw + np.pi) % (2 * np.pi) - np.pi
        assert (np.linalg.norm(offset, axis=1) < CONFIG.reach).all()
        assert (np.abs(bearing) < CONFIG.field_of_view / 2.0).all()


def test_robot_moves_and_people_leave_and_enter_the_view_and_cross(made):
    measurements, truths = made
    places = np.array([measurement.sight.position for measurement in measurements])
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).sum() > 10.0
    assert len({tuple(ids) for _, ids, _ in truths}) > 10
    near = 0
    for _, _, positions in truths:
        gaps = np.linalg.norm(positions[:, None] - positions, axis=2) + 10.0 * np.eye(len(positions))
        near += bool((gaps < 0.8).any())
    assert near > 5


def test_same_seed_same_detections_and_another_seed_others():
    config = dataclasses.replace(CONFIG, duration_s=2.0)
    first, second, other = (np.concatenate([m.positions for m in detections(config, s)[0]]) for s in (1, 1, 2))
    np.testing.assert_array_equal(first, second)
    assert first.shape != other.shape or not np.array_equal(first, other)


def test_nobody_gives_clutter_alone():
    measurements, truths = detections(dataclasses.replace(CONFIG, people=0), seed=1)
    assert sum(len(ids) for _, ids, _ in truths) == 0
    assert np.mean([len(m) for m in measurements]) == pytest.approx(1.0, abs=0.2)
