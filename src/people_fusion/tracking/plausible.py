"""Detections that no filter may see, kept from it."""

from __future__ import annotations

import dataclasses

import numpy as np

from people_fusion.core.measurements import Measurement

FARTHEST_M = 1e9
SMALLEST_STD_M = 1e-3  # no sensor is better; an exact one would leave covariances singular


def plausible(measurement: Measurement) -> Measurement:
    """The detections at a place, with a covariance and a confidence.

    Who claims to be exact, in whatever direction, is believed to 1 mm.
    """
    variances = np.diagonal(measurement.covariances, axis1=1, axis2=2)
    with np.errstate(invalid="ignore"):
        rows = (np.abs(measurement.positions) < FARTHEST_M).all(axis=1) & (variances >= 0.0).all(axis=1)
    rows &= np.isfinite(measurement.covariances).all(axis=(1, 2)) & np.isfinite(measurement.confidences)
    if not rows.all():
        measurement, variances = measurement.select(rows), variances[rows]
    observed = np.array(measurement.observed)
    lacking = np.where(observed, np.maximum(SMALLEST_STD_M**2 - variances, 0.0), 0.0)
    axes = np.flatnonzero(observed)
    blocks = measurement.covariances[:, axes[:, None], axes] + lacking[:, axes, None] * np.eye(len(axes))
    smallest = np.linalg.eigvalsh(blocks)[:, :1]
    lacking = lacking + np.where(observed, np.maximum(SMALLEST_STD_M**2 - smallest, 0.0), 0.0)
    if lacking.any():
        covariances = measurement.covariances + lacking[:, :, None] * np.eye(3)
        measurement = dataclasses.replace(measurement, covariances=covariances)
    return measurement
