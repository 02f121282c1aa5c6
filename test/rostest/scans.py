"""Scans for rostests that need no recording."""

from __future__ import annotations

import math

import numpy as np
import rospy
from sensor_msgs.msg import LaserScan

BEAMS = 361
PERIOD_S = 0.05


def good_scan(x: float = 2.0, y: float = 0.0) -> LaserScan:
    """Two legs and nothing else within reach."""
    scan = LaserScan(angle_min=-math.pi / 2, angle_max=math.pi / 2, angle_increment=math.pi / (BEAMS - 1))
    scan.header.stamp, scan.header.frame_id = rospy.Time.now(), "laser"
    scan.range_min, scan.range_max = 0.05, 30.0
    angles = scan.angle_min + scan.angle_increment * np.arange(BEAMS)
    ranges = np.full(BEAMS, math.inf)
    for side in (-0.15, 0.15):
        distance, direction = math.hypot(x, y + side), math.atan2(y + side, x)
        ranges[np.abs(angles - direction) < 0.06 / distance] = distance
    scan.ranges = ranges.tolist()
    return scan
