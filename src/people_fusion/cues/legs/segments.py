"""A scan in segments: runs of successive points without a jump (Arras et al. 2012, 2.2).

The threshold of a jump may follow the spacing of the beams (Premebida and Nunes 2005), so that what stands far away is
not torn to pieces by a coarse scanner.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from people_fusion.core.scans import Scan


class Segments(NamedTuple):
    """S segments of P points; P is 0 where the scan saw nothing.

    Attributes:
        points: (P, 2) in the scanner's frame, metres, segment by segment in the order of beams.
        ranges: (P,) metres.
        beams: (P,) index in the scan.
        starts: (S,) first point of each segment.
        counts: (S,) points of each segment.
        angle_increment: between beams, radians.
        is_ring: the scan goes full circle: the first segment follows the last.
    """

    points: np.ndarray
    ranges: np.ndarray
    beams: np.ndarray
    starts: np.ndarray
    counts: np.ndarray
    angle_increment: float
    is_ring: bool

    def __len__(self) -> int:
        return len(self.starts)

    @property
    def labels(self) -> np.ndarray:
        """(P,) segment of each point."""
        return np.repeat(np.arange(len(self.starts)), self.counts)

    @property
    def centres(self) -> np.ndarray:
        """(S, 2) mean of each segment's points."""
        if not len(self):
            return np.zeros((0, 2))
        return np.add.reduceat(self.points, self.starts) / self.counts[:, None]


def segment(scan: Scan, ranges: np.ndarray, jump: float, jump_beams: float = 0.0) -> Segments:
    """Segments of a scan.

    Args:
        scan: for its angles.
        ranges: (B,) metres, NaN where a beam has no return.
        jump: successive points farther apart than this begin a new segment, metres.
        jump_beams: ... unless they are no farther apart than this many beam spacings at their range.
    """
    increment = abs(scan.angle_increment)
    beams = np.flatnonzero(np.isfinite(ranges))
    found, angles = ranges[beams], scan.angles[beams]
    points = np.column_stack([found * np.cos(angles), found * np.sin(angles)])
    is_ring = increment * len(ranges) > 2.0 * np.pi - 1.5 * increment
    if not len(points):
        return Segments(points, found, beams, np.zeros(0, int), np.zeros(0, int), increment, is_ring)
    steps = np.roll(points, -1, axis=0) - points
    threshold = np.maximum(jump, jump_beams * increment * np.minimum(found, np.roll(found, -1)))
    ends = np.hypot(steps[:, 0], steps[:, 1]) > threshold  # after this point
    if is_ring and not ends[-1] and ends.any():
        # A segment lies across the seam: begin after the first jump.
        shift = -(int(np.argmax(ends)) + 1)
        points, found, beams, ends = (np.roll(array, shift, axis=0) for array in (points, found, beams, ends))
    ends[-1] = True
    last = np.flatnonzero(ends)
    counts = np.diff(last, prepend=-1)
    return Segments(points, found, beams, last - counts + 1, counts, increment, is_ring)
