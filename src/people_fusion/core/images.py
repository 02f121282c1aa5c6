"""A camera's image, free of ROS."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from people_fusion.core.cameras import Camera


@dataclass(frozen=True, eq=False)
class Image:
    """One image of a calibrated camera.

    Attributes:
        stamp_ns: when it was exposed.
        frame_id: frame of the camera; which way its axes point is the camera model's business.
        pixels: (H, W) grey or (H, W, 3) blue, green, red; uint8.
        camera: model of the camera, of the same size.
    """

    stamp_ns: int
    frame_id: str
    pixels: np.ndarray
    camera: Camera

    @cached_property
    def grey(self) -> np.ndarray:
        """(H, W) uint8."""
        if self.pixels.ndim == 2:
            return self.pixels
        import cv2  # 100 MB: not for those who see no images

        return cv2.cvtColor(self.pixels, cv2.COLOR_BGR2GRAY)
