"""Odometry that drifts and a localisation whose published covariance is that of its real error."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.transforms import DriftConfig
from people_fusion.simulation import planar

AT_REST = 1e-9  # metres and radians between two readings


@dataclass(frozen=True)
class AmclConfig:
    """A localisation like AMCL.

    Its error is slow: a Gauss-Markov process over time whose value at each fix is normal with the published covariance.
    """

    position_std: float = parameter(0.05, "of x and of y, metres", low=0.0)
    yaw_std: float = parameter(0.02, "radians", low=0.0)
    correlation_time_s: float = parameter(20.0, "of the error, seconds", low=0.1)
    update_distance: float = parameter(0.2, "a new fix after so many metres", low=0.0)
    update_angle: float = parameter(0.26, "or after such a turn, radians", low=0.0)
    update_standing: bool = parameter(
        False,
        "fixes while the robot stands, too. AMCL does not do that: its error then stays as it is at the first fix, one "
        "draw for a whole recording. Localisations that filter each scan do, and their error wanders",
    )
    standing_period_s: float = parameter(1.0, "between such fixes, seconds", low=0.02)
    transform_tolerance_s: float = parameter(0.0, "how far map -> odom is dated ahead, seconds", low=0.0)

    @property
    def covariance(self) -> np.ndarray:
        """(6, 6) published; what is not estimated (z, roll, pitch) is known to be zero."""
        variances = np.zeros(6)
        variances[[0, 1, 5]] = [self.position_std**2, self.position_std**2, self.yaw_std**2]
        return np.diag(variances)


def drift(true_poses: np.ndarray, config: DriftConfig, rng: np.random.Generator) -> np.ndarray:
    """(T, 3) odometry of a robot that moved along true poses (T, 3); it starts at zero.

    Errors of the increments are independent; their variances grow with the way (Thrun et al. 2005, 5.4).
    """
    increments = planar.compose(planar.inverse(true_poses[:-1]), true_poses[1:])
    # A robot that stands moves by rounding alone, which the roots below would make nanometres of.
    increments[np.abs(increments) < AT_REST] = 0.0
    metres = np.linalg.norm(increments[:, :2], axis=1)
    radians = np.abs(increments[:, 2])
    translation_std = np.sqrt(config.translation_per_metre**2 * metres + config.translation_per_radian**2 * radians)
    rotation_std = np.sqrt(config.rotation_per_radian**2 * radians + config.rotation_per_metre**2 * metres)
    std = np.stack([translation_std, translation_std, rotation_std], axis=1)
    measured = increments + std * rng.standard_normal(increments.shape)
    yaws = np.concatenate([[0.0], np.cumsum(measured[:, 2])])
    steps = planar.rotate(yaws[:-1], measured[:, :2])
    positions = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    return np.concatenate([positions, yaws[:, None]], axis=1)


def localise(
    true_poses: np.ndarray, odometry: np.ndarray, period_s: float, config: AmclConfig, rng: np.random.Generator
) -> Tuple[np.ndarray, np.ndarray]:
    """Fixes and the transform that they lead to.

    Args:
        true_poses, odometry: (T, 3) map_from_base and odom_from_base, every `period_s`.

    Returns:
        (T,) whether there is a new fix, (T, 3) map_from_odom. At a fix, map_from_odom and odometry make the estimate;
        in between, the estimate follows the odometry.
    """
    std = np.array([config.position_std, config.position_std, config.yaw_std])
    error = std * rng.standard_normal(3)
    fixes = np.zeros(len(true_poses), dtype=bool)
    map_from_odom = np.zeros_like(true_poses)
    last = 0
    for tick, pose in enumerate(true_poses):
        moved = odometry[tick] - odometry[last]
        elapsed_s = (tick - last) * period_s
        far = np.hypot(moved[0], moved[1]) > config.update_distance or abs(moved[2]) > config.update_angle
        fixes[tick] = tick == 0 or far or (config.update_standing and elapsed_s >= config.standing_period_s - 1e-9)
        if fixes[tick]:
            keep = np.exp(-elapsed_s / config.correlation_time_s)
            error = keep * error + np.sqrt(1.0 - keep**2) * std * rng.standard_normal(3)
            estimate = pose - error  # truth = estimate + error, see core.poses
            map_from_odom[tick] = planar.compose(estimate, planar.inverse(odometry[tick]))
            last = tick
        else:
            map_from_odom[tick] = map_from_odom[tick - 1]
    return fixes, map_from_odom
