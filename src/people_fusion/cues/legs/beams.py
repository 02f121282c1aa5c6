"""Laser beams: which of them measured something, and where."""

from __future__ import annotations

import math
from typing import Tuple

import numpy as np

from people_fusion.core.errors import DataError
from people_fusion.core.poses import Pose, interpolate
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import from_seconds


def check(scan: Scan) -> np.ndarray:
    """The ranges (B,) as float64 of a scan whose description makes sense.

    Raises:
        DataError: no beams, ranges that are no list of numbers, angles or limits that are not finite (range_max may
            be +inf), beams in one direction or more than half a turn apart, or no distance between the limits.
    """
    try:
        ranges = np.asarray(scan.ranges, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise DataError("scan with ranges that are not numbers", str(error)) from error
    if ranges.ndim != 1:
        raise DataError("scan with ranges that are not a list", f"shape {ranges.shape}")
    if not len(ranges):
        raise DataError("scan without beams")
    sweep = scan.angle_increment * (len(ranges) - 1)
    if not (math.isfinite(scan.angle_min) and math.isfinite(scan.angle_increment) and math.isfinite(sweep)):
        raise DataError("scan with angles that are not finite", f"{scan.angle_min}, {scan.angle_increment}")
    if abs(scan.angle_increment) > math.pi:
        raise DataError("scan with beams more than half a turn apart", f"{scan.angle_increment}")
    if scan.angle_increment == 0.0 and len(ranges) > 1:
        raise DataError("scan with all beams in one direction")
    if not (math.isfinite(scan.range_min) and scan.range_min < scan.range_max):  # also refuses NaN
        raise DataError("scan with no distance between its limits", f"{scan.range_min} ... {scan.range_max}")
    return ranges


def hits(ranges: np.ndarray, range_min: float, range_max: float) -> np.ndarray:
    """(B,) bool, which ranges are distances to something.

    REP-117 counts range_max as a distance. Here it is none: drivers and simulators older than REP-117 send it for
    nothing within reach, and the circle of such points would look like a wall of legs. Zero is never a distance.
    """
    with np.errstate(invalid="ignore"):
        return (ranges >= range_min) & (ranges > 0.0) & (ranges < range_max)


def seen_through(ranges: np.ndarray, range_min: float, range_max: float) -> np.ndarray:
    """(B,) metres that each beam saw through; NaN where it gave no information (Sight.ranges).

    +inf and range_max itself: nothing before range_max; -inf: something closer than range_min, so nothing was seen
    through; NaN, zero and all else outside the limits: no information.
    """
    with np.errstate(invalid="ignore"):
        seen = np.where(hits(ranges, range_min, range_max), ranges, np.nan)
    seen[(ranges == np.inf) | (ranges == range_max)] = range_max
    seen[ranges == -np.inf] = 0.0
    return seen


def is_ring(scan: Scan) -> bool:
    """Whether the scan goes full circle: the first beam is the last one's neighbour."""
    return abs(scan.angle_increment) * len(scan.ranges) > 2.0 * math.pi - 1.5 * abs(scan.angle_increment)


def largest_jump(ranges: np.ndarray) -> int:
    """Beam of a full circle's ranges (B,) whose range differs most from that of the beam before."""
    far = np.nanmax(ranges, initial=0.0, where=np.isfinite(ranges)) + 1.0
    known = np.where(np.isfinite(ranges), ranges, far)
    return int(np.argmax(abs(known - np.roll(known, 1))))


def with_neighbours(ranges: np.ndarray, ring: bool, beyond: float) -> np.ndarray:
    """(B + 2,) ranges (B,) with what is before the first and after the last beam: `beyond`, but on a full circle."""
    before, after = (ranges[-1], ranges[0]) if ring else (beyond, beyond)
    return np.concatenate([[before], ranges, [after]])


def duration_ns(scan: Scan) -> int:
    """Time from the first to the last beam; 0 where the driver does not say."""
    duration_s = scan.time_increment * (len(scan.ranges) - 1)
    return from_seconds(duration_s) if math.isfinite(duration_s) and duration_s > 0.0 else 0


def straighten(points: np.ndarray, fractions: np.ndarray, first: Pose, last: Pose) -> np.ndarray:
    """Points of a moving scanner in the frame that the scanner had at the first beam.

    Args:
        points: (N, 2) each in the scanner's frame at the instant of its own beam.
        fractions: (N,) that instant, 0 at the first beam, 1 at the last.
        first: fixed_from_scanner at the first beam, or at another instant,
        last: and as long after it as the last beam after the first; only the motion between both counts.

    Returns:
        (N, 2) metres; what leaves the plane when the scanner tilts meanwhile is dropped.
    """
    moved = interpolate(Pose.identity(), first.inverse() @ last, fractions)
    return np.einsum("nij,nj->ni", moved.rotation[:, :2, :2], points) + moved.translation[:, :2]


class Directions:
    """Cosine and sine of the beams' angles, kept as long as the scans have the same shape."""

    def __init__(self) -> None:
        self._shape: Tuple[float, float, int] = (math.nan, math.nan, 0)
        self._directions = np.zeros((0, 2))

    def of(self, scan: Scan) -> np.ndarray:
        """(B, 2) unit vectors."""
        shape = (scan.angle_min, scan.angle_increment, len(scan.ranges))
        if shape != self._shape:
            angles = scan.angles
            self._directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
            self._shape = shape
        return self._directions
