"""One depth camera of a recording: its images, with the colours that belong to them."""

from __future__ import annotations

from typing import Any, Optional, Tuple

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.core.depth_images import DepthImage
from people_fusion.core.errors import DataError
from people_fusion.core.image_topics import is_rectified
from people_fusion.core.pairing import NearestInTime
from people_fusion.core.pixels import pixels_of
from people_fusion.core.transforms import normalise_frame
from people_fusion.replay import conversions
from people_fusion.replay.cameras import DepthSource

COLOUR_TOLERANCE_S = 0.04  # by which a colour image may be taken before or after a depth image


class DepthCamera:
    """Takes a recording's messages in order of arrival, as the live node does."""

    def __init__(self, source: DepthSource) -> None:
        self._is_rectified = is_rectified(source.name)
        self._camera: Optional[Camera] = None
        self._said: Optional[Tuple[Any, ...]] = None
        self._colours: NearestInTime[Any] = NearestInTime(COLOUR_TOLERANCE_S)

    def calibrate(self, message: Any) -> None:
        """Take a CameraInfo; the camera is the same object until it says something else, as cues keep what they make.

        Raises:
            DataError: it describes no camera.
        """
        matrices = (np.asarray(each).tobytes() for each in (message.D, message.K, message.R, message.P))
        said = (message.width, message.height, message.distortion_model, *matrices)
        if said != self._said:
            self._camera, self._said = conversions.camera(message, self._is_rectified), said

    def keep_colour(self, message: Any) -> None:
        """Take a colour image."""
        self._colours.put(conversions.stamp(message.header), message)

    def image(self, message: Any) -> DepthImage:
        """A depth image, without colours.

        Raises:
            DataError: it cannot be read, or came before a CameraInfo.
        """
        if self._camera is None:
            raise DataError("depth image before its camera_info")
        return conversions.depth_image(message, self._camera)

    def coloured(self, image: DepthImage) -> DepthImage:
        """With the colours that have come by now, as far as there are any.

        Raises:
            DataError: they cannot be read, or are of other pixels.
        """
        message = self._colours.at(image.stamp_ns)
        if message is None:
            return image
        return image.coloured(pixels_of(message), normalise_frame(message.header.frame_id))

    def reset(self) -> None:
        """Time has jumped."""
        self._colours.clear()
