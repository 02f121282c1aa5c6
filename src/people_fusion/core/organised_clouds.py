"""Point clouds that are images: the depths, the colour and the camera of an organised sensor_msgs/PointCloud2."""

from __future__ import annotations

from typing import Mapping, NamedTuple, Optional, Tuple

import numpy as np

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.cameras import Camera
from people_fusion.core.errors import DataError
from people_fusion.core.pixels import LARGEST

FLOATS = {7: "f4", 8: "f8"}  # of PointField
COLOURS = ("rgb", "rgba")
MISFIT = "point cloud whose data does not fit its size"
LEAST_POINTS = 500  # tell the camera
MOST_POINTS = 20000  # suffice
LARGEST_MISFIT = 2.0  # pixels


class OrganisedCloud(NamedTuple):
    """Points (H, W, 3) of the pixels of an image, metres, NaN where there is none; colour (H, W, 3) blue, green, red,
    uint8, or None."""

    points: np.ndarray
    colour: Optional[np.ndarray]

    @property
    def depths(self) -> np.ndarray:
        """(H, W) float32 metres along z, NaN where there is no point."""
        depths = self.points[..., 2].astype(np.float32)
        with np.errstate(invalid="ignore"):
            depths[~(np.isfinite(self.points).all(axis=2) & (depths > 0.0))] = np.nan
        return depths


def organised_cloud(
    height: int,
    width: int,
    point_step: int,
    row_step: int,
    big_endian: bool,
    fields: Mapping[str, Tuple[int, int]],
    data: bytes,
) -> OrganisedCloud:
    """Of the fields of a sensor_msgs/PointCloud2.

    Args:
        fields: offset and datatype of each by its name.

    Raises:
        DataError: it is not organised, has no coordinates, or less data than its size needs.
    """
    if height <= 1 or width <= 1:
        raise DataError("point cloud that is not organised", f"{width} x {height}")
    if any(fields.get(axis, (0, 0))[1] not in FLOATS for axis in "xyz"):
        raise DataError("point cloud without x, y and z", f"{sorted(fields)}")
    flat = np.frombuffer(data, dtype=np.uint8)
    ends = [
        offset + (8 if kind == 8 else 4) for name, (offset, kind) in fields.items() if name in ("x", "y", "z", *COLOURS)
    ]
    too_small = row_step < width * point_step or len(flat) < row_step * (height - 1) + width * point_step
    if height * width > LARGEST or point_step < max(ends) or too_small:
        raise DataError(MISFIT, f"{width} x {height}, {point_step} bytes a point, {row_step} a row, {len(flat)} in all")
    if len(flat) < row_step * height:  # the last row need not be filled up
        flat = np.concatenate([flat, np.zeros(row_step * height - len(flat), dtype=np.uint8)])
    rows = flat[: row_step * height].reshape(height, row_step)[:, : width * point_step]
    pixels = np.ascontiguousarray(rows).reshape(height, width, point_step)
    order = ">" if big_endian else "<"
    points = np.empty((height, width, 3), dtype=np.float32)
    for column, axis in enumerate("xyz"):
        offset, kind = fields[axis]
        dtype = np.dtype(order + FLOATS[kind])
        raw = np.ascontiguousarray(pixels[..., offset : offset + dtype.itemsize])
        points[..., column] = raw.view(dtype)[..., 0]
    colour = None
    for name in COLOURS:
        if name in fields:
            offset = fields[name][0]
            channels = [offset + byte for byte in ((3, 2, 1) if big_endian else (0, 1, 2))]
            colour = np.ascontiguousarray(pixels[..., channels])
            break
    return OrganisedCloud(points, colour)


def camera_of_points(points: np.ndarray) -> Camera:
    """The pinhole through whose pixels the points (H, W, 3) are seen, by least squares.

    Raises:
        DataError: too few points, or axes that are not those of an image: x right, y down, z ahead.
    """
    height, width = points.shape[:2]
    with np.errstate(invalid="ignore"):
        there = np.flatnonzero((np.isfinite(points).all(axis=2) & (points[..., 2] > 0.0)).ravel())
    if len(there) < LEAST_POINTS:
        raise DataError("point cloud of too few points to tell its camera", f"{len(there)}")
    there = there[:: max(len(there) // MOST_POINTS, 1)]
    seen = points.reshape(-1, 3)[there].astype(float)
    rows, columns = np.divmod(there, width)
    K = np.eye(3)
    for axis, pixels in enumerate((columns, rows)):
        A = np.column_stack([seen[:, axis] / seen[:, 2], np.ones(len(seen))])
        (focal, middle), *_ = np.linalg.lstsq(A, pixels.astype(float), rcond=None)
        misfit = np.sqrt(np.mean((A @ [focal, middle] - pixels) ** 2))
        if not (misfit < LARGEST_MISFIT and focal > 0.0):
            raise DataError("point cloud whose axes are not those of an image", f"misfit {misfit:.1f} pixels")
        K[axis, axis], K[axis, 2] = focal, middle
    return Pinhole(width, height, K)
