"""What a segment of a scan looks like: the fourteen features of Arras et al. 2012, 2.2, and some of ours.

All segments of a scan at once. Some of the paper's features depend on how many points the scanner puts on a leg (their
number, sums of squares), some on the room (jumps to the neighbours); ours do not, so that one model serves other
scanners and other rooms.

Degenerate segments are defined: points that coincide have no curvature and no angle, points on a line no finite circle
(radius `STRAIGHT`, residuals those of the line), the first and the last segment of a scan have no neighbour (`ALONE`).
"""

from __future__ import annotations

from typing import Optional, Tuple

import numpy as np
from scipy.spatial import cKDTree

from people_fusion.cues.legs.segments import Segments

PAPER = (
    "number", "standard_deviation", "median_deviation", "jump_before", "jump_after", "width", "linearity",
    "circularity", "radius", "boundary_length", "boundary_regularity", "mean_curvature", "mean_angular_difference",
    "mean_speed",
)  # fmt: skip
OURS = (
    "across", "depth", "line_rms", "circle_rms", "line_share", "circle_share", "bulge", "bulge_share", "tortuosity",
    "inscribed_angle", "inscribed_angle_deviation", "companion_distance", "companion_width", "companions",
)  # fmt: skip
NAMES = PAPER + OURS
ALONE = 10.0  # metres: jump beside which there is nothing; no jump counts for more
STRAIGHT = 10.0  # metres: radius of a line; no radius counts for more
MIN_POINTS = 3  # fewer have no circle, no curvature
NARROW = 0.35  # metres: wider segments are no legs
NEAR = 0.75  # metres: between the legs of a person
FAR = 2.0  # metres: a companion farther away is none
FLAT = 1e-9  # of the product of its principal variances a segment is a line


def features(
    segments: Segments, previous: Optional[np.ndarray] = None, ranges: Optional[np.ndarray] = None, dt_s: float = 0.0
) -> np.ndarray:
    """All features of all segments.

    Args:
        segments: of a scan, S of them.
        previous: (B,) ranges of the scan before, aligned with this one, NaN where there is none; for `mean_speed`,
            which is 0 without.
        ranges: (B,) ranges of this scan.
        dt_s: seconds between both.

    Returns:
        (S, F) in the order of `NAMES`; rows of segments with fewer than `MIN_POINTS` points are to be ignored, but
        finite.
    """
    if not len(segments):
        return np.zeros((0, len(NAMES)))
    speed = np.zeros(len(segments))
    if previous is not None and ranges is not None and dt_s > 0.0:
        moved = (ranges - previous)[segments.beams] / dt_s
        known = np.isfinite(moved)
        speed = _sum(np.where(known, moved, 0.0), segments) / np.maximum(_sum(known.astype(float), segments), 1.0)
    return np.column_stack([*_shape(segments, speed), *_companions(segments)])


def _shape(segments: Segments, speed: np.ndarray) -> Tuple[np.ndarray, ...]:
    points, starts, counts = segments.points, segments.starts, segments.counts
    n, last, labels = counts.astype(float), starts + counts - 1, segments.labels
    mean = segments.centres
    offset = points - mean[labels]
    squares = (offset**2).sum(axis=1)
    deviation = np.sqrt(_sum(squares, segments) / np.maximum(n - 1.0, 1.0))
    from_median = points - _medians(segments)[labels]
    median_deviation = _sum(np.hypot(from_median[:, 0], from_median[:, 1]), segments) / n
    chord = points[last] - points[starts]
    width = np.hypot(chord[:, 0], chord[:, 1])
    line, circle, radius = _fits(segments, offset, squares, labels)

    steps = np.diff(points, axis=0)
    lengths = np.hypot(steps[:, 0], steps[:, 1])
    inner = labels[1:] == labels[:-1]  # steps within a segment
    step_counts = np.maximum(n - 1.0, 1.0)
    boundary = np.bincount(labels[:-1][inner], lengths[inner], len(segments))
    spread = (lengths - (boundary / step_counts)[labels[:-1]]) ** 2
    regularity = np.sqrt(np.bincount(labels[:-1][inner], spread[inner], len(segments)) / step_counts)
    curvature, turning = _turns(points, steps, lengths, inner, labels, n)

    # Ours: in the segment's own frame, x away from the scanner.
    away = mean / np.maximum(np.hypot(mean[:, 0], mean[:, 1]), 1e-9)[:, None]
    along = (offset * away[labels]).sum(axis=1)
    across = offset[:, 1] * away[labels, 0] - offset[:, 0] * away[labels, 1]
    extent = _max(across, segments) - _min(across, segments)
    depth = _max(along, segments) - _min(along, segments)
    line_rms, circle_rms = np.sqrt(line / n), np.sqrt(circle / n)
    size = np.maximum(width, 0.01)
    normal = np.column_stack([chord[:, 1], -chord[:, 0]]) / np.maximum(width, 1e-9)[:, None]
    normal *= np.where((normal * away).sum(axis=1) > 0.0, -1.0, 1.0)[:, None]  # towards the scanner
    bulge = ((mean - 0.5 * (points[starts] + points[last])) * normal).sum(axis=1)
    inscribed, inscribed_deviation = _inscribed(segments, labels, last)
    return (
        n, deviation, median_deviation, *_jumps(segments, last), width, line, circle, radius, boundary,
        regularity, curvature, turning, speed,
        extent, depth, line_rms, circle_rms, line_rms / size, circle_rms / size, bulge, bulge / size,
        np.minimum(boundary / size, 10.0), inscribed, inscribed_deviation,
    )  # fmt: skip


