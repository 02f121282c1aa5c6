"""What live nodes and recordings must write into messages alike."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from people_fusion.core.angles import bearings

UNOBSERVED_VARIANCE = 1e6  # stands for «not observed»
DETECTIONS_PER_MESSAGE = 1 << 16  # detection_id counts a cue's messages in steps of this


def headings(means: np.ndarray, covariances: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Directions of motion (T,) and their variances (T,), radians, of tracks (T, D) with covariances (T, D, D).

    Linearised: var(yaw) = J C J' with J = (-vy, vx) / |v|^2, the variance of the velocity across its direction over the
    squared speed. Who hardly moves has no direction: 0 with the variance of what is not observed.
    """
    velocities = means[:, 3:5]
    speeds_squared = (velocities**2).sum(axis=1)
    across = np.column_stack([-velocities[:, 1], velocities[:, 0]])
    spreads = np.einsum("ti,tij,tj->t", across, covariances[:, 3:5, 3:5], across)
    unknown = spreads >= math.pi**2 / 3.0 * speeds_squared**2  # no better than a uniform direction
    variances = np.where(unknown, UNOBSERVED_VARIANCE, spreads / np.where(unknown, 1.0, speeds_squared**2))
    return np.where(unknown, 0.0, bearings(velocities)), variances
