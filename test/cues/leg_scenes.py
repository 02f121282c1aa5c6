"""Scans of hand-made scenes: round legs in a square room, scanners that stand or move."""

from __future__ import annotations

import math

import numpy as np

from people_fusion.core.errors import TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.transforms import TransformSource

LEG_RADIUS = 0.06
FIRST_ANGLE, HALF_DEGREE = -math.radians(135.0), math.radians(0.5)
SECOND = 1_000_000_000


def cast(origin, angle, legs, room=None):
    """Distance that one beam from `origin` (2,) at `angle` sees; `room` is half the edge of a square one."""
    distance = math.inf
    direction = np.array([math.cos(angle), math.sin(angle)])
    for leg in legs:
        along, across = (leg - origin) @ direction, np.cross(direction, leg - origin)
        if along > 0.0 and abs(across) < LEG_RADIUS:
            distance = min(distance, along - math.sqrt(LEG_RADIUS**2 - across**2))
    if room is not None:
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = min(distance, np.nanmin((np.sign(direction) * room - origin) / direction))
    return distance


def scan_of(legs, room=None, beams=541, angle_min=FIRST_ANGLE, increment=HALF_DEGREE, **fields):
    """Scan by a scanner at the origin."""
    legs = np.asarray(legs, dtype=float).reshape(-1, 2)
    ranges = [cast(np.zeros(2), angle_min + increment * beam, legs, room) for beam in range(beams)]
    return scan_with(ranges, angle_min=angle_min, angle_increment=increment, **fields)


def scan_with(ranges, **fields):
    """Scan with these ranges and otherwise ordinary fields."""
    fields = {"stamp_ns": 5 * SECOND, "frame_id": "laser", "range_min": 0.05, "range_max": 30.0, **fields}
    fields = {"angle_min": -1.0, "angle_increment": 0.01, **fields}
    return Scan(ranges=np.array(ranges), **fields)


class Motion(TransformSource):
    """A scanner that drives and turns evenly in every other frame, known from `since_ns` to `until_ns`."""

    def __init__(self, velocity=(0.0, 0.0), turn=0.0, start=(0.0, 0.0, 0.0), since_ns=0, until_ns=10**18):
        self.velocity, self.turn, self.start = velocity, turn, start
        self.since_ns, self.until_ns = since_ns, until_ns
        self.asked = []

    def pose(self, stamp_ns):
        time_s = (stamp_ns - 5 * SECOND) / SECOND
        x, y, yaw = self.start
        return Pose.from_xy_yaw(x + self.velocity[0] * time_s, y + self.velocity[1] * time_s, yaw + self.turn * time_s)

    def lookup(self, target_frame, source_frame, stamp_ns):
        self.asked.append((target_frame, source_frame, stamp_ns))
        if stamp_ns > self.until_ns:
            raise TransformUnavailable(f"{target_frame} from {source_frame} is not known yet", may_arrive=True)
        if stamp_ns < self.since_ns:
            raise TransformUnavailable(f"{target_frame} from {source_frame} is forgotten", may_arrive=False)
        return self.pose(stamp_ns)


def scan_in_motion(motion, legs, beams=541, angle_min=FIRST_ANGLE, increment=HALF_DEGREE, sweep_s=0.1):
    """Scan of legs (L, 2) in the fixed frame by a scanner that moves during the sweep."""
    legs, ranges = np.asarray(legs, dtype=float), []
    for beam in range(beams):
        pose = motion.pose(5 * SECOND + int(beam * sweep_s / (beams - 1) * SECOND))
        ranges.append(cast(pose.translation[:2], float(pose.yaw) + angle_min + increment * beam, legs))
    return scan_with(ranges, angle_min=angle_min, angle_increment=increment, time_increment=sweep_s / (beams - 1))
