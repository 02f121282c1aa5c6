"""Where people can walk in a room, and short ways through it."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import ndimage
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from people_fusion.core.errors import ConfigError
from people_fusion.simulation.plan import Plan, connected


class Floor:
    """Where people can walk: free places and short ways between them, on cells of 10 cm.

    Args:
        start: (2,) a point on the floor that is meant.
        clearance: distance to keep from all surfaces, metres.
    """

    def __init__(self, plan: Plan, start: np.ndarray, clearance: float, resolution: float = 0.1) -> None:
        self._resolution = resolution
        self._lower = plan.bounds[0] - 0.5
        width, height = (int(cells) for cells in np.ceil((plan.bounds[1] + 0.5 - self._lower) / resolution))
        occupied = plan.occupied(self._lower, (height, width), resolution, mapped_only=False)
        inside = connected(~occupied, self._lower, resolution, start)
        distance = ndimage.distance_transform_edt(inside) * resolution
        self._free = distance > clearance
        if not self._free.any():
            raise ConfigError(f"room: no place is {clearance} m away from everything")
        self._graph = _neighbours(self._free, distance, resolution)

    def random_place(self, rng: np.random.Generator) -> np.ndarray:
        """(2,) a free place."""
        rows, columns = np.nonzero(self._free)
        return self._place(int(rng.choice(rows * self._free.shape[1] + columns)))

    def route(self, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
        """(W, 2) waypoints of a short way that ends at `goal`; only the goal if there is no way."""
        first, last = self._cell(start), self._cell(goal)
        _, before = dijkstra(self._graph, indices=first, return_predecessors=True)
        cells = [last]
        while cells[-1] != first and before[cells[-1]] >= 0:
            cells.append(int(before[cells[-1]]))
        if cells[-1] != first:
            return goal[None]
        way = np.stack([self._place(cell) for cell in reversed(cells)])
        return np.concatenate([self._straighten(way), goal[None]])

    def _straighten(self, way: np.ndarray) -> np.ndarray:
        """Waypoints that see one another; the first, where one stands, is left out."""
        kept, here = [], 0
        while here < len(way) - 1:
            ahead = len(way) - 1
            while ahead > here + 1 and not self._visible(way[here], way[ahead]):
                ahead -= 1
            kept.append(way[ahead])
            here = ahead
        return np.array(kept).reshape(-1, 2)

    def _visible(self, first: np.ndarray, second: np.ndarray) -> bool:
        count = int(np.linalg.norm(second - first) / (self._resolution / 2.0)) + 2
        points = first + np.linspace(0.0, 1.0, count)[:, None] * (second - first)
        columns, rows = np.floor((points - self._lower) / self._resolution).astype(int).T
        return bool(self._free[rows, columns].all())

    def _cell(self, point: np.ndarray) -> int:
        """Index of the free cell nearest to a point."""
        rows, columns = np.nonzero(self._free)
        centres = self._lower + (np.stack([columns, rows], axis=1) + 0.5) * self._resolution
        nearest = int(np.argmin(np.sum((centres - point) ** 2, axis=1)))
        return int(rows[nearest] * self._free.shape[1] + columns[nearest])

    def _place(self, cell: int) -> np.ndarray:
        row, column = divmod(cell, self._free.shape[1])
        place: np.ndarray = self._lower + (np.array([column, row]) + 0.5) * self._resolution
        return place


def _neighbours(free: np.ndarray, distance: np.ndarray, resolution: float) -> Any:
    """Sparse graph of the steps to the eight neighbours of each free cell; close to surfaces a step costs more."""
    height, width = free.shape
    index = np.arange(height * width).reshape(height, width)
    starts, ends, costs = [], [], []
    for rows, columns in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, height - rows), slice(max(0, -columns), width - max(0, columns)))
        there = (slice(rows, height), slice(max(0, columns), width - max(0, -columns)))
        both = free[here] & free[there]
        length = resolution * np.hypot(rows, columns)
        starts.append(index[here][both])
        ends.append(index[there][both])
        costs.append(length * (1.0 + 0.3 / (0.1 + distance[there][both])))
    return csr_matrix(
        (np.concatenate(costs * 2), (np.concatenate(starts + ends), np.concatenate(ends + starts))),
        shape=(index.size,) * 2,
    )
