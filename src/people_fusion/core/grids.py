"""An occupancy grid map, free of ROS."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from people_fusion.core.poses import Pose


@dataclass(frozen=True, eq=False)
class OccupancyGrid:
    """Static map of the surroundings.

    Attributes:
        frame_id: frame of the map.
        resolution: edge of a cell, metres.
        origin: pose of the lower left corner of cell (0, 0) in `frame_id`.
        occupancy: (height, width) int8, row along y; -1 unknown, 0 free ... 100 occupied.
        stamp_ns: when the map was made or 0.
    """

    frame_id: str
    resolution: float
    origin: Pose
    occupancy: np.ndarray
    stamp_ns: int = 0
