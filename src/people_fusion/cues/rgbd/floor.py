"""The floor: where the transform expects it, corrected by what is seen of it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

NEAR_M, NEAR_PER_M = 0.15, 0.04  # what is this close to the expected floor, and so much more by distance, may be it
SURE_M, SURE_PER_M = 0.04, 0.01  # the same at the end of the fit
ROUNDS = 5
SAMPLES = 3000  # points are enough
LOOKS = 100.0  # independent ones at most: neighbours err alike
ROUGHNESS_M = 0.015  # of floors, and of what lies on them


class Floor(NamedTuple):
    """A nearly level plane z = c + a x + b y, in level axes.

    Attributes:
        plane: (3,) c, metres, and a and b; zero is the floor that the transform tells.
        covariance: (3, 3) of it.
        seen: share of the points that may be floor by the transform which are so; NaN where there are too few.
        rms: of the distances of those, metres.
    """

    plane: np.ndarray
    covariance: np.ndarray
    seen: float
    rms: float

    def heights(self, points: np.ndarray) -> np.ndarray:
        """(N,) over the floor of points (N, 3), metres."""
        c, a, b = self.plane.astype(points.dtype).tolist()
        return np.asarray(points[:, 2] - (c + a * points[:, 0] + b * points[:, 1]))

    def variances(self, points: np.ndarray) -> np.ndarray:
        """(N,) of the floor's height beneath points (N, 2 or more), metres^2."""
        A = _design(points)
        return np.asarray(np.einsum("ni,ij,nj->n", A, self.covariance, A))


def fit_floor(points: np.ndarray, depth_stds: np.ndarray, height_std: float, tilt_std: float, min_points: int) -> Floor:
    """The floor that fits points (N, 3) best, in level axes whose z = 0 is the floor by the transform.

    Maximum a posteriori by least squares over what is near the floor of the round before; what is seen of a floor
    weighs against what the transform is good for, so that of little floor comes little correction.

    Args:
        points: in axes with the camera above the origin, metres.
        depth_stds: (N,) of them, metres.
        height_std, tilt_std: of the transform, metres and radians.
        min_points: fewer are no floor.
    """
    stds = np.array([height_std, tilt_std, tilt_std])
    prior = np.diag(1.0 / stds**2)
    expected = Floor(np.zeros(3), np.diag(stds**2), np.nan, np.nan)
    distances = np.hypot(points[:, 0], points[:, 1])
    near = np.flatnonzero(np.abs(points[:, 2]) < NEAR_M + NEAR_PER_M * distances)
    if len(near) < min_points:
        return expected
    near = near[:: max(len(near) // SAMPLES, 1)]
    A, z, distances = _design(points[near]), points[near, 2].astype(float), distances[near]
    weights = 1.0 / (ROUGHNESS_M**2 + depth_stds[near].astype(float) ** 2)
    plane, covariance = np.zeros(3), np.diag(stds**2)
    for part in np.linspace(1.0, 0.0, ROUNDS):
        limit = part * (NEAR_M + NEAR_PER_M * distances) + (1.0 - part) * (SURE_M + SURE_PER_M * distances)
        fits = np.abs(z - A @ plane) < limit
        count = int(fits.sum())
        if count < min(min_points, len(near)) // 4:
            return expected
        W_A = A[fits] * (weights[fits] * min(1.0, LOOKS / count))[:, None]
        covariance = np.linalg.inv(A[fits].T @ W_A + prior)
        plane = covariance @ (W_A.T @ z[fits])
    return Floor(plane, covariance, float(fits.mean()), float(np.sqrt(np.mean((z - A @ plane)[fits] ** 2))))


def _design(points: np.ndarray) -> np.ndarray:
    return np.column_stack([np.ones(len(points)), points[:, 0], points[:, 1]]).astype(float)
