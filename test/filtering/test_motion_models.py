"""All motion models against numeric integration and their own semigroup property."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from people_fusion.core.config import parse
from people_fusion.filtering.motion import MOTION_MODELS
from people_fusion.filtering.motion_models.damped_velocity import DampedVelocity, DampedVelocityConfig
from people_fusion.filtering.motion_models.near_constant_velocity import (
    NearConstantVelocity,
    NearConstantVelocityConfig,
)

NAMES = MOTION_MODELS.names()
durations = st.floats(1e-4, 3.0)


def build(name):
    return MOTION_MODELS.build(parse(MOTION_MODELS.config_of(name, "motion"), {}))


def test_the_models_of_the_papers_are_there():
    assert {"near_constant_velocity", "constant_velocity_3d", "damped_velocity"} <= set(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_no_time_changes_nothing(name):
    transition, noise = build(name).transition(0.0)
    np.testing.assert_allclose(transition, np.eye(len(transition)))
    np.testing.assert_allclose(noise, 0.0, atol=1e-15)


@pytest.mark.parametrize("name", NAMES)
@given(duration=durations)
def test_noise_is_a_covariance(name, duration):
    _, noise = build(name).transition(duration)
    np.testing.assert_allclose(noise, noise.T)
    assert np.linalg.eigvalsh(noise).min() >= -1e-12


@pytest.mark.parametrize("name", ["near_constant_velocity", "damped_velocity"])
@given(first=durations, second=durations)
def test_two_steps_equal_one_long_step(name, first, second):
    model = build(name)
    (f1, q1), (f2, q2), (f, q) = model.transition(first), model.transition(second), model.transition(first + second)
    np.testing.assert_allclose(f2 @ f1, f, atol=1e-12)
    np.testing.assert_allclose(f2 @ q1 @ f2.T + q2, q, rtol=1e-6, atol=1e-10)


def test_near_constant_velocity_integrates_equation_3_3():
    model = NearConstantVelocity(NearConstantVelocityConfig(velocity_variance_rate=0.7, height_variance_rate=0.2))
    density = np.diag([0, 0, 0.2, 0.7, 0.7])
    times = np.linspace(0, 0.8, 4001)
    integrand = np.array([model.transition(t)[0] @ density @ model.transition(t)[0].T for t in times])
    np.testing.assert_allclose(model.transition(0.8)[1], np.trapz(integrand, times, axis=0), atol=1e-6)


def test_damped_velocity_forgets_its_velocity_but_not_its_spread():
    model = DampedVelocity(DampedVelocityConfig(time_constant_s=1.0, speed_std=0.7))
    transition, noise = model.transition(30.0)
    assert abs(transition[3, 3]) < 1e-12
    assert noise[3, 3] == pytest.approx(0.7**2)


@pytest.mark.parametrize("duration", np.geomspace(1e-6, 3.0, 60).tolist())
def test_damped_velocity_is_exact_at_any_step(duration):
    """Position variance against its power series, where that converges quickly, and the closed form elsewhere."""
    tau, speed = 1.5, 0.7
    noise = DampedVelocity(DampedVelocityConfig(time_constant_s=tau, speed_std=speed)).transition(duration)[1]
    u = duration / tau
    terms = [(-u) ** k * (4.0 - 2.0**k) / math.factorial(k) for k in range(3, 60)]
    assert noise[0, 0] == pytest.approx(speed**2 * tau**2 * math.fsum(terms), rel=1e-8, abs=0.0)
