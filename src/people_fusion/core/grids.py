"""An occupancy grid map, free of ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Dict

import numpy as np
import scipy.ndimage

from people_fusion.core.errors import DataError
from people_fusion.core.poses import Pose

OCCUPIED_THRESHOLD = 65
ROUND_OFF = 1e-6  # metres


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Static map of the surroundings.

    Attributes:
        frame_id: frame of the map.
        resolution: edge of a cell, metres.
        origin: pose of the lower left corner of cell (0, 0) in `frame_id`.
        occupancy: (height, width) int8, row along y; -1 unknown, 0 free ... 100 occupied.
        stamp_ns: when the map was made or 0.

    Raises:
        DataError: if it has no resolution or is no plane of cells.
    """

    frame_id: str
    resolution: float
    origin: Pose
    occupancy: np.ndarray
    stamp_ns: int = 0
    _distances: Dict[int, np.ndarray] = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resolution) and self.resolution > 0.0):
            raise DataError("map without resolution", f"{self.resolution}")
        if self.occupancy.ndim != 2 or not self.occupancy.size:
            raise DataError("map without cells", f"shape {self.occupancy.shape}")

    @staticmethod
    def from_cells(
        frame_id: str, resolution: float, origin: Pose, width: int, height: int, cells: np.ndarray, stamp_ns: int = 0
    ) -> OccupancyGrid:
        """Grid of a nav_msgs/OccupancyGrid's `width` times `height` cells in one row-major list.

        Raises:
            DataError: also if there are not `width` times `height` cells.
        """
        cells = np.asarray(cells, dtype=np.int8)
        if cells.size != width * height:
            raise DataError("map with a wrong number of cells", f"{cells.size} instead of {width} x {height}")
        return OccupancyGrid(frame_id, resolution, origin, cells.reshape(height, width), stamp_ns)

    def distances(self, threshold: int = OCCUPIED_THRESHOLD) -> np.ndarray:
        """(height, width) metres from each cell's centre to the nearest occupied cell's; +inf where there is none.

        Kept, so that it costs something only once; read only.
        """
        if threshold not in self._distances:
            free = self.occupancy < threshold
            if free.all():
                distances = np.full(free.shape, np.inf)
            else:
                distances = scipy.ndimage.distance_transform_edt(free) * self.resolution
            distances.setflags(write=False)
            self._distances[threshold] = distances
        return self._distances[threshold]

    def dilated(self, radius_m: float, threshold: int = OCCUPIED_THRESHOLD) -> np.ndarray:
        """(height, width) bool: cells whose centre is at most `radius_m` from an occupied cell's."""
        return self.distances(threshold) <= radius_m + ROUND_OFF

    def clearances(self, points: np.ndarray, threshold: int = OCCUPIED_THRESHOLD) -> np.ndarray:
        """(N,) metres from the cells of the (N, 2) or (N, 3) points, in the map's frame, to the nearest occupied cell.

        Args:
            points: metres; a point outside the map or not finite is +inf away.
            threshold: occupancy from which on a cell counts as occupied.
        """
        rotation = self.origin.rotation[:2, :2]
        height, width = self.occupancy.shape
        with np.errstate(invalid="ignore"):
            cells = (points[:, :2] - self.origin.translation[:2]) @ rotation / self.resolution
            inside = ((cells >= 0.0) & (cells < (width, height))).all(axis=1)
        columns, rows = cells[inside].astype(int).T
        away = np.full(len(points), np.inf)
        away[inside] = self.distances(threshold)[rows, columns]
        return away

    def occupied_at(self, points: np.ndarray, radius_m: float = 0.0, threshold: int = OCCUPIED_THRESHOLD) -> np.ndarray:
        """(N,) bool: whether the points lie in an occupied cell; arguments as in `clearances`.

        Args:
            radius_m: by which occupied cells are dilated first.
        """
        return self.clearances(points, threshold) <= radius_m + ROUND_OFF
