"""Errors that no filter may average away, since the next measurement has the same: they are added to the output."""

from __future__ import annotations

import numpy as np

from people_fusion.core.measurements import Measurement


def slow_errors(measurement: Measurement, offset_std: float, with_shared: bool) -> np.ndarray:
    """(N, 3, 3) what each detection adds to the output, zero on axes that are not observed.

    Args:
        measurement: N detections.
        offset_std: how far a body may be from where this modality sees it on average, metres.
        with_shared: whether the pose error that all detections share is added, too.
    """
    offset = np.diag(np.array(measurement.observed) * offset_std**2)
    errors = np.repeat(offset[None], len(measurement), axis=0)
    if measurement.shared_covariance is not None and with_shared:
        errors = errors + shared_errors(measurement)
    return errors


def shared_errors(measurement: Measurement) -> np.ndarray:
    """(N, 3, 3) J B J' of the shared pose error, zero on axes that are not observed."""
    assert measurement.shared_jacobians is not None and measurement.shared_covariance is not None
    jacobians = measurement.shared_jacobians * np.array(measurement.observed, dtype=float)[:, None]
    return np.asarray(jacobians @ measurement.shared_covariance @ jacobians.swapaxes(-1, -2))
