"""A depth camera's image, free of ROS."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional

import numpy as np

from people_fusion.core.cameras import Camera


@dataclass(frozen=True, eq=False)
class DepthImage:
    """One image of a calibrated depth camera.

    Attributes:
        stamp_ns: when it was exposed.
        frame_id: frame of the camera, with optical axes: x right, y down, z ahead.
        depths: (H, W) float32 metres along the optical axis; NaN where there is no return.
        camera: model of the camera, of the same size.
        colour: (H, W, 3) blue, green, red, uint8, of the same pixels, or None.
    """

    stamp_ns: int
    frame_id: str
    depths: np.ndarray
    camera: Camera
    colour: Optional[np.ndarray] = None
