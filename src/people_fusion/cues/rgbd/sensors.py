"""Depth cameras: where they measure, and how well."""

from __future__ import annotations

from typing import Dict, NamedTuple

import numpy as np


class DepthSensor(NamedTuple):
    """A kind of depth camera.

    Attributes:
        min_range, max_range: metres along the optical axis between which its depths are of use.
        std: part of the depth's std that is the same everywhere, metres.
        std_per_square: k of the part that grows with the square of the depth (Martin Garcia 2012, 4.1), 1/m.
    """

    min_range: float
    max_range: float
    std: float
    std_per_square: float

    def stds(self, depths: np.ndarray) -> np.ndarray:
        """(N,) std of depths (N,), metres."""
        return np.hypot(self.std, self.std_per_square * depths**2)


# Structured light by triangulation: k = pixel noise / (focal length * baseline); 1.4e-3 for a Kinect is Khoshelham and
# Elberink's (2012, eq. 11). Stereo has a shorter baseline and coarser matching. Time of flight hardly grows.
SENSORS: Dict[str, DepthSensor] = {
    "kinect": DepthSensor(0.5, 8.0, 0.003, 1.4e-3),
    "xtion": DepthSensor(0.5, 8.0, 0.003, 1.4e-3),
    "kinect2": DepthSensor(0.5, 8.0, 0.005, 0.5e-3),
    "realsense": DepthSensor(0.3, 8.0, 0.003, 2.5e-3),
    "tof": DepthSensor(0.3, 7.5, 0.015, 0.3e-3),
}
