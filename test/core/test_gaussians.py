"""Gaussians in batches."""

import numpy as np
import pytest
import scipy.stats
from hypothesis import given
from hypothesis import strategies as st
from poses_at_random import random_covariance

from people_fusion.core.errors import DataError
from people_fusion.core.gaussians import (
    checked_covariance,
    chi_square_threshold,
    covariance_intersection,
    mahalanobis_squared,
)

seeds = st.integers(0, 10_000)


@given(seeds, st.integers(1, 6))
def test_mahalanobis_distance_is_that_of_a_linear_solver(seed, size):
    rng = np.random.default_rng(seed)
    covariances = np.array([random_covariance(rng, size=size) + 0.01 * np.eye(size) for _ in range(4)])
    innovations = rng.normal(size=(3, 4, size))
    kept = innovations.copy(), covariances.copy()
    solved = np.linalg.solve(covariances, innovations[..., None])[..., 0]
    np.testing.assert_allclose(mahalanobis_squared(innovations, covariances), np.sum(innovations * solved, axis=-1))
    np.testing.assert_array_equal(innovations, kept[0])
    np.testing.assert_array_equal(covariances, kept[1])


def test_gate_is_the_one_of_poschmann():
    assert chi_square_threshold(0.99, 3) == pytest.approx(11.345, abs=5e-4)
    assert chi_square_threshold(0.95, 2) == scipy.stats.chi2.ppf(0.95, 2)


def test_intersection_follows_volkhardt_equations_4_to_6():
    C_1, C_2 = np.diag([1.0, 4.0]), np.diag([2.0, 6.0])
    mean, covariance = covariance_intersection(np.array([[0.0, 0.0], [1.0, 2.0]]), np.array([C_1, C_2]))
    omega = 4.0 / 16.0
    expected = 1.0 / ((1.0 - omega) / np.diag(C_1) + omega / np.diag(C_2))
    np.testing.assert_allclose(covariance, np.diag(expected))
    np.testing.assert_allclose(mean, expected * omega / np.diag(C_2) * [1.0, 2.0])


def test_intersection_of_one_is_itself_and_of_equals_too():
    covariance = random_covariance(np.random.default_rng(0), size=3)
    for count in (1, 2, 5):
        mean, fused = covariance_intersection(np.tile([1.0, 2.0, 3.0], (count, 1)), np.tile(covariance, (count, 1, 1)))
        np.testing.assert_allclose(mean, [1.0, 2.0, 3.0])
        np.testing.assert_allclose(fused, covariance)


@given(seeds)
def test_intersection_is_never_overconfident_whatever_the_correlation(seed):
    rng = np.random.default_rng(seed)
    joint = random_covariance(rng, 1.0, size=4) + 1e-3 * np.eye(4)
    C = np.array([joint[:2, :2], joint[2:, 2:]])
    columns = []
    for unit in np.eye(4):
        columns.append(covariance_intersection(unit.reshape(2, 2), C)[0])
    gain = np.array(columns).T  # the fused mean is linear in the two means
    actual = gain @ joint @ gain.T
    assert np.linalg.eigvalsh(covariance_intersection(np.zeros((2, 2)), C)[1] - actual).min() > -1e-9


def test_covariance_is_made_symmetric():
    covariance = np.array([[1.0, 0.2], [0.2 + 1e-9, 1.0]])
    checked = checked_covariance(covariance)
    assert (checked == checked.T).all()
    np.testing.assert_allclose(checked_covariance(np.zeros((5, 3, 3))), 0.0)


@pytest.mark.parametrize(
    ("covariance", "reason"),
    [
        ([[1.0, 0.0], [0.0, -0.1]], "negative variance"),
        ([[1.0, 0.5], [0.0, 1.0]], "not symmetric"),
        ([[1.0, 2.0], [2.0, 1.0]], "indefinite"),
        ([[np.nan, 0.0], [0.0, 1.0]], "not finite"),
    ],
)
def test_what_is_no_covariance_is_refused_by_name(covariance, reason):
    with pytest.raises(DataError, match="pose covariance.*" + reason) as caught:
        checked_covariance(np.array(covariance), "pose covariance")
    assert reason in caught.value.reason


@pytest.mark.parametrize("unknown", [1.0, 1e6, 1e9])
def test_axis_that_is_unknown_hides_no_nonsense_on_the_others(unknown):
    covariance = np.diag([0.01, 0.01, unknown])
    np.testing.assert_array_equal(checked_covariance(covariance), covariance)
    for asymmetric, reason in ((0.05, "indefinite"), (0.0, "not symmetric")):
        wrong = covariance.copy()
        wrong[0, 1], wrong[1, 0] = 0.05, asymmetric
        with pytest.raises(DataError, match=reason):
            checked_covariance(wrong)
        with pytest.raises(DataError, match=reason):
            checked_covariance(np.array([covariance, wrong]))


@given(seeds)
def test_covariance_of_the_plane_is_one_however_it_is_turned(seed):
    rng = np.random.default_rng(seed)
    flat = np.zeros((6, 6))
    flat[np.ix_([0, 1, 5], [0, 1, 5])] = random_covariance(rng, size=3)
    for turn in (rng.normal(0.0, 1e-9, (6, 6)), rng.normal(size=(6, 6))):
        turned = (np.eye(6) + turn) @ flat @ (np.eye(6) + turn).T
        np.testing.assert_allclose(checked_covariance(turned), turned, atol=1e-9)
