"""An occupancy grid map, free of ROS."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Dict, Tuple

import numpy as np
import scipy.ndimage

from people_fusion.core.errors import DataError
from people_fusion.core.poses import Pose

OCCUPIED_THRESHOLD = 65


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
    _masks: Dict[Tuple[float, int], np.ndarray] = field(default_factory=dict, init=False, repr=False)

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

    def dilated(self, radius_m: float, threshold: int = OCCUPIED_THRESHOLD) -> np.ndarray:
        """(height, width) bool: cells whose centre is at most `radius_m` from that of a cell occupied at `threshold`.

        Kept, so that it costs something only once; read only.
        """
        key = (radius_m, threshold)
        if key not in self._masks:
            mask = self.occupancy >= threshold
            if radius_m > 0.0 and mask.any():
                distance_cells = scipy.ndimage.distance_transform_edt(~mask)
                mask = distance_cells <= radius_m / self.resolution + 1e-6
            mask.setflags(write=False)
            self._masks[key] = mask
        return self._masks[key]

    def occupied_at(self, points: np.ndarray, radius_m: float = 0.0, threshold: int = OCCUPIED_THRESHOLD) -> np.ndarray:
        """(N,) bool: whether the (N, 2) or (N, 3) points, in the map's frame, lie in an occupied cell.

        Args:
            points: metres; a point outside the map or not finite is in no cell.
            radius_m: by which occupied cells are dilated first.
            threshold: occupancy from which on a cell counts as occupied.
        """
        rotation = self.origin.rotation[:2, :2]
        height, width = self.occupancy.shape
        with np.errstate(invalid="ignore"):
            cells = (points[:, :2] - self.origin.translation[:2]) @ rotation / self.resolution
            inside = ((cells >= 0.0) & (cells < (width, height))).all(axis=1)
        columns, rows = cells[inside].astype(int).T
        occupied = np.zeros(len(points), dtype=bool)
        occupied[inside] = self.dilated(radius_m, threshold)[rows, columns]
        return occupied
