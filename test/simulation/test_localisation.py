import dataclasses

import numpy as np
import pytest
from scipy import stats

from people_fusion.core.transforms import DriftConfig
from people_fusion.simulation import planar
from people_fusion.simulation.localisation import AmclConfig, drift, localise

PERIOD_S = 0.04


def path(speed, turn_rate, duration_s):
    """(T, 3) true poses of a robot on an arc."""
    times = np.arange(0.0, duration_s, PERIOD_S)
    increments = np.tile([speed * PERIOD_S, 0.0, turn_rate * PERIOD_S], (len(times), 1))
    poses = [np.array([0.5, -0.3, 0.2])]
    for increment in increments:
        poses.append(planar.compose(poses[-1], increment))
    return np.array(poses)


def error_of(estimate, truth):
    error = truth - estimate
    error[..., 2] = planar.wrap(error[..., 2])
    return error


def test_odometry_without_noise_is_the_way_from_the_start():
    truth = path(0.5, 0.3, 20.0)
    odometry = drift(truth, DriftConfig(0.0, 0.0, 0.0, 0.0), np.random.default_rng(0))
    np.testing.assert_allclose(planar.compose(truth[:1], odometry), truth, atol=1e-9)


def test_standing_robot_does_not_drift():
    odometry = drift(path(0.0, 0.0, 10.0), DriftConfig(), np.random.default_rng(0))
    np.testing.assert_array_equal(odometry, 0.0)


def test_rounding_of_a_standing_robots_pose_is_no_drift():
    standing = np.tile([3.1, -2.7, 0.4], (200, 1)) + np.random.default_rng(1).normal(0.0, 1e-16, (200, 3))
    odometry = drift(standing, DriftConfig(), np.random.default_rng(0))
    np.testing.assert_array_equal(odometry, 0.0)


@pytest.mark.parametrize(("speed", "turn_rate"), [(0.5, 0.0), (0.0, 0.5)])
def test_drift_has_the_configured_variance(speed, turn_rate):
    config, runs = DriftConfig(), 400
    truth = path(speed, turn_rate, 8.0)
    ends = np.array([drift(truth, config, np.random.default_rng(seed))[-1] for seed in range(runs)])
    way = np.array([abs(speed), abs(turn_rate)]) * PERIOD_S * (len(truth) - 1)
    yaw_variance = np.array([config.rotation_per_metre**2, config.rotation_per_radian**2]) @ way
    along_variance = np.array([config.translation_per_metre**2, config.translation_per_radian**2]) @ way
    low, high = stats.chi2.interval(0.999, runs) / np.array(runs)
    yaw_error = ends[:, 2] - (truth[-1, 2] - truth[0, 2])
    assert low < np.mean(yaw_error**2) / yaw_variance < high
    if speed:  # straight on: the error along the way is not touched by that of the yaw, to first order
        assert low < np.mean((ends[:, 0] - way[0]) ** 2) / along_variance < high * 1.05


def fixes_of(config, truth, seed):
    rng = np.random.default_rng(seed)
    odometry = drift(truth, DriftConfig(), rng)
    fixes, map_from_odom = localise(truth, odometry, PERIOD_S, config, rng)
    return odometry, fixes, planar.compose(map_from_odom, odometry)


@pytest.mark.parametrize(
    ("config", "speed"), [(AmclConfig(), 0.6), (AmclConfig(), 0.0), (AmclConfig(update_standing=True), 0.0)]
)
def test_error_at_fixes_is_consistent_with_the_published_covariance(config, speed):
    runs = 300
    truth = path(speed, 0.4 * speed, 20.0)
    covariance = config.covariance[np.ix_([0, 1, 5], [0, 1, 5])]
    squares = []
    for seed in range(runs):
        _, fixes, estimates = fixes_of(config, truth, seed)
        error = error_of(estimates, truth)[np.flatnonzero(fixes)[-1]]
        squares.append(error @ np.linalg.solve(covariance, error))
    low, high = stats.chi2.interval(0.999, 3 * runs) / np.array(runs)
    assert low < np.mean(squares) < high


def test_estimate_follows_odometry_between_fixes():
    odometry, fixes, estimates = fixes_of(AmclConfig(), path(0.6, 0.2, 20.0), 3)
    ticks = np.flatnonzero(fixes)
    assert len(ticks) > 20
    for first, last in zip(ticks, ticks[1:]):
        between = slice(first, last)
        moved = planar.compose(planar.inverse(odometry[first]), odometry[between])
        np.testing.assert_allclose(estimates[between], planar.compose(estimates[first], moved), atol=1e-9)


def test_fixes_come_when_the_robot_has_moved_enough():
    _, fixes, _ = fixes_of(AmclConfig(), path(0.5, 0.0, 40.0), 0)
    assert np.diff(np.flatnonzero(fixes)).mean() * PERIOD_S * 0.5 == pytest.approx(0.2, abs=0.03)


def test_standing_amcl_gives_one_fix_and_keeps_its_error():
    truth = path(0.0, 0.0, 20.0)
    _, fixes, estimates = fixes_of(AmclConfig(), truth, 0)
    assert fixes.sum() == 1
    np.testing.assert_allclose(estimates, estimates[:1].repeat(len(truth), axis=0), atol=1e-12)


def test_updates_while_standing_wander_with_the_correlation_time():
    config = AmclConfig(update_standing=True, correlation_time_s=5.0)
    truth = path(0.0, 0.0, 4000.0)
    _, fixes, estimates = fixes_of(config, truth, 0)
    errors = error_of(estimates, truth)[fixes]
    assert len(errors) == pytest.approx(4000, abs=2)
    later = 5  # seconds, as fixes come each second
    correlation = np.mean(errors[:-later] * errors[later:], axis=0) / np.mean(errors**2, axis=0)
    np.testing.assert_allclose(correlation, np.exp(-1.0), atol=0.1)


def test_perfect_localisation_is_the_truth():
    config = dataclasses.replace(AmclConfig(), position_std=0.0, yaw_std=0.0)
    truth = path(0.6, 0.3, 5.0)
    _, fixes, estimates = fixes_of(config, truth, 0)
    np.testing.assert_allclose(error_of(estimates, truth)[fixes], 0.0, atol=1e-9)
