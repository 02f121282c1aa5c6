"""People stop and go: constant velocity mixed with a random walk, one of the two for each particle at a time.

A jump Markov system (Blom & Bar-Shalom 1988), as Poschmann 2018, 8.1 asks for: a particle stops or starts with a given
rate; one that stands has no velocity, one that starts may go anywhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter


@dataclass(frozen=True)
class WalkingConfig:
    """How often people stop and go."""

    stop_rate: float = parameter(0.0, "how often one who walks stops, 1/s; 0: everybody always walks", low=0.0)
    start_rate: float = parameter(0.3, "how often one who stands starts, 1/s", low=0.0)
    standing_variance_rate: float = parameter(0.01, "of each position of one who stands, m^2/s", low=0.0)
    start_speed_std: float = parameter(0.8, "of each velocity of one who starts, m/s", low=0.0)


class Walking:
    """Modes of particles (T, N) bool, whether each walks; states (T, N, D) begin with x y z vx vy."""

    def __init__(self, config: WalkingConfig) -> None:
        self.config = config

    def begin(self, shape: Tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
        """Modes of new particles, as often as each mode is met."""
        config = self.config
        if config.stop_rate == 0.0:
            return np.ones(shape, dtype=bool)
        share = config.start_rate / (config.start_rate + config.stop_rate)
        return np.asarray(rng.random(shape) < share)

    def change(
        self, walks: np.ndarray, states: np.ndarray, duration_s: float, rng: np.random.Generator
    ) -> Tuple[np.ndarray, np.ndarray]:
        """Modes and states of those who stop or start within a duration, before the step."""
        config = self.config
        if config.stop_rate == 0.0:
            return walks, states
        chance = rng.random(walks.shape)
        rates = np.where(walks, config.stop_rate, config.start_rate)
        changes = chance < -np.expm1(-rates * duration_s)
        walks, states = walks ^ changes, states.copy()
        starts = changes & walks
        states[..., 3:][~walks] = 0.0
        states[..., 3:5][starts] = config.start_speed_std * rng.standard_normal((np.count_nonzero(starts), 2))
        return walks, states

    def mixed(
        self, walks: np.ndarray, states: np.ndarray, walked: np.ndarray, duration_s: float, rng: np.random.Generator
    ) -> np.ndarray:
        """(T, N, D) after the step: `walked` of those who walk; who stands hardly moves from `states` on the ground.

        The height goes by the motion model in either case.
        """
        if self.config.stop_rate == 0.0:
            return walked
        stood = walked.copy()
        std = np.sqrt(self.config.standing_variance_rate * duration_s)
        stood[..., :2] = states[..., :2] + std * rng.standard_normal((*walks.shape, 2))
        stood[..., 3:] = states[..., 3:]
        return np.where(walks[..., None], walked, stood)
