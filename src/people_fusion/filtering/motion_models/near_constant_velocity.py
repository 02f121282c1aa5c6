"""Near constant velocity in the plane, random walk in height (Poschmann 2018, 3.2.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.filtering.motion import MOTION_MODELS, MotionModel


@dataclass(frozen=True)
class NearConstantVelocityConfig:
    """Noises of Poschmann eq. 3.4 and what is believed of a person before anything is seen."""

    velocity_variance_rate: float = parameter(0.8, "q_v: variance of each velocity per second, m^2/s^3", low=0.0)
    height_variance_rate: float = parameter(0.01, "q_z: variance of the height per second, m^2/s", low=0.0)
    initial_speed_std: float = parameter(0.8, "of each velocity of a new track, m/s", low=0.0)
    initial_height_std: float = parameter(0.3, "of the height of a new track that is not observed, metres", low=0.0)


@MOTION_MODELS.register("near_constant_velocity", NearConstantVelocityConfig)
class NearConstantVelocity(MotionModel):
    """State x y z vx vy."""

    dimension = 5

    def __init__(self, config: NearConstantVelocityConfig) -> None:
        self.config = config
        speed, height = config.initial_speed_std**2, config.initial_height_std**2
        self.initial_covariance = np.diag([0.0, 0.0, height, speed, speed])

    def transition(self, duration_s: float) -> Tuple[np.ndarray, np.ndarray]:
        """Eq. 3.2 and 3.3."""
        d, q_v, q_z = duration_s, self.config.velocity_variance_rate, self.config.height_variance_rate
        F = np.eye(5)
        F[0, 3] = F[1, 4] = d
        Q = np.zeros((5, 5))
        Q[0, 0] = Q[1, 1] = d**3 / 3 * q_v
        Q[0, 3] = Q[3, 0] = Q[1, 4] = Q[4, 1] = d**2 / 2 * q_v
        Q[3, 3] = Q[4, 4] = d * q_v
        Q[2, 2] = d * q_z
        return F, Q
