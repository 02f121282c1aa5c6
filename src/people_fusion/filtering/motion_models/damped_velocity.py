"""Velocity as an Ornstein-Uhlenbeck process: people keep walking for a while and then do something else.

Near constant velocity lets the velocity's variance grow for ever, so that a person behind a pillar is believed to run
away. Here velocity decays with a time constant towards a stationary spread of walking speeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.filtering.motion import MOTION_MODELS, MotionModel


@dataclass(frozen=True)
class DampedVelocityConfig:
    """Time constant and stationary spread of the velocity."""

    time_constant_s: float = parameter(1.5, "after which a velocity is forgotten to 1/e, seconds", low=0.05)
    speed_std: float = parameter(0.7, "stationary deviation of vx and vy, m/s", low=1e-3)
    height_variance_rate: float = parameter(0.01, "variance of the height per second, m^2/s", low=0.0)
    initial_height_std: float = parameter(0.3, "of the height of a new track that is not observed, metres", low=0.0)


@MOTION_MODELS.register("damped_velocity", DampedVelocityConfig)
class DampedVelocity(MotionModel):
    """State x y z vx vy;  dv = -v/tau dt + sqrt(2 s^2/tau) dW,  dx = v dt, integrated exactly."""

    dimension = 5

    def __init__(self, config: DampedVelocityConfig) -> None:
        self.config = config
        speed = config.speed_std**2
        self.initial_covariance = np.diag([0.0, 0.0, config.initial_height_std**2, speed, speed])

    def transition(self, duration_s: float) -> Tuple[np.ndarray, np.ndarray]:
        """Closed form of the integrated Ornstein-Uhlenbeck process (Uhlenbeck & Ornstein 1930)."""
        d, tau, variance = duration_s, self.config.time_constant_s, self.config.speed_std**2
        decay = math.exp(-d / tau)
        way = tau * -math.expm1(-d / tau)
        F = np.eye(5)
        F[0, 3] = F[1, 4] = way
        F[3, 3] = F[4, 4] = decay
        Q = np.zeros((5, 5))
        # The closed form loses all digits for d << tau; there its series is exact to 1e-9 of the value.
        u = d / tau
        closed = 2 * u - 2 * way / tau - (way / tau) ** 2 if u > 2e-3 else u**3 * (2 / 3 - u / 2 + 7 / 30 * u**2)
        position = variance * tau**2 * closed
        Q[0, 0] = Q[1, 1] = position
        Q[0, 3] = Q[3, 0] = Q[1, 4] = Q[4, 1] = variance * way**2 / tau
        Q[3, 3] = Q[4, 4] = variance * (1 - decay**2)
        Q[2, 2] = d * self.config.height_variance_rate
        return F, Q
