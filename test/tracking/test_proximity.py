"""Two people are not in one place (Poschmann 2018, eq. 7.6 and 7.7)."""

from __future__ import annotations

import numpy as np
import pytest

from people_fusion.core.errors import ConfigError
from people_fusion.tracking.proximity import ProximityConfig, log_proximity

CONFIG = ProximityConfig(0.2, 0.6)


def literal(states, means, confirmed, config):
    """Eq. 7.6 and 7.7, particle by particle."""
    p = np.ones(states.shape[:2])
    for t in range(len(states)):
        for j in range(len(means)):
            if j == t or not confirmed[j]:
                continue
            for i in range(states.shape[1]):
                d = np.hypot(*(states[t, i, :2] - means[j, :2]))
                if d <= config.distance_min:
                    p[t, i] = 0.0
                elif d < config.distance_max:
                    p[t, i] *= (d - config.distance_min) / (config.distance_max - config.distance_min)
    return p


@pytest.mark.parametrize("seed", range(5))
def test_weights_are_those_of_the_equations(seed):
    rng = np.random.default_rng(seed)
    centres = rng.uniform(-1.0, 1.0, (5, 1, 5))
    states = centres + rng.normal(0.0, 0.3, (5, 40, 5))
    means, confirmed = states.mean(axis=1), rng.random(5) < 0.6
    found = np.exp(log_proximity(states, means, confirmed, CONFIG))
    np.testing.assert_allclose(found, literal(states, means, confirmed, CONFIG), atol=1e-12)
    assert (found < 1.0).any()


def test_nobody_pushes_himself_and_a_distance_of_zero_turns_it_off():
    states = np.zeros((1, 10, 5))
    assert not log_proximity(states, states[:, 0], np.array([True]), CONFIG).any()
    both = np.zeros((2, 10, 5))
    assert np.isneginf(log_proximity(both, both[:, 0], np.array([True, True]), CONFIG)).all()
    assert not log_proximity(both, both[:, 0], np.array([True, True]), ProximityConfig(0.2, 0.0)).any()


def test_distances_are_in_order():
    with pytest.raises(ConfigError, match="distance_max"):
        ProximityConfig(0.5, 0.4)
