"""Messages of cameras as core types, and back."""

from __future__ import annotations

from typing import Any

import numpy as np
from sensor_msgs.msg import Image as ImageMsg

from people_fusion.core.camera_info import camera_of
from people_fusion.core.cameras import Camera
from people_fusion.core.images import Image
from people_fusion.core.pixels import pixels_of
from people_fusion.ros.conversions import frame_from_msg, stamp_from_msg, stamp_to_msg


def camera_from_msg(message: Any, rectified: bool) -> Camera:
    """Camera of a sensor_msgs/CameraInfo, see camera_of.

    Raises:
        DataError: it describes no camera.
    """
    matrices = message.D, message.K, message.R, message.P
    return camera_of(message.width, message.height, message.distortion_model, *matrices, rectified)


def same_camera(one: Any, other: Any) -> bool:
    """Whether two CameraInfo describe the same camera, whatever their headers."""
    fields = ("width", "height", "distortion_model", "D", "K", "R", "P")
    return all(getattr(one, field) == getattr(other, field) for field in fields)


def image_from_msg(message: Any, camera: Camera) -> Image:
    """Image of a sensor_msgs/Image or CompressedImage.

    Raises:
        DataError: it cannot be read, or is not of the camera's size.
    """
    pixels = pixels_of(message)
    height, width = pixels.shape[:2]
    frame_id = frame_from_msg(message.header.frame_id)
    return Image(stamp_from_msg(message.header.stamp), frame_id, pixels, camera.resized(width, height))


def image_to_msg(pixels: np.ndarray, stamp_ns: int, frame_id: str) -> ImageMsg:
    """sensor_msgs/Image of pixels (H, W, 3): blue, green, red."""
    message = ImageMsg()
    message.header.stamp, message.header.frame_id = stamp_to_msg(stamp_ns), frame_id
    message.height, message.width = pixels.shape[:2]
    message.encoding, message.step = "bgr8", 3 * pixels.shape[1]
    message.data = pixels.tobytes()
    return message
