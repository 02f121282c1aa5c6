"""A laser scan, free of ROS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Scan:
    """One sweep of a planar laser scanner, beams in the order of measurement.

    Ranges follow REP-117: +inf is nothing within reach, -inf too close, NaN no information. Drivers also send zeros
    and values outside [range_min, range_max]; those carry no information either.

    Attributes:
        stamp_ns: when the first beam was measured.
        frame_id: frame of the scanner, x forward, beams in its xy plane.
        ranges: (B,) float64, metres.
        angle_min: angle of the first beam, radians.
        angle_increment: from one beam to the next, radians, negative for a scanner mounted upside down.
        time_increment: from one beam to the next, seconds; 0 where the driver does not say.
        scan_time: from one scan to the next, seconds; 0 where the driver does not say.
        range_min, range_max: metres.
    """

    stamp_ns: int
    frame_id: str
    ranges: np.ndarray
    angle_min: float
    angle_increment: float
    range_min: float
    range_max: float
    time_increment: float = 0.0
    scan_time: float = 0.0

    @property
    def angles(self) -> np.ndarray:
        """(B,) angle of each beam, radians."""
        return self.angle_min + self.angle_increment * np.arange(len(self.ranges))
