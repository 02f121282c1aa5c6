"""Which pairs of track and detection are worth a thought."""

from __future__ import annotations

from typing import Tuple

import numpy as np


def coarse_pairs(
    predicted: np.ndarray,
    predicted_variances: np.ndarray,
    detected: np.ndarray,
    detected_variances: np.ndarray,
    threshold: float,
) -> Tuple[np.ndarray, np.ndarray]:
    """Pairs that no gate on the squared Mahalanobis distance could refuse less work for: a test axis by axis.

    A squared Mahalanobis distance is at least (difference)^2 / variance on each axis, so that every pair within the
    gate is among those returned.

    Args:
        predicted: (T, m) and predicted_variances (T, m): at least the tracks' part of the innovations' variances.
        detected: (N, m) and detected_variances (N, m): at least the detections' part.
        threshold: of the squared Mahalanobis distance.

    Returns:
        Indices of tracks (K,) and detections (K,), ordered by track, then detection.
    """
    if not np.isfinite(threshold):
        tracks, detections = np.divmod(np.arange(len(predicted) * len(detected)), max(len(detected), 1))
        return tracks, detections
    possible = np.ones((len(predicted), len(detected)), dtype=bool)
    for axis in range(predicted.shape[1]):
        difference = predicted[:, axis, None] - detected[None, :, axis]
        variance = predicted_variances[:, axis, None] + detected_variances[None, :, axis]
        possible &= difference * difference <= threshold * variance
    return np.nonzero(possible)  # type: ignore[return-value]
