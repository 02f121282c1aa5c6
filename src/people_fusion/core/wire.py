"""What live nodes and recordings must write into messages, and read from them, alike."""

from __future__ import annotations

import math
from typing import Any, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.angles import bearings
from people_fusion.core.errors import DataError
from people_fusion.core.gaussians import checked_covariance
from people_fusion.core.measurements import XY_OBSERVED, Bodies, Measurement, Sight

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


def measurement_of(message: Any, stamp_ns: int, frame_id: str) -> Measurement:
    """Measurement of a people_fusion/DetectedPersons, in the sensor's frame.

    Raises:
        DataError: names the first thing that is wrong; no part of the message is taken then.
    """
    detections = message.detections
    if not message.cue:
        raise DataError("detections without a cue's name")
    if not (math.isfinite(message.period) and message.period >= 0.0):
        raise DataError("detections with an impossible period", f"{message.period} s")
    places = [detection.pose.pose.position for detection in detections]
    positions = np.array([(place.x, place.y, place.z) for place in places]).reshape(-1, 3)
    confidences = np.array([d.confidence for d in detections], dtype=float)
    whole = np.array([d.pose.covariance for d in detections], dtype=float).reshape(-1, 6, 6)
    covariances = whole[:, :3, :3]
    if not (np.isfinite(positions).all() and np.isfinite(confidences).all()):
        raise DataError("detection is not finite")
    if ((confidences < 0.0) | (confidences > 1.0)).any():
        raise DataError("detection's confidence is not within [0, 1]", f"{confidences}")
    masked = np.diagonal(covariances, axis1=1, axis2=2) >= UNOBSERVED_VARIANCE
    if len(masked) and (masked != masked[0]).any():
        raise DataError("detections of one message observe different axes")
    observed = ~masked[0] if len(masked) else np.array(XY_OBSERVED)
    if not observed[:2].all():
        raise DataError("detections without a place in the plane", f"observed: {observed.tolist()}")
    covariances = checked_covariance(covariances * (observed[:, None] & observed), "detection's covariance")
    legs = np.array([(leg.x, leg.y) for leg in message.legs], dtype=float).reshape(-1, 2)
    owners = np.asarray(message.leg_owners, dtype=int)
    if len(owners) != len(legs) or (len(owners) and owners.max() >= len(detections)) or not np.isfinite(legs).all():
        raise DataError("legs do not fit the detections", f"{len(legs)} legs, owners {owners}")
    return Measurement(
        stamp_ns=stamp_ns,
        cue=message.cue,
        modality=message.modality,
        frame_id=frame_id,
        positions=positions,
        covariances=covariances,
        confidences=confidences,
        observed=(bool(observed[0]), bool(observed[1]), bool(observed[2])),
        period_s=message.period,
        sequence=int(message.sequence),
        sight=_sight_of(message),
        legs=legs,
        leg_owners=owners,
        bodies=_bodies_of(detections),
    )


def bodies_on_wire(measurement: Measurement) -> np.ndarray:
    """(N, 3) height, height_std and sitting of each DetectedPerson; zeros of a cue that does not tell them."""
    if measurement.bodies is None:
        return np.zeros((len(measurement), 3))
    return np.column_stack(measurement.bodies).astype(float)


def _bodies_of(detections: Sequence[Any]) -> Optional[Bodies]:
    told = [(d.height, d.height_std, d.sitting) for d in detections if getattr(d, "height_std", 0.0)]  # once had none
    if not told:
        return None
    bodies = Bodies(*np.array(told, dtype=float).T)
    if len(told) < len(detections):
        raise DataError("heights of some people of a message alone", f"{len(told)} of {len(detections)}")
    if not np.isfinite(told).all() or (bodies.height_stds < 0.0).any():
        raise DataError("impossible height of a person", f"{told}")
    if ((bodies.sitting < 0.0) | (bodies.sitting > 1.0)).any():
        raise DataError("probability of sitting is not within [0, 1]", f"{bodies.sitting}")
    return bodies


def _sight_of(message: Any) -> Optional[Sight]:
    ranges = np.asarray(message.sight_ranges, dtype=float)
    if len(ranges) == 0:
        return None
    numbers = (message.sight_angle_min, message.sight_angle_increment, message.sight_range_max)
    if not all(map(math.isfinite, numbers)):
        raise DataError("sight is not finite", f"{numbers}")
    if message.sight_angle_increment == 0.0:
        raise DataError("sight with all beams in one direction")
    return Sight(
        position=np.zeros(2),
        yaw=0.0,
        angle_min=message.sight_angle_min,
        angle_increment=message.sight_angle_increment,
        ranges=ranges,
        range_max=message.sight_range_max,
    )
