"""How far a depth image sees through at the height of heads and chests."""

from __future__ import annotations

import math

import numpy as np

from people_fusion.core.measurements import PERSON_DEPTH_M, Sight

BINS = 48
RING_M = 0.1
LOWEST_M, HIGHEST_M = 0.9, 1.6  # over the floor: whoever is there, sitting or standing, ends the view between these
NEAREST_SHARE = 0.2  # of a direction's points that may be nearer: noise, and what is thin
FEWEST = 12  # points in a direction; fewer tell nothing
CLEAR_M = 0.3  # a person's middle must be this far before what was seen behind it


def free_space(points: np.ndarray, heights: np.ndarray, half_angle: float, reach: float) -> Sight:
    """Sight of a camera, in its own frame: about the vertical from where it looks, positive to the left.

    It says only where nobody is, not that who is there would have been found.

    Args:
        points: (N, 2 or more) that were seen, in level axes that look where the camera looks, metres.
        heights: (N,) of them over the floor.
        half_angle: directions up to this to both sides, radians.
        reach: farther is not told, metres.
    """
    increment = 2.0 * half_angle / BINS
    body = (heights > LOWEST_M) & (heights < HIGHEST_M)
    x, y = points[body, 0], points[body, 1]
    rings = math.ceil(reach / RING_M) + 1
    ring = np.minimum(np.hypot(x, y) * np.float32(1.0 / RING_M), rings - 1).astype(np.int32)
    direction = np.floor(np.arctan2(y, x) / np.float32(increment)).astype(np.int32) + BINS // 2
    inside = (direction >= 0) & (direction < BINS)
    counts = np.bincount(direction[inside] * rings + ring[inside], minlength=BINS * rings).reshape(BINS, rings)
    nearer, total = counts.cumsum(axis=1), counts.sum(axis=1)
    ranges = RING_M * (nearer > NEAREST_SHARE * total[:, None]).argmax(axis=1)
    ranges = np.where(total >= FEWEST, ranges - CLEAR_M - PERSON_DEPTH_M, np.nan)
    return Sight(np.zeros(2), 0.0, (0.5 - BINS / 2) * increment, increment, ranges, reach)
