"""The ground grid: how high it is occupied, and where that is locally highest."""

from __future__ import annotations

from typing import Tuple

import numpy as np
from scipy.ndimage import maximum_filter

HIGHEST_M = 60.0  # in millimetres it fits 16 bits


def height_map(points: np.ndarray, heights: np.ndarray, cell: float, reach: float) -> Tuple[np.ndarray, np.ndarray]:
    """Highest points by cell.

    Args:
        points: (N, 2 or more), x ahead and y to the left, metres.
        heights: (N,) of them, positive.
        cell: side of the cells, metres.
        reach: of the grid to the front, and to both sides, metres.

    Returns:
        (X, Y) heights, 0 in empty cells, and (X, Y) rows of the points that have them.
    """
    ahead, across = int(np.ceil(reach / cell)), 2 * int(np.ceil(reach / cell))
    scale = np.float32(1.0 / cell)
    rows = (points[:, 0] * scale).astype(np.int32)
    columns = (points[:, 1] * scale + np.float32(across // 2)).astype(np.int32)
    inside = (points[:, 0] >= 0.0) & (rows < ahead) & (columns >= 0) & (columns < across) & (heights < HIGHEST_M)
    inside &= heights > 0.0
    (taken,) = np.nonzero(inside)
    # Sorted by height, the last that is written to a cell is its highest; 16 bits are sorted by their digits.
    taken = taken[np.argsort((heights[taken] * np.float32(1000.0)).astype(np.uint16), kind="stable")]
    cells = rows[taken] * across + columns[taken]
    highest, owners = np.zeros(ahead * across, dtype=np.float32), np.zeros(ahead * across, dtype=np.int64)
    highest[cells], owners[cells] = heights[taken], taken
    return highest.reshape(ahead, across), owners.reshape(ahead, across)


def local_maxima(heights: np.ndarray, lowest: float, radius_cells: int) -> Tuple[np.ndarray, np.ndarray]:
    """Rows and columns of cells at least `lowest` high that none within a radius tops."""
    span = np.arange(-radius_cells, radius_cells + 1)
    disc = span[:, None] ** 2 + span**2 <= (radius_cells + 0.5) ** 2
    occupied = np.flatnonzero((heights > 0.0).any(axis=1))
    if len(occupied) == 0:
        return np.zeros(0, dtype=int), np.zeros(0, dtype=int)
    first, last = occupied[0], occupied[-1] + 1
    part = heights[first:last]
    rows, columns = np.nonzero((part >= lowest) & (part == maximum_filter(part, footprint=disc, mode="constant")))
    return rows + first, columns
