"""Gaussians in batches."""

from __future__ import annotations

import functools
from typing import Tuple

import numpy as np
import scipy.stats

from people_fusion.core.errors import DataError


@functools.lru_cache(maxsize=None)
def chi_square_threshold(probability: float, degrees_of_freedom: int) -> float:
    """Squared Mahalanobis distance below which a Gaussian lies with `probability` (SciPy takes 0.1 ms, so kept)."""
    return float(scipy.stats.chi2.ppf(probability, degrees_of_freedom))


def mahalanobis_squared(innovations: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(...) of innovations (..., d) and positive definite covariances (..., d, d), broadcast against each other.

    Eliminates by C = L D L' row by row over the whole batch; d is small and batches of tracks times detections large.
    """
    d = innovations.shape[-1]
    C = [[covariances[..., i, j] for j in range(i + 1)] for i in range(d)]
    v = [innovations[..., i] for i in range(d)]
    total = 0.0
    for k in range(d):
        total = total + v[k] * v[k] / C[k][k]
        for i in range(k + 1, d):
            factor = C[i][k] / C[k][k]
            v[i] = v[i] - factor * v[k]
            for j in range(k + 1, i + 1):
                C[i][j] = C[i][j] - factor * C[j][k]
    return np.asarray(total)


def covariance_intersection(means: np.ndarray, covariances: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """One Gaussian (d,), (d, d) of K >= 1 with unknown correlation; Volkhardt eq. 4-6, folded in the given order.

    Args:
        means: (K, d).
        covariances: (K, d, d), positive definite.
    """
    mean, C_1 = means[0], covariances[0]
    for other, C_2 in zip(means[1:], covariances[1:]):
        det_1, det_2 = np.linalg.det(C_1), np.linalg.det(C_2)
        omega = det_1 / (det_1 + det_2)  # eq. 5
        information_1, information_2 = (1.0 - omega) * np.linalg.inv(C_1), omega * np.linalg.inv(C_2)
        C_1 = np.linalg.inv(information_1 + information_2)  # eq. 4
        mean = C_1 @ (information_1 @ mean + information_2 @ other)  # eq. 6
    return mean, 0.5 * (C_1 + C_1.T)


def checked_covariance(covariance: np.ndarray, what: str = "covariance") -> np.ndarray:
    """The (..., d, d) covariance made exactly symmetric.

    Raises:
        DataError: if it is not finite, has a negative variance, is not symmetric or is indefinite beyond round-off.
    """
    covariance = np.asarray(covariance, dtype=float)
    if not np.isfinite(covariance).all():
        raise DataError(f"{what} is not finite")
    diagonal = np.diagonal(covariance, axis1=-2, axis2=-1)
    if (diagonal < 0.0).any():
        raise DataError(f"{what} has a negative variance", f"{diagonal.min():g}")
    # By correlations, as axes may be of other units or unknown; what is a million times smaller is round-off.
    stds = np.sqrt(diagonal)
    scale = np.maximum(stds, 1e-6 * stds.max(axis=-1, initial=0.0, keepdims=True))
    scale = np.where(scale > 0.0, scale, 1.0)
    correlations = covariance / (scale[..., :, None] * scale[..., None, :])
    if (np.abs(correlations - np.swapaxes(correlations, -1, -2)) > 1e-6).any():
        raise DataError(f"{what} is not symmetric")
    if (np.linalg.eigvalsh(correlations) < -1e-6).any():
        raise DataError(f"{what} is indefinite")
    return 0.5 * (covariance + np.swapaxes(covariance, -1, -2))
