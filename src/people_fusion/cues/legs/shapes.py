"""Shapes that legs do not have: as thin as a chair's leg, or as wide as a bin in one piece."""

from __future__ import annotations

from typing import List

import numpy as np

from people_fusion.cues.legs import clusters

FEWEST_POINTS = 4  # in which there could be a dent


def widest(labels: np.ndarray, hits: np.ndarray, depths: np.ndarray, increment: float, step: float) -> np.ndarray:
    """(L,) metres that each thing can be wide at most; +inf where something nearer may hide part of it.

    It lies between the beams that passed it on both sides. A beam without a distance may have been lost on it.

    Args:
        labels: (N,) thing 0 ... L - 1 that each point belongs to.
        hits: (N,) beam of each point, increasing.
        depths: (B + 2,) ranges of all beams and of those beside the first and the last, NaN where there is none.
        increment: between beams, radians.
        step: a neighbouring beam that ends so much farther away has passed, metres.
    """
    if not len(labels):
        return np.zeros(0)
    members, starts = clusters.by_label(labels)
    ends = np.append(starts[1:], len(members)) - 1
    first, last = hits[members[starts]], hits[members[ends]]
    begin, end = depths[first + 1], depths[last + 1]
    with np.errstate(invalid="ignore"):
        passed = (depths[first] - begin > step) & (depths[last + 2] - end > step)
    return np.where(passed, (last - first + 2) * abs(increment) * np.maximum(begin, end), np.inf)


def one_piece(points: np.ndarray, segments: np.ndarray, width: float, dent: float) -> np.ndarray:
    """(S,) bool, segments wider than `width` that have no dent as there is between two legs.

    Args:
        points: (N, 2) metres, from a scanner at the origin, in the order of beams.
        segments: (N,) that they belong to, 0 ... S - 1.
        width: metres between the outermost points.
        dent: depth below the hull on the scanner's side, metres.
    """
    whole = np.zeros(segments.max(initial=-1) + 1, dtype=bool)
    if not len(points):
        return whole
    members, starts = clusters.by_label(segments)
    ends = np.append(starts[1:], len(members)) - 1
    chords = points[members[ends]] - points[members[starts]]
    counts = ends - starts + 1
    for segment in np.flatnonzero((np.hypot(chords[:, 0], chords[:, 1]) > width) & (counts >= FEWEST_POINTS)):
        whole[segment] = _deepest_dent(points[members[starts[segment] : ends[segment] + 1]]) < dent
    return whole


def _deepest_dent(points: np.ndarray) -> float:
    """How far points (P, 2) lie behind their convex hull as the scanner at the origin sees it."""
    across = points[-1] - points[0]
    across = across / np.hypot(across[0], across[1])
    nearer = np.array([-across[1], across[0]])
    nearer = nearer if nearer @ points[0] < 0.0 else -nearer
    places, heights = points @ across, points @ nearer
    order = np.argsort(places, kind="stable")
    places, heights = places[order], heights[order]
    hull: List[int] = []
    for index in range(len(places)):
        while len(hull) > 1 and _is_below(places, heights, hull[-2], hull[-1], index):
            hull.pop()
        hull.append(index)
    return float(np.max(np.interp(places, places[hull], heights[hull]) - heights))


def _is_below(places: np.ndarray, heights: np.ndarray, left: int, middle: int, right: int) -> bool:
    rise = (heights[right] - heights[left]) * (places[middle] - places[left])
    return bool((heights[middle] - heights[left]) * (places[right] - places[left]) <= rise)
