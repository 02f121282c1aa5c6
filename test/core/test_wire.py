import numpy as np
import pytest

from people_fusion.core.wire import UNOBSERVED_VARIANCE, headings


def test_headings_match_sampled_velocities():
    rng = np.random.default_rng(0)
    mean, covariance = np.array([0.0, 0.0, 0.0, 0.6, 0.8]), np.diag([0.0, 0.0, 0.0, 0.004, 0.009])
    covariance[3, 4] = covariance[4, 3] = 0.002
    velocities = rng.multivariate_normal(mean[3:], covariance[3:, 3:], 20_000)
    yaws, variances = headings(mean[None], covariance[None])
    sampled = np.arctan2(velocities[:, 1], velocities[:, 0])
    assert yaws[0] == pytest.approx(sampled.mean(), abs=0.01)
    assert variances[0] == pytest.approx(sampled.var(), rel=0.05)


def test_who_stands_has_no_heading():
    means, covariances = np.zeros((2, 6)), np.tile(0.04 * np.eye(6), (2, 1, 1))
    means[1, 3] = 0.01
    yaws, variances = headings(means, covariances)
    assert yaws.tolist() == [0.0, 0.0] and variances.tolist() == [UNOBSERVED_VARIANCE] * 2


def test_headings_do_not_depend_on_where_memory_is_free():
    rng = np.random.default_rng(0)
    taken, found = [], set()
    for _ in range(20_000):
        taken.append(np.zeros(int(rng.integers(1, 9))))
        if len(taken) > 50:
            taken.pop(int(rng.integers(0, 50)))
        mean = np.zeros((1, 5))
        mean[0, 3:] = 0.4970088600795994, 0.8000312391111559
        found.update(headings(mean, np.tile(0.01 * np.eye(5), (1, 1, 1)))[0].tolist())
    assert len(found) == 1
