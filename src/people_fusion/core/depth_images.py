"""A depth camera's image, free of ROS."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Optional

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.core.errors import DataError

OTHER_PIXELS = "colour image of other pixels than the depth image"


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

    def coloured(self, pixels: np.ndarray, frame_id: str) -> DepthImage:
        """The same with a colour image, (H', W') grey or (H', W', 3) blue, green, red, brought to its size.

        Raises:
            DataError: the colour image is another camera's, or of another shape.
        """
        height, width = self.depths.shape
        if frame_id != self.frame_id:
            raise DataError(OTHER_PIXELS, f"{frame_id}, not {self.frame_id}")
        if pixels.shape[0] * width != pixels.shape[1] * height:
            raise DataError(OTHER_PIXELS, f"{pixels.shape[1]} x {pixels.shape[0]}, not {width} x {height}")
        if pixels.shape[0] != height or pixels.ndim == 2:
            import cv2  # 100 MB: not for those who see no images

            pixels = cv2.resize(pixels, (width, height), interpolation=cv2.INTER_AREA)
            pixels = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR) if pixels.ndim == 2 else pixels
        return dataclasses.replace(self, colour=pixels)
