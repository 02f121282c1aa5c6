"""Constant velocity in space under a normally distributed acceleration (Volkhardt 2013, III-C 4, eq. 7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.filtering.motion import MOTION_MODELS, MotionModel


@dataclass(frozen=True)
class ConstantVelocity3dConfig:
    """Acceleration noise, and what is believed of a person before anything is seen."""

    acceleration_std: float = parameter(2.0, "of the acceleration in the plane, constant over a step, m/s^2", low=0.0)
    vertical_acceleration_std: float = parameter(0.3, "of the vertical acceleration, m/s^2", low=0.0)
    initial_speed_std: float = parameter(0.8, "of vx and vy of a new track, m/s", low=0.0)
    initial_vertical_speed_std: float = parameter(0.1, "of vz of a new track, m/s", low=0.0)
    initial_height_std: float = parameter(0.3, "of the height of a new track that is not observed, metres", low=0.0)


@MOTION_MODELS.register("constant_velocity_3d", ConstantVelocity3dConfig)
class ConstantVelocity3d(MotionModel):
    """State x y z vx vy vz."""

    dimension = 6

    def __init__(self, config: ConstantVelocity3dConfig) -> None:
        self._acceleration = np.array(
            [config.acceleration_std, config.acceleration_std, config.vertical_acceleration_std]
        )
        speed, vertical = config.initial_speed_std**2, config.initial_vertical_speed_std**2
        self.initial_covariance = np.diag([0.0, 0.0, config.initial_height_std**2, speed, speed, vertical])

    def transition(self, duration_s: float) -> Tuple[np.ndarray, np.ndarray]:
        """F and G diag(a^2) G', where G maps an acceleration held over the step to the state."""
        d = duration_s
        F = np.eye(6)
        F[:3, 3:] = d * np.eye(3)
        G = np.vstack([d**2 / 2 * np.eye(3), d * np.eye(3)]) * self._acceleration
        return F, G @ G.T
