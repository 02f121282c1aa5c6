"""Several detections of one person by one cue become one (Volkhardt 2013, III-C 2)."""

from __future__ import annotations

import dataclasses

import numpy as np

from people_fusion.core.gaussians import covariance_intersection
from people_fusion.core.measurements import Measurement


def fuse_duplicates(measurement: Measurement, threshold: float) -> Measurement:
    """Detections that lie within each other's uncertainty, fused by covariance intersection (eq. 4-6).

    Detections of one sensor message share their source, so that a Kalman update with each would count the same
    evidence twice. Legs keep their owners by index of the fused detection.

    Args:
        measurement: of one cue.
        threshold: of the squared Mahalanobis distance under the sum of both covariances, on observed axes.
    """
    count = len(measurement)
    if count < 2:
        return measurement
    axes = np.flatnonzero(measurement.observed)
    means = measurement.positions[:, axes]
    covariances = measurement.covariances[:, axes[:, None], axes]
    difference = means[:, None] - means[None, :]
    spread = covariances[:, None] + covariances[None, :]
    distance = np.einsum("ijk,ijk->ij", difference, np.linalg.solve(spread, difference[..., None])[..., 0])
    group = np.arange(count)
    for first, second in np.argwhere(np.triu(distance <= threshold, 1)).tolist():
        group[group == group[second]] = group[first]
    kept, owners = np.unique(group, return_inverse=True)
    if len(kept) == count:
        return measurement
    positions = measurement.positions[kept].copy()
    fused = measurement.covariances[kept].copy()
    confidences = measurement.confidences[kept].copy()
    for row, leader in enumerate(kept):
        members = np.flatnonzero(group == leader)
        mean, covariance = covariance_intersection(means[members], covariances[members])
        positions[row, axes] = mean
        fused[row][np.ix_(axes, axes)] = covariance
        confidences[row] = measurement.confidences[members].max()
    jacobians = measurement.shared_jacobians
    return dataclasses.replace(
        measurement,
        positions=positions,
        covariances=fused,
        confidences=confidences,
        shared_jacobians=None if jacobians is None else jacobians[kept],
        leg_owners=owners[measurement.leg_owners] if len(measurement.leg_owners) else measurement.leg_owners,
    )