def _fits(
    segments: Segments, offset: np.ndarray, squares: np.ndarray, labels: np.ndarray
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Squared residuals (S,) of the best line and circle (#7, #8), and its radius (#9).

    The circle is the paper's linear least squares, solved about the centre of gravity, where its normal equations fall
    apart into a 2x2 system and the mean.
    """
    xx, yy = _sum(offset[:, 0] ** 2, segments), _sum(offset[:, 1] ** 2, segments)
    xy = _sum(offset[:, 0] * offset[:, 1], segments)
    line = np.maximum(0.5 * (xx + yy - np.hypot(xx - yy, 2.0 * xy)), 0.0)
    right_x, right_y = 0.5 * _sum(squares * offset[:, 0], segments), 0.5 * _sum(squares * offset[:, 1], segments)
    determinant = xx * yy - xy**2
    is_flat = determinant <= FLAT * (xx + yy) ** 2
    determinant = np.where(is_flat, 1.0, determinant)
    centre = np.column_stack([yy * right_x - xy * right_y, xx * right_y - xy * right_x]) / determinant[:, None]
    radius = np.sqrt((centre**2).sum(axis=1) + (xx + yy) / segments.counts)
    to_centre = offset - centre[labels]
    circle = _sum((radius[labels] - np.hypot(to_centre[:, 0], to_centre[:, 1])) ** 2, segments)
    is_flat |= radius > STRAIGHT
    return line, np.where(is_flat, line, circle), np.where(is_flat, STRAIGHT, radius)


def _turns(
    points: np.ndarray, steps: np.ndarray, lengths: np.ndarray, inner: np.ndarray, labels: np.ndarray, n: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Means (S,) of curvature (#12) and of the signed angle between successive steps (#13)."""
    if len(points) < MIN_POINTS:
        return np.zeros(len(n)), np.zeros(len(n))
    both = inner[:-1] & inner[1:]
    cross = steps[:-1, 0] * steps[1:, 1] - steps[:-1, 1] * steps[1:, 0]
    dot = (steps[:-1] * steps[1:]).sum(axis=1)
    chord = np.hypot(*(points[2:] - points[:-2]).T)
    product = lengths[:-1] * lengths[1:] * chord
    curvature = np.divide(2.0 * np.abs(cross), product, out=np.zeros(len(product)), where=product > 1e-12)
    owners, inner_counts = labels[1:-1][both], np.maximum(n - 2.0, 1.0)
    turning = np.bincount(owners, np.arctan2(cross, dot)[both], len(n)) / inner_counts
    return np.bincount(owners, curvature[both], len(n)) / inner_counts, turning


def _inscribed(segments: Segments, labels: np.ndarray, last: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Mean and deviation (S,) of the angle under which inner points see both ends: constant on an arc (Xavier 2005)."""
    first, final = segments.points[segments.starts][labels], segments.points[last][labels]
    a, b = first - segments.points, final - segments.points
    angle = np.abs(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)))
    inside = np.ones(len(labels), dtype=bool)
    inside[segments.starts] = inside[last] = False
    count = np.maximum(segments.counts - 2.0, 1.0)
    mean = np.bincount(labels[inside], angle[inside], len(last)) / count
    spread = (angle - mean[labels]) ** 2
    return mean, np.sqrt(np.bincount(labels[inside], spread[inside], len(last)) / count)


def _jumps(segments: Segments, last: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Distances (S,) to the last point of the segment before (#4) and the first of the one after (#5)."""
    gap = segments.points[segments.starts] - np.roll(segments.points[last], 1, axis=0)
    before = np.minimum(np.hypot(gap[:, 0], gap[:, 1]), ALONE)
    if not segments.is_ring or len(segments) == 1:
        before[0] = ALONE
    after = np.roll(before, -1)
    return before, after


def _companions(segments: Segments) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of other segments as narrow as a leg: distance of the nearest, its difference in width, and how many are near."""
    centres, last = segments.centres, segments.starts + segments.counts - 1
    chord = segments.points[last] - segments.points[segments.starts]
    width = np.hypot(chord[:, 0], chord[:, 1])
    narrow = (width < NARROW) & (segments.counts >= MIN_POINTS)
    rows = np.flatnonzero(narrow)
    if not len(rows):
        return np.full(len(width), FAR), np.full(len(width), NARROW), np.zeros(len(width))
    tree = cKDTree(centres[rows])
    distances, nearest = tree.query(centres, k=2, distance_upper_bound=FAR)
    own = narrow.astype(int)  # a narrow segment finds itself first
    every = np.arange(len(width))
    distance = np.minimum(distances[every, own], FAR)
    partner = width[np.append(rows, 0)][nearest[every, own]]
    alike = np.where(distance < FAR, np.minimum(np.abs(width - partner), NARROW), NARROW)
    near = tree.query_ball_point(centres, NEAR, return_length=True) - own
    return distance, alike, near.astype(float)


def _medians(segments: Segments) -> np.ndarray:
    """(S, 2) median by axis of each segment's points."""
    low, high = segments.starts + (segments.counts - 1) // 2, segments.starts + segments.counts // 2
    medians = np.empty((len(segments), 2))
    labels = segments.labels
    for axis in range(2):
        ordered = segments.points[np.lexsort((segments.points[:, axis], labels)), axis]
        medians[:, axis] = 0.5 * (ordered[low] + ordered[high])
    return medians


def _sum(values: np.ndarray, segments: Segments) -> np.ndarray:
    return np.add.reduceat(values, segments.starts)


def _max(values: np.ndarray, segments: Segments) -> np.ndarray:
    return np.maximum.reduceat(values, segments.starts)


def _min(values: np.ndarray, segments: Segments) -> np.ndarray:
    return np.minimum.reduceat(values, segments.starts)
