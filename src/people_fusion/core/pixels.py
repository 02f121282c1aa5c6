"""Pixels and depths of images as they are sent: raw in the encodings of sensor_msgs/Image, or compressed."""

from __future__ import annotations

import struct
from typing import Any, Dict, Tuple

import numpy as np

from people_fusion.core.errors import DataError

UNKNOWN, MISFIT, UNREADABLE = "image of unknown encoding", "image whose data does not fit its size", "unreadable image"
NO_DEPTHS = "image that holds no depths"
LARGEST = 1 << 28  # pixels; more is a broken header
MAGIC = (b"\x89PNG", b"II*\0", b"MM\0*")  # PNG, TIFF
DEPTH_HEADER = struct.Struct("<iff")  # of compressed_depth_image_transport: kind, and two numbers to undo it with

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
_DEPTHS = {"16UC1": "u2", "mono16": "u2", "32FC1": "f4"}  # millimetres with 0 for none, metres


def raw_pixels(height: int, width: int, step: int, encoding: str, big_endian: bool, data: bytes) -> np.ndarray:
    """(H, W) grey or (H, W, 3) blue, green, red, uint8, of the fields of a sensor_msgs/Image.

    Raises:
        DataError: no pixels, an encoding that is not known, or less data than rows of `step` bytes need.
    """
    if encoding not in _ENCODINGS:
        raise DataError(UNKNOWN, repr(encoding))
    size, channels, conversion = _ENCODINGS[encoding]
    rows = _rows(height, width, step, encoding, channels * size, data)
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


def raw_depths(height: int, width: int, step: int, encoding: str, big_endian: bool, data: bytes) -> np.ndarray:
    """(H, W) float32 metres, NaN where there is no return, of the fields of a sensor_msgs/Image.

    Raises:
        DataError: no pixels, an encoding that holds no depths, or less data than rows of `step` bytes need.
    """
    if encoding not in _DEPTHS:
        raise DataError(NO_DEPTHS, repr(encoding))
    kind = np.dtype((">" if big_endian else "<") + _DEPTHS[encoding])
    return _metres(np.ascontiguousarray(_rows(height, width, step, encoding, kind.itemsize, data)).view(kind))


def compressed_depths(encoding: str, data: bytes) -> np.ndarray:
    """(H, W) float32 metres, NaN where there is no return, of a PNG or TIFF of depths.

    Args:
        encoding: `format` of the sensor_msgs/CompressedImage: "16UC1; compressedDepth", "32FC1; compressedDepth", ...;
            "16UC1; tiff compressed" of a Kinect 2.
        data: the file, with or without the header of compressed_depth_image_transport. In PNGs of 32FC1 are numbers n
            that grow with 1 / depth: depth = a / (n - b) with a and b in that header.

    Raises:
        DataError: it is no picture of depths, or damaged.
    """
    import cv2

    size = DEPTH_HEADER.size
    headed = len(data) > size and bytes(data[: len(MAGIC[0])]) not in MAGIC
    _, a, b = DEPTH_HEADER.unpack(bytes(data[:size])) if headed else (0, 0.0, 0.0)
    flat = np.frombuffer(data, dtype=np.uint8)[size if headed else 0 :]
    pixels = cv2.imdecode(flat, cv2.IMREAD_UNCHANGED) if len(flat) else None
    if pixels is None:
        raise DataError(UNREADABLE, f"{len(data)} bytes {encoding!r}")
    if pixels.ndim != 2 or pixels.dtype != np.uint16 or (encoding.startswith("32FC1") and not headed):
        raise DataError(NO_DEPTHS, f"{encoding!r} of {pixels.dtype}, {pixels.shape}")
    if not encoding.startswith("32FC1"):
        return _metres(pixels)
    with np.errstate(divide="ignore", invalid="ignore"):
        return _metres(np.where(pixels > 0, np.float32(a) / (pixels.astype(np.float32) - np.float32(b)), np.nan))


def pixels_of(message: Any) -> np.ndarray:
    """(H, W) grey or (H, W, 3) blue, green, red, uint8, of a sensor_msgs/Image or CompressedImage, live or recorded.

    Raises:
        DataError: it cannot be read.
    """
    return raw_pixels(*_fields(message)) if hasattr(message, "encoding") else compressed_pixels(message.data)


def depths_of(message: Any) -> np.ndarray:
    """(H, W) float32 metres, NaN where there is no return, of a sensor_msgs/Image or CompressedImage, live or recorded.

    Raises:
        DataError: it cannot be read.
    """
    if hasattr(message, "encoding"):
        return raw_depths(*_fields(message))
    return compressed_depths(message.format, message.data)


def _fields(message: Any) -> Tuple[int, int, int, str, bool, bytes]:
    return message.height, message.width, message.step, message.encoding, bool(message.is_bigendian), message.data


def _rows(height: int, width: int, step: int, encoding: str, size: int, data: bytes) -> np.ndarray:
    """(H, W * size) uint8 of pixels of so many bytes.

    Raises:
        DataError: no pixels, or less data than that.
    """
    if height < 1 or width < 1 or height * width > LARGEST:
        raise DataError(MISFIT, f"{width} x {height}")
    row = width * size
    flat = np.frombuffer(data, dtype=np.uint8)
    if step < row or len(flat) < step * (height - 1) + row:
        raise DataError(MISFIT, f"{width} x {height} {encoding}, {step} bytes a row, {len(flat)} in all")
    if len(flat) < step * height:  # the last row need not be filled up
        flat = np.concatenate([flat, np.zeros(step * height - len(flat), dtype=np.uint8)])
    return flat[: step * height].reshape(height, step)[:, :row]


def _metres(pixels: np.ndarray) -> np.ndarray:
    """Of millimetres, if whole numbers; what is not in front of the camera is none."""
    depths = np.asarray(pixels, dtype=np.float32) * np.float32(0.001 if pixels.dtype.kind == "u" else 1.0)
    with np.errstate(invalid="ignore"):
        depths[~((depths > 0.0) & (depths < np.inf))] = np.nan
    return depths
