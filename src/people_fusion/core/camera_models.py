"""The cameras that robots have: pinhole, fish-eye, and panoramas stitched onto a cylinder.

Pinholes and fish-eyes look along z of their optical frame, x to the right and y down (REP 103). A panorama stands
upright in a frame with x ahead, y to the left and z up.
"""

from __future__ import annotations

import abc
import copy
import math
from dataclasses import dataclass
from typing import Sequence, Tuple

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.core.config import parameter
from people_fusion.core.errors import DataError

ITERATIONS = 20  # of Newton's method; a few are enough where the model is sound
CLOSE = 1e-9  # of rays, in the plane one metre ahead
STEP = 1e-5  # of central differences, pixels relative to the focal length


class _Optical(Camera):
    """Focal lengths and middle of the image, around a distortion of the plane one metre ahead."""

    def __init__(self, width: int, height: int, focal: Tuple[float, float], middle: Tuple[float, float]) -> None:
        if width < 1 or height < 1:
            raise DataError("camera without pixels", f"{width} x {height}")
        if not (np.isfinite([*focal, *middle]).all() and min(focal) > 0.0):
            raise DataError("camera with focal length or middle that cannot be", f"{focal}, {middle}")
        self.width, self.height = int(width), int(height)
        self.focal, self.middle = np.array(focal, dtype=float), np.array(middle, dtype=float)

    def resized(self, width: int, height: int) -> Camera:
        """See Camera; binned images are of the same aspect, but for a row or column that is left over."""
        if (width, height) == (self.width, self.height):
            return self
        scale = width / self.width
        if width < 1 or abs(scale * self.height - height) > 1.0:
            return super().resized(width, height)
        other = copy.copy(self)
        other.width, other.height = width, height
        other.focal, other.middle = scale * self.focal, scale * (self.middle + 0.5) - 0.5
        return other

    def project(self, points: np.ndarray) -> np.ndarray:
        """See Camera."""
        return np.asarray(self._distorted(np.asarray(points, dtype=float)) * self.focal + self.middle)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """See Camera."""
        return self._undistorted((np.asarray(pixels, dtype=float) - self.middle) / self.focal)

    def ray_jacobians(self, pixels: np.ndarray) -> np.ndarray:
        """See Camera; by central differences, good to 1e-6 of their size."""
        pixels = np.asarray(pixels, dtype=float)
        columns = []
        for axis in range(2):
            step = np.zeros(2)
            step[axis] = STEP * self.focal[axis]
            columns.append((self.rays(pixels + step) - self.rays(pixels - step)) / (2.0 * step[axis]))
        return np.stack(columns, axis=2)

    @abc.abstractmethod
    def _distorted(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) of points (N, 3)."""

    @abc.abstractmethod
    def _undistorted(self, plane: np.ndarray) -> np.ndarray:
        """(N, 3) unit rays of distorted (N, 2)."""


class Pinhole(_Optical):
    """A lens that keeps lines straight but for a polynomial distortion.

    Args:
        width, height: pixels.
        focal: fx, fy, pixels.
        middle: cx, cy, pixels.
        distortion: none, or k1 k2 p1 p2 [k3 [k4 k5 k6]] («plumb_bob», «rational_polynomial»).

    Raises:
        DataError: sizes, focal lengths or coefficients that cannot be.
    """

    def __init__(
        self,
        width: int,
        height: int,
        focal: Tuple[float, float],
        middle: Tuple[float, float],
        distortion: Sequence[float] = (),
    ) -> None:
        super().__init__(width, height, focal, middle)
        if len(distortion) not in (0, 4, 5, 8) or not np.isfinite(distortion).all():
            raise DataError("camera with distortion that cannot be", f"{list(distortion)}")
        self.distortion = np.zeros(8)
        self.distortion[: len(distortion)] = distortion
        self._reach = self._least_fold()

    def _distorted(self, points: np.ndarray) -> np.ndarray:
        with np.errstate(divide="ignore", invalid="ignore"):
            plane = points[:, :2] / np.where(points[:, 2] > 0.0, points[:, 2], np.nan)[:, None]
            plane[(plane**2).sum(axis=1) > self._reach] = np.nan
        return self._bent(plane)

    def _bent(self, plane: np.ndarray) -> np.ndarray:
        k1, k2, p1, p2, k3, k4, k5, k6 = self.distortion
        x, y = plane.T
        r2 = x * x + y * y
        radial = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return np.column_stack([
            x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
            y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
        ])  # fmt: skip

    def _undistorted(self, plane: np.ndarray) -> np.ndarray:
        guess = plane.copy()
        if self.distortion.any():
            for _ in range(ITERATIONS):
                guess = guess - np.einsum("nij,nj->ni", self._inverse_slopes(guess), self._bent(guess) - plane)
            with np.errstate(invalid="ignore"):
                wrong = np.abs(self._bent(guess) - plane).max(axis=1, initial=0.0) > CLOSE
                wrong |= (guess**2).sum(axis=1) > self._reach
            guess[wrong] = np.nan
        rays = np.column_stack([guess, np.ones(len(guess))])
        return np.asarray(rays / np.linalg.norm(rays, axis=1)[:, None])

    def _inverse_slopes(self, plane: np.ndarray) -> np.ndarray:
        """(N, 2, 2) inverse of the derivative of `_bent`; zero where there is none."""
        step = 1e-6
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            a, c = ((self._bent(plane + [step, 0.0]) - self._bent(plane - [step, 0.0])) / (2.0 * step)).T
            b, d = ((self._bent(plane + [0.0, step]) - self._bent(plane - [0.0, step])) / (2.0 * step)).T
            inverse = np.stack([np.stack([d, -b], axis=1), np.stack([-c, a], axis=1)], axis=1)
            inverse /= (a * d - b * c)[:, None, None]
        return np.where(np.isfinite(inverse), inverse, 0.0)

    def _least_fold(self) -> float:
        """Squared distance from the axis up to which what is farther out is seen farther out."""
        if not self.distortion.any():
            return math.inf
        radii = np.linspace(0.0, 10.0, 2001)
        with np.errstate(divide="ignore", invalid="ignore"):
            seen = self._bent(np.column_stack([radii, np.zeros(len(radii))]))[:, 0]
        folds = np.flatnonzero(~(np.diff(seen) > 0.0))
        return float(radii[folds[0]] ** 2) if len(folds) else math.inf


class Fisheye(_Optical):
    """A lens whose radius in the image is a polynomial of the angle from the axis (Kannala & Brandt 2006).

    Args:
        width, height, focal, middle: see Pinhole.
        distortion: k1 k2 k3 k4 («equidistant», «fisheye»).

    Raises:
        DataError: sizes, focal lengths or coefficients that cannot be.
    """

    def __init__(
        self,
        width: int,
        height: int,
        focal: Tuple[float, float],
        middle: Tuple[float, float],
        distortion: Sequence[float],
    ) -> None:
        super().__init__(width, height, focal, middle)
        if len(distortion) != 4 or not np.isfinite(distortion).all():
            raise DataError("fish-eye with distortion that cannot be", f"{list(distortion)}")
        self.distortion = np.array(distortion, dtype=float)
        angles = np.linspace(0.0, math.pi, 1801)
        folds = np.flatnonzero(~(np.diff(self._radii(angles)) > 0.0))
        self._widest = float(angles[folds[0]]) if len(folds) else math.pi

    def _radii(self, angles: np.ndarray) -> np.ndarray:
        k1, k2, k3, k4 = self.distortion
        squares = angles * angles
        return np.asarray(angles * (1.0 + squares * (k1 + squares * (k2 + squares * (k3 + squares * k4)))))

    def _distorted(self, points: np.ndarray) -> np.ndarray:
        beside = np.hypot(points[:, 0], points[:, 1])
        angles = np.arctan2(beside, points[:, 2])
        radii = np.where(angles < self._widest, self._radii(angles), np.nan)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = np.where(beside > 0.0, radii / beside, 0.0)
        return np.asarray(points[:, :2] * scale[:, None])

    def _undistorted(self, plane: np.ndarray) -> np.ndarray:
        radii = np.hypot(plane[:, 0], plane[:, 1])
        k = self.distortion * [3.0, 5.0, 7.0, 9.0]
        angles = np.clip(radii, 0.0, self._widest)
        for _ in range(ITERATIONS):
            squares = angles * angles
            slopes = 1.0 + squares * (k[0] + squares * (k[1] + squares * (k[2] + squares * k[3])))
            with np.errstate(divide="ignore", invalid="ignore"):
                step = (self._radii(angles) - radii) / slopes
            angles = np.clip(angles - np.where(np.isfinite(step), step, 0.0), 0.0, self._widest)
        with np.errstate(divide="ignore", invalid="ignore"):
            angles[np.abs(self._radii(angles) - radii) > CLOSE] = np.nan
            scale = np.where(radii > 0.0, np.sin(angles) / radii, 1.0)
        return np.column_stack([plane * scale[:, None], np.cos(angles)])


@dataclass(frozen=True)
class PanoramaConfig:
    """A panorama as it was stitched; the default is that of a SCITOS: four cameras, full circle."""

    width: int = parameter(1406, "pixels", low=1)
    height: int = parameter(240, "pixels", low=1)
    left_edge: float = parameter(180.0, "direction of the left edge, degrees to the left of ahead", -360.0, 360.0)
    field: float = parameter(360.0, "seen from the left edge to the right one, degrees", 1.0, 360.0)
    horizon: float = parameter(119.5, "row of what is as high as the camera, pixels")
    rows_per_slope: float = parameter(
        0.0, "rows from the horizon to what rises as much as it is away; 0: as fine as the columns", low=0.0
    )


class Panorama(Camera):
    """Images on a cylinder: columns are directions, from left to right clockwise seen from above, rows are slopes."""

    def __init__(self, config: PanoramaConfig) -> None:
        self.config = config
        self.width, self.height = config.width, config.height
        self.wraps = config.field == 360.0
        self._per_column = math.radians(config.field) / config.width
        self._per_slope = config.rows_per_slope or 1.0 / self._per_column
        self._left = math.radians(config.left_edge)

    def project(self, points: np.ndarray) -> np.ndarray:
        """See Camera. Columns lie in [-0.5, width of a full circle - 0.5)."""
        points = np.asarray(points, dtype=float)
        flat = np.hypot(points[:, 0], points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            slopes = points[:, 2] / np.where(flat > 0.0, flat, np.nan)
        turned = (self._left - np.arctan2(points[:, 1], points[:, 0])) % (2.0 * math.pi)
        return np.column_stack([turned / self._per_column - 0.5, self.config.horizon - slopes * self._per_slope])

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """See Camera; columns beyond the edges go on around."""
        pixels = np.asarray(pixels, dtype=float)
        angles = self._left - (pixels[:, 0] + 0.5) * self._per_column
        slopes = (self.config.horizon - pixels[:, 1]) / self._per_slope
        rays = np.column_stack([np.cos(angles), np.sin(angles), slopes])
        return np.asarray(rays / np.sqrt(1.0 + slopes**2)[:, None])

    def ray_jacobians(self, pixels: np.ndarray) -> np.ndarray:
        """See Camera."""
        x, y, z = self.rays(pixels).T
        by_column = self._per_column * np.column_stack([y, -x, np.zeros(len(x))])
        flat = np.hypot(x, y)  # the cosine of the elevation
        by_row = -(flat**2 / self._per_slope)[:, None] * np.column_stack([-x * z / flat, -y * z / flat, flat])
        return np.stack([by_column, by_row], axis=2)


def camera_of(
    width: int, height: int, model: str, K: Sequence[float], D: Sequence[float], P: Sequence[float], rectified: bool
) -> Camera:
    """The camera that a sensor_msgs/CameraInfo describes.

    Args:
        width, height, model, K, D, P: fields of the message.
        rectified: whether the images are (image_rect, image_rect_color): then P counts and nothing is distorted.

    Raises:
        DataError: a model that is not known, or values that cannot be, as those of a driver that is not calibrated.
    """
    if rectified:
        return Pinhole(width, height, (P[0], P[5]), (P[2], P[6]))
    focal, middle = (K[0], K[4]), (K[2], K[5])
    if model in ("equidistant", "fisheye"):
        return Fisheye(width, height, focal, middle, D)
    if model not in ("", "plumb_bob", "rational_polynomial"):
        raise DataError("camera of unknown distortion model", repr(model))
    return Pinhole(width, height, focal, middle, D)
