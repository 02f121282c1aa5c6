"""Pixels of images as they are sent: raw in the encodings of sensor_msgs/Image, or compressed."""

from __future__ import annotations

from typing import Dict, Tuple

import numpy as np

from people_fusion.core.errors import DataError

UNKNOWN, MISFIT, UNREADABLE = "image of unknown encoding", "image whose data does not fit its size", "unreadable image"
LARGEST = 1 << 28  # pixels; more is a broken header

# Bytes a channel, channels, and OpenCV's name of the conversion to grey or to blue, green, red.
_ENCODINGS: Dict[str, Tuple[int, int, str]] = {
    "mono8": (1, 1, ""),
    "8UC1": (1, 1, ""),
    "bgr8": (1, 3, ""),
    "8UC3": (1, 3, ""),
    "rgb8": (1, 3, "COLOR_RGB2BGR"),
    "bgra8": (1, 4, "COLOR_BGRA2BGR"),
    "8UC4": (1, 4, "COLOR_BGRA2BGR"),
    "rgba8": (1, 4, "COLOR_RGBA2BGR"),
    "mono16": (2, 1, ""),
    # OpenCV names a mosaic by the second row's second and third pixel.
    "bayer_rggb8": (1, 1, "COLOR_BayerBG2BGR"),
    "bayer_bggr8": (1, 1, "COLOR_BayerRG2BGR"),
    "bayer_gbrg8": (1, 1, "COLOR_BayerGR2BGR"),
    "bayer_grbg8": (1, 1, "COLOR_BayerGB2BGR"),
    "yuv422": (1, 2, "COLOR_YUV2BGR_UYVY"),
    "yuv422_yuy2": (1, 2, "COLOR_YUV2BGR_YUY2"),
}


def raw_pixels(height: int, width: int, step: int, encoding: str, big_endian: bool, data: bytes) -> np.ndarray:
    """(H, W) grey or (H, W, 3) blue, green, red, uint8, of the fields of a sensor_msgs/Image.

    Raises:
        DataError: no pixels, an encoding that is not known, or less data than rows of `step` bytes need.
    """
    if height < 1 or width < 1 or height * width > LARGEST:
        raise DataError(MISFIT, f"{width} x {height}")
    if encoding not in _ENCODINGS:
        raise DataError(UNKNOWN, repr(encoding))
    size, channels, conversion = _ENCODINGS[encoding]
    row = width * channels * size
    flat = np.frombuffer(data, dtype=np.uint8)
    if step < row or len(flat) < step * (height - 1) + row:
        raise DataError(MISFIT, f"{width} x {height} {encoding}, {step} bytes a row, {len(flat)} in all")
    if len(flat) < step * height:  # the last row need not be filled up
        flat = np.concatenate([flat, np.zeros(step * height - len(flat), dtype=np.uint8)])
    rows = flat[: step * height].reshape(height, step)[:, :row]
    if size == 2:
        return np.ascontiguousarray(rows[:, 0 if big_endian else 1 :: 2])  # the upper half is what the eye sees
    pixels = np.ascontiguousarray(rows).reshape((height, width) if channels == 1 else (height, width, channels))
    if not conversion:
        return pixels
    import cv2  # 100 MB: not for those who see no images

    try:
        return np.asarray(cv2.cvtColor(pixels, getattr(cv2, conversion)))
    except cv2.error as error:  # a mosaic or pairs of pixels that are too few
        raise DataError(MISFIT, f"{width} x {height} {encoding}") from error


def compressed_pixels(data: bytes) -> np.ndarray:
    """(H, W) grey or (H, W, 3) blue, green, red, uint8, of a JPEG or PNG.

    Raises:
        DataError: it is neither, or damaged.
    """
    import cv2

    flat = np.frombuffer(data, dtype=np.uint8)
    pixels = cv2.imdecode(flat, cv2.IMREAD_ANYCOLOR) if len(flat) else None
    if pixels is None:
        raise DataError(UNREADABLE, f"{len(flat)} bytes")
    return np.asarray(pixels)
