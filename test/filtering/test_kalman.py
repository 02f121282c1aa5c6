"""Kalman filters in batches against textbook formulas and against estimating the bias jointly."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from people_fusion.filtering.kalman import consider_innovation_covariances, consider_update, predict, update


def random_covariances(rng, count, size):
    factors = rng.normal(size=(count, size, size))
    return factors @ factors.swapaxes(-1, -2) + 0.1 * np.eye(size)


@given(seed=st.integers(0, 2**32 - 1))
def test_batch_update_equals_information_form_one_by_one(seed):
    rng = np.random.default_rng(seed)
    means, covariances = rng.normal(size=(4, 5)), random_covariances(rng, 4, 5)
    observation, noises = rng.normal(size=(2, 5)), random_covariances(rng, 4, 2)
    measured = rng.normal(size=(4, 2))
    innovations = measured - means @ observation.T
    spread = observation @ covariances @ observation.T + noises
    new_means, new_covariances = update(means, covariances, innovations, observation, spread)
    for row in range(4):
        information = np.linalg.inv(covariances[row]) + observation.T @ np.linalg.inv(noises[row]) @ observation
        expected = np.linalg.inv(information)
        seen = observation.T @ np.linalg.inv(noises[row]) @ measured[row]
        vector = np.linalg.inv(covariances[row]) @ means[row] + seen
        np.testing.assert_allclose(new_covariances[row], expected, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(new_means[row], expected @ vector, rtol=1e-6, atol=1e-8)


@given(seed=st.integers(0, 2**32 - 1))
def test_prediction_is_linear_propagation(seed):
    rng = np.random.default_rng(seed)
    means, covariances = rng.normal(size=(3, 4)), random_covariances(rng, 3, 4)
    transition, noise = rng.normal(size=(4, 4)), random_covariances(rng, 1, 4)[0]
    new_means, new_covariances = predict(means, covariances, transition, noise)
    for row in range(3):
        np.testing.assert_allclose(new_means[row], transition @ means[row], atol=1e-10)
        expected = transition @ covariances[row] @ transition.T + noise
        np.testing.assert_allclose(new_covariances[row], expected, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_considered_bias_equals_an_augmented_filter_whose_bias_gain_is_zero(seed):
    rng = np.random.default_rng(seed)
    joint = random_covariances(rng, 1, 7)[0]
    states, bias, cross = joint[:5, :5], joint[5:, 5:], joint[:5, 5:]
    observation, jacobian = rng.normal(size=(2, 5)), rng.normal(size=(2, 2))
    noise, innovation, mean = random_covariances(rng, 1, 2)[0], rng.normal(size=2), rng.normal(size=5)
    spread = consider_innovation_covariances(states[None], cross[None], observation, jacobian[None], bias, noise[None])
    new_mean, new_states, new_cross = consider_update(
        mean[None], states[None], cross[None], innovation[None], observation, jacobian[None], bias, spread
    )
    whole = np.hstack([observation, jacobian])
    np.testing.assert_allclose(spread[0], whole @ joint @ whole.T + noise, atol=1e-9)
    gain = joint @ whole.T @ np.linalg.inv(spread[0])
    gain[5:] = 0.0
    left = np.eye(7) - gain @ whole
    expected = left @ joint @ left.T + gain @ noise @ gain.T
    np.testing.assert_allclose(new_mean[0], mean + gain[:5] @ innovation, atol=1e-8)
    np.testing.assert_allclose(new_states[0], expected[:5, :5], atol=1e-7)
    np.testing.assert_allclose(new_cross[0], expected[:5, 5:], atol=1e-7)
