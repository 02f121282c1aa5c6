"""Ray casting against segments and circles, all beams at once."""

from __future__ import annotations

from typing import Tuple

import numpy as np


def cast(
    origins: np.ndarray, directions: np.ndarray, segments: np.ndarray, centres: np.ndarray, radii: np.ndarray
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """First hit of every beam.

    Args:
        origins: (B, 2) where the beams start, metres.
        directions: (B, 2) unit vectors.
        segments: (S, 2, 2) both ends of each segment.
        centres: (B, C, 2) of the circles as each beam meets them.
        radii: (C,) metres; a beam that starts within a circle does not see it.

    Returns:
        (B,) distance or +inf; (B,) index of what was hit, segments first, then circles, -1 for nothing;
        (B,) cosine of the angle of incidence.
    """
    distances = np.concatenate(
        [_to_segments(origins, directions, segments), _to_circles(origins, directions, centres, radii)], axis=1
    )
    if distances.shape[1] == 0:
        return np.full(len(origins), np.inf), np.full(len(origins), -1), np.ones(len(origins))
    beams = np.arange(len(origins))
    hits = np.argmin(distances, axis=1)
    ranges = distances[beams, hits]
    cosines = np.ones(len(origins))

    on_segment = np.isfinite(ranges) & (hits < len(segments))
    along = segments[hits[on_segment], 1] - segments[hits[on_segment], 0]
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    beam = directions[on_segment]
    cosines[on_segment] = np.abs(beam[:, 0] * along[:, 1] - beam[:, 1] * along[:, 0])

    on_circle = np.isfinite(ranges) & (hits >= len(segments))
    circle = hits[on_circle] - len(segments)
    to_centre = centres[beams[on_circle], circle] - origins[on_circle]
    depth = np.einsum("bi,bi->b", to_centre, directions[on_circle]) - ranges[on_circle]
    cosines[on_circle] = depth / radii[circle]

    return ranges, np.where(np.isfinite(ranges), hits, -1), cosines


def leave(
    origins: np.ndarray, directions: np.ndarray, segments: np.ndarray, centres: np.ndarray, radii: np.ndarray
) -> np.ndarray:
    """(B,) where each beam has passed everything that it hits, -inf where it hits nothing; arguments as of `cast`."""
    near = _to_circles(origins, directions, centres, radii)
    along = np.einsum("bci,bi->bc", centres - origins[:, None], directions)
    distances = np.concatenate([_to_segments(origins, directions, segments), 2.0 * along - near], axis=1)
    return np.asarray(np.where(np.isfinite(distances), distances, -np.inf).max(axis=1, initial=-np.inf))


def _to_segments(origins: np.ndarray, directions: np.ndarray, segments: np.ndarray) -> np.ndarray:
    """(B, S) distance along each beam, +inf where it misses."""
    along = segments[:, 1] - segments[:, 0]
    dx, dy = directions[:, :1], directions[:, 1:]
    ox, oy = segments[:, 0, 0] - origins[:, :1], segments[:, 0, 1] - origins[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):  # parallel: inf or NaN, which no comparison lets pass
        scale = 1.0 / (dx * along[:, 1] - dy * along[:, 0])
        distance = (ox * along[:, 1] - oy * along[:, 0]) * scale
        share = (ox * dy - oy * dx) * scale
        hit = (distance >= 0.0) & (share >= 0.0) & (share <= 1.0)
    return np.where(hit, distance, np.inf)


def _to_circles(origins: np.ndarray, directions: np.ndarray, centres: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """(B, C) distance along each beam, +inf where it misses."""
    x, y = centres[..., 0] - origins[:, :1], centres[..., 1] - origins[:, 1:]
    dx, dy = directions[:, :1], directions[:, 1:]
    along = x * dx + y * dy
    offset = x * dy - y * dx
    chord = radii**2 - offset**2
    distance = along - np.sqrt(np.maximum(chord, 0.0))
    return np.where((chord >= 0.0) & (distance >= 0.0), distance, np.inf)
