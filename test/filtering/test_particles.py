"""Particles against filters that are exact: Kalman's where all is linear, a grid's where it is not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from people_fusion.filtering import kalman
from people_fusion.filtering.motion_models.near_constant_velocity import (
    NearConstantVelocity,
    NearConstantVelocityConfig,
)
from people_fusion.filtering.particles import draw, effective_size, predict, resampled, root, summary, weighed

MOTION = NearConstantVelocity(NearConstantVelocityConfig())


def generator(seed=0):
    return np.random.Generator(np.random.PCG64(seed))


def test_prediction_moves_mean_and_covariance_as_kalman_does():
    rng = generator()
    mean, covariance = np.array([[1.0, 2.0, 1.7, 0.5, -0.5]]), np.diag([0.1, 0.2, 0.01, 0.3, 0.1])[None]
    F, Q = MOTION.transition(0.7)
    states = predict(draw(mean, covariance, 200_000, rng), F, Q, rng)
    means, covariances = summary(states, np.full(states.shape[:2], 1.0 / states.shape[1]))
    expected = kalman.predict(mean, covariance, F, Q)
    np.testing.assert_allclose(means, expected[0], atol=0.01)
    np.testing.assert_allclose(covariances, expected[1], atol=0.01)


@pytest.mark.parametrize("roughening", [0.0, 0.1])
def test_gaussian_measurements_give_kalmans_posterior(roughening):
    """Ten steps of a walk, many particles: mean and covariance within Monte Carlo error of the exact ones."""
    rng, truth = generator(3), np.random.default_rng(5)
    H, R = np.eye(3, 5), np.diag([0.1, 0.1, 0.05]) ** 2
    mean, covariance = np.array([[0.0, 0.0, 1.7, 0.0, 0.0]]), np.diag([0.04, 0.04, 0.01, 0.64, 0.64])[None]
    states = draw(mean, covariance, 100_000, rng)
    weights = np.full(states.shape[:2], 1.0 / states.shape[1])
    F, Q = MOTION.transition(0.1)
    for step in range(10):
        z = np.array([0.1 * step, 0.02 * step, 1.7]) + truth.normal(0.0, np.sqrt(np.diag(R)))
        mean, covariance = kalman.predict(mean, covariance, F, Q)
        mean, covariance = kalman.update(mean, covariance, z - mean @ H.T, H, H @ covariance @ H.T + R)
        states = predict(states, F, Q, rng)
        offsets = states[..., :3] - z
        weights = weighed(weights, -0.5 * np.square(offsets / np.sqrt(np.diag(R))).sum(axis=2))
        states, weights, _ = resampled(states, weights, rng, 0.5, roughening)
    means, covariances = summary(states, weights)
    stds = np.sqrt(np.diagonal(covariance[0]))
    np.testing.assert_allclose((means - mean)[0] / stds, 0.0, atol=0.03)
    np.testing.assert_allclose(covariances[0] / np.outer(stds, stds), covariance[0] / np.outer(stds, stds), atol=0.05)


def test_bimodal_posterior_is_a_grid_filters():
    """A walk on a line that is seen by its distance from the origin: left and right are both possible."""
    rng, edges = generator(1), np.linspace(-4.0, 4.0, 801)
    middles = 0.5 * (edges[1:] + edges[:-1])
    grid = np.exp(-0.5 * np.square(middles / 1.5))
    states = 1.5 * rng.standard_normal((1, 100_000, 1))
    weights = np.full(states.shape[:2], 1.0 / states.shape[1])
    step_std, seen_std = 0.2, 0.15
    kernel = np.exp(-0.5 * np.square((middles[:, None] - middles) / step_std))
    for z in (0.5, 0.7, 0.9, 1.2):
        grid = kernel @ grid * np.exp(-0.5 * np.square((np.abs(middles) - z) / seen_std))
        states = predict(states, np.eye(1), np.array([[step_std**2]]), rng)
        weights = weighed(weights, -0.5 * np.square((np.abs(states[..., 0]) - z) / seen_std))
        states, weights, _ = resampled(states, weights, rng, 0.5, 0.0)
    expected = np.cumsum(grid) / grid.sum()
    histogram = np.histogram(states[0, :, 0], edges, weights=weights[0])[0]
    assert np.abs(np.cumsum(histogram) - expected).max() < 0.02


@given(seed=st.integers(0, 10_000), tracks=st.integers(1, 4), count=st.integers(2, 60))
@settings(max_examples=50, deadline=None)
def test_drawing_anew_keeps_tracks_apart_and_weights_normal(seed, tracks, count):
    rng = generator(seed)
    states = rng.standard_normal((tracks, count, 3)) + 100.0 * np.arange(tracks)[:, None, None]
    weights = rng.random((tracks, count)) ** 6 + 1e-12
    weights /= weights.sum(axis=1, keepdims=True)
    assert np.all((effective_size(weights) >= 1.0 - 1e-9) & (effective_size(weights) <= count + 1e-9))
    drawn, even, chosen = resampled(states, weights, rng, 0.9, 0.1)
    np.testing.assert_allclose(even.sum(axis=1), 1.0)
    poor = effective_size(weights) < 0.9 * count
    np.testing.assert_array_equal(drawn[~poor], states[~poor])
    np.testing.assert_array_equal(even[poor], 1.0 / count)
    assert np.abs(drawn - 100.0 * np.arange(tracks)[:, None, None]).max() < 20.0
    assert chosen.min() >= 0 and chosen.max() < count


def test_roughening_keeps_mean_and_covariance_and_makes_all_particles_differ():
    rng = generator(2)
    states = rng.standard_normal((1, 50_000, 2)) @ np.array([[1.0, 0.5], [0.0, 0.2]])
    weights = weighed(np.full((1, 50_000), 1.0 / 50_000), -8.0 * states[..., 0] ** 2)
    before = summary(states, weights)
    drawn, even, _ = resampled(states, weights, rng, 0.99, 0.3)
    after = summary(drawn, even)
    np.testing.assert_allclose(after[0], before[0], atol=0.01)
    np.testing.assert_allclose(after[1], before[1], atol=0.005)
    assert len(np.unique(drawn[0, :, 0])) == drawn.shape[1]


def test_weights_stay_where_no_particle_is_possible():
    weights = np.array([[0.3, 0.7], [0.5, 0.5]])
    logs = np.array([[-np.inf, -np.inf], [-np.inf, -2000.0]])
    np.testing.assert_allclose(weighed(weights, logs), [[0.3, 0.7], [0.0, 1.0]])


def test_nobody_is_nothing_to_do():
    states, weights = np.zeros((0, 10, 5)), np.zeros((0, 10))
    assert weighed(weights, np.zeros((0, 10))).shape == (0, 10)
    assert resampled(states, weights, generator(), 0.5, 0.1)[0].shape == (0, 10, 5)
    assert summary(states, weights)[1].shape == (0, 5, 5)


def test_root_of_a_singular_covariance():
    C = np.array([[1.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_allclose(root(C) @ root(C).T, C, atol=1e-12)


def test_filter_is_consistent_where_the_model_is_true():
    """NEES of 500 particles over 120 walks within 0.8 to 1.25 of its dimension."""
    runs, steps = 120, 40
    F, Q = MOTION.transition(0.1)
    truth_rng, rng = np.random.default_rng(7), generator(7)
    start = np.diag([0.1, 0.1, 0.1, 0.5, 0.5]) ** 2
    truth = truth_rng.multivariate_normal(np.zeros(5), start, size=runs)
    states = draw(np.zeros((runs, 5)), np.repeat(start[None], runs, axis=0), 500, rng)
    weights = np.full((runs, 500), 1.0 / 500)
    R, nees = 0.1, []
    for _ in range(steps):
        truth = truth @ F.T + truth_rng.multivariate_normal(np.zeros(5), Q, size=runs)
        z = truth[:, :3] + truth_rng.normal(0.0, R, size=(runs, 3))
        states = predict(states, F, Q, rng)
        weights = weighed(weights, -0.5 * np.square((states[..., :3] - z[:, None]) / R).sum(axis=2))
        states, weights, _ = resampled(states, weights, rng, 0.5, 0.5)
        means, covariances = summary(states, weights)
        errors = means - truth
        nees.append(np.einsum("ti,tij,tj->t", errors, np.linalg.inv(covariances), errors))
    assert 0.8 < np.mean(nees) / 5.0 < 1.25
    assert np.mean(np.array(nees) > chi2.ppf(0.99, 5)) < 0.05
