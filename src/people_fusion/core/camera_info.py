"""The camera that a sensor_msgs/CameraInfo describes."""

from __future__ import annotations

from typing import Sequence

import numpy as np

from people_fusion.core.camera_models import Fisheye, Pinhole
from people_fusion.core.cameras import Camera
from people_fusion.core.errors import DataError


def camera_of(
    width: int,
    height: int,
    model: str,
    D: Sequence[float],
    K: Sequence[float],
    R: Sequence[float],
    P: Sequence[float],
    rectified: bool,
) -> Camera:
    """A camera from the fields of the message.

    Args:
        width, height: pixels.
        model: distortion_model.
        D, K, R, P: as in the message; an R of zeros is none.
        rectified: whether the images are (image_rect, image_rect_color): then P counts and nothing is distorted.

    Raises:
        DataError: a model that is not known, or values that cannot be, as those of a driver that is not calibrated.
    """
    if rectified:
        return Pinhole(width, height, np.reshape(P, (3, 4))[:, :3])
    rotation = np.reshape(R, (3, 3)) if np.any(R) else None
    if model in ("equidistant", "fisheye"):
        return Fisheye(width, height, np.reshape(K, (3, 3)), D, rotation)
    if model not in ("", "plumb_bob", "rational_polynomial"):
        raise DataError("camera of unknown distortion model", repr(model))
    return Pinhole(width, height, np.reshape(K, (3, 3)), D, rotation)
