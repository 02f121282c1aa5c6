"""Lenses and panoramas: pinhole and fisheye as in CameraInfo, and cylinders.

Frames: pinhole and fisheye have optical frames (REP-103: z forward, x right, y down), panoramas z up, x forward and
y left.
"""

from __future__ import annotations

import abc
import math
from dataclasses import dataclass, replace
from typing import Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.angles import bearings
from people_fusion.core.cameras import Camera
from people_fusion.core.config import parameter
from people_fusion.core.errors import DataError

STEPS = 2000  # of the table of a lens, from the optical axis to the side
LARGEST_ANGLE = math.radians(89.9)  # from the optical axis, of what a pinhole sees
ITERATIONS = 20
STEEPEST = 100.0  # distorted over undistorted; more is the neighbourhood of a pole, where no lens is
FULL_CIRCLE = 6.275  # and what is larger, radians
TOLERANCE = 1e-10  # of re-projection, in focal lengths


class Lens(Camera):
    """A camera with an optical frame and the intrinsics of a CameraInfo.

    Every lens maps directions one to one to the points of a plane at one focal length, as far as its model holds;
    pixels are those points scaled and shifted.

    Args:
        width, height: of the image, pixels.
        K: (3, 3) fx 0 cx / 0 fy cy / 0 0 1, pixels.
        D: distortion coefficients; none of them: no distortion.
        R: (3, 3) rotation into the frame that points and rays are in, from that of the sensor; None: the same. With
            CameraInfo's R it is the frame of the rectified image, which all of ROS takes for the camera's.

    Raises:
        DataError: names the field that no camera can have.
    """

    def __init__(
        self,
        width: int,
        height: int,
        K: np.ndarray,
        D: Sequence[float] = (),
        R: Optional[np.ndarray] = None,
    ) -> None:
        if not (width >= 1 and height >= 1):
            raise DataError("camera without a size", f"width {width}, height {height}")
        self.width, self.height = int(width), int(height)
        self._K = _checked_matrix(K)
        self._D = np.array(D, dtype=float).reshape(-1)
        self._R = np.eye(3) if R is None else _checked_rotation(R)
        self._focal, self._middle = self._K[[0, 1], [0, 1]], self._K[:2, 2]
        if not np.isfinite(self._D).all():
            raise DataError("camera with an impossible D", f"{self._D.tolist()}")

    def project(self, points: np.ndarray) -> np.ndarray:
        """See Camera."""
        with np.errstate(all="ignore"):
            return self._on_plane(np.asarray(points, dtype=float) @ self._R) * self._focal + self._middle

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """See Camera."""
        with np.errstate(all="ignore"):
            return self._directions((pixels - self._middle) / self._focal) @ self._R.T

    def ray_jacobians(self, pixels: np.ndarray) -> np.ndarray:
        """See Camera; analytic."""
        with np.errstate(all="ignore"):
            return self._R @ self._direction_jacobians((pixels - self._middle) / self._focal) / self._focal

    def _scaled(self, width: int, height: int) -> Camera:
        factors = np.array([width / self.width, height / self.height])
        K = self._K.copy()
        K[[0, 1], [0, 1]] *= factors
        K[:2, 2] = (K[:2, 2] + 0.5) * factors - 0.5  # the image's edge stays at -0.5
        return type(self)(width, height, K, self._D.tolist(), self._R)

    @abc.abstractmethod
    def _on_plane(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) of points (N, 3) of the sensor's frame; NaN where the model does not hold."""

    @abc.abstractmethod
    def _directions(self, plane: np.ndarray) -> np.ndarray:
        """(N, 3) unit vectors that go to (N, 2); NaN where none does."""

    @abc.abstractmethod
    def _direction_jacobians(self, plane: np.ndarray) -> np.ndarray:
        """(N, 3, 2) derivative of `_directions`."""


class Pinhole(Lens):
    """A perspective camera with CameraInfo's distortion "plumb_bob" or "rational_polynomial", or without.

    Args:
        D: k1 k2 p1 p2 [k3 [k4 k5 k6]], as OpenCV's.
        others: see Lens.

    The model holds in the cone about the optical axis in which it is one to one: distortion is the gradient of a
    potential, and one to one where that is convex, so where its symmetric Jacobian is positive definite.
    """

    def __init__(
        self, width: int, height: int, K: np.ndarray, D: Sequence[float] = (), R: Optional[np.ndarray] = None
    ) -> None:
        super().__init__(width, height, K, D, R)
        if len(self._D) not in (0, 4, 5, 8):
            raise DataError("camera with an impossible D", f"{len(self._D)} coefficients instead of 0, 4, 5 or 8")
        k1, k2, p1, p2, k3, k4, k5, k6 = np.concatenate([self._D, np.zeros(8 - len(self._D))])
        self._numerator, self._denominator = np.array([k3, k2, k1, 1.0]), np.array([k6, k5, k4, 1.0])
        self._tangential = (p1, p2)
        self._is_ideal = not self._D.any()
        radii = np.tan(np.linspace(0.0, LARGEST_ANGLE, STEPS))
        with np.errstate(all="ignore"):
            scale, slope = self._radial(radii**2)
            # Eigenvalues of the Jacobian along the radius and across it; tangential distortion takes that much at most.
            along, tangential = scale + 2.0 * radii**2 * slope, 6.0 * radii * math.hypot(p1, p2)
            count = _first_false((np.minimum(along, scale) > tangential) & (along < STEEPEST))
        if count < 2:
            raise DataError("camera with an impossible D", f"{self._D.tolist()} folds the image at its middle")
        self._radii, self._distorted_radii = radii[:count], (radii * scale)[:count]
        self._largest_squared = float(radii[count - 1]) ** 2

    def _on_plane(self, points: np.ndarray) -> np.ndarray:
        xy = points[:, :2] / np.where(points[:, 2:] > 0.0, points[:, 2:], np.nan)
        xy[~((xy**2).sum(axis=1) <= self._largest_squared)] = np.nan
        return xy if self._is_ideal else self._distort(xy)[0]

    def _directions(self, plane: np.ndarray) -> np.ndarray:
        return _unit(_on_unit_plane(self._undistort(plane)))

    def _direction_jacobians(self, plane: np.ndarray) -> np.ndarray:
        xy = self._undistort(plane)
        by_xy = _unit_jacobians(_on_unit_plane(xy))[:, :, :2]
        return by_xy if self._is_ideal else by_xy @ _inverse(self._distort(xy)[1])

    def _radial(self, squares: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Factor of radii whose squares are given, and its derivative by the square."""
        n, d = np.polyval(self._numerator, squares), np.polyval(self._denominator, squares)
        n_slope = np.polyval(np.polyder(self._numerator), squares)
        d_slope = np.polyval(np.polyder(self._denominator), squares)
        return np.where(d > 0.0, n / d, np.nan), (n_slope * d - n * d_slope) / d**2

    def _distort(self, xy: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """(N, 2) distorted and (N, 2, 2) Jacobian, symmetric."""
        x, y = xy[:, 0], xy[:, 1]
        p1, p2 = self._tangential
        squares = x * x + y * y
        scale, slope = self._radial(squares)
        distorted = xy * scale[:, None]
        distorted[:, 0] += 2.0 * p1 * x * y + p2 * (squares + 2.0 * x * x)
        distorted[:, 1] += p1 * (squares + 2.0 * y * y) + 2.0 * p2 * x * y
        mixed = 2.0 * (x * y * slope + p1 * x + p2 * y)
        jacobians = np.empty((len(xy), 2, 2))
        jacobians[:, 0, 0] = scale + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
        jacobians[:, 1, 1] = scale + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
        jacobians[:, 0, 1] = jacobians[:, 1, 0] = mixed
        return distorted, jacobians

    def _undistort(self, plane: np.ndarray) -> np.ndarray:
        """(N, 2) undistorted, by Newton's method from where radial distortion alone leads; NaN unless that converges
        within the cone."""
        if self._is_ideal:
            return np.where((plane**2).sum(axis=1, keepdims=True) <= self._largest_squared, plane, np.nan)
        lengths = np.hypot(plane[:, 0], plane[:, 1])
        start = np.interp(lengths, self._distorted_radii, self._radii)
        xy = plane * np.where(lengths > 0.0, start / lengths, 1.0)[:, None]
        for _ in range(ITERATIONS):
            distorted, jacobians = self._distort(xy)
            residuals = distorted - plane
            if not (np.abs(residuals) > 0.01 * TOLERANCE).any():
                break
            xy = xy - (_inverse(jacobians) @ residuals[:, :, None])[:, :, 0]
        good = (np.abs(self._distort(xy)[0] - plane) <= TOLERANCE * (1.0 + np.abs(plane))).all(axis=1)
        good &= (xy**2).sum(axis=1) <= self._largest_squared
        return np.where(good[:, None], xy, np.nan)


class Fisheye(Lens):
    """A lens of up to the full sphere, CameraInfo's "fisheye" or "equidistant" (Kannala & Brandt 2006, eq. 6).

    Args:
        D: k1 k2 k3 k4 of the distance from the image's middle, t (1 + k1 t^2 + k2 t^4 + k3 t^6 + k4 t^8) focal lengths
            at the angle t from the optical axis, as OpenCV's.
        others: see Lens.

    The model holds up to the angle at which that distance stops to grow.
    """

    def __init__(
        self, width: int, height: int, K: np.ndarray, D: Sequence[float] = (), R: Optional[np.ndarray] = None
    ) -> None:
        super().__init__(width, height, K, D, R)
        if len(self._D) not in (0, 4):
            raise DataError("camera with an impossible D", f"{len(self._D)} coefficients instead of 0 or 4")
        k1, k2, k3, k4 = self._D if len(self._D) else np.zeros(4)
        self._distance = np.array([k4, 0.0, k3, 0.0, k2, 0.0, k1, 0.0, 1.0, 0.0])
        self._slope = np.polyder(self._distance)
        angles = np.linspace(0.0, math.pi, STEPS)
        count = _first_false(np.polyval(self._slope, angles) > 0.0)
        if count < 2:
            raise DataError("camera with an impossible D", f"{self._D.tolist()} folds the image at its middle")
        self._angles, self._distances = angles[:count], np.polyval(self._distance, angles[:count])

    def _on_plane(self, points: np.ndarray) -> np.ndarray:
        across = np.hypot(points[:, 0], points[:, 1])
        angles = np.arctan2(across, points[:, 2])
        distances = np.where(angles <= self._angles[-1], np.polyval(self._distance, angles), np.nan)
        on_axis = np.where(points[:, 2] > 0.0, 0.0, np.nan)[:, None]
        return np.where(across[:, None] > 0.0, points[:, :2] * (distances / across)[:, None], on_axis)

    def _directions(self, plane: np.ndarray) -> np.ndarray:
        outward, _, angles = self._polar(plane)
        return np.column_stack([outward * np.sin(angles)[:, None], np.cos(angles)])

    def _direction_jacobians(self, plane: np.ndarray) -> np.ndarray:
        outward, distances, angles = self._polar(plane)
        around = np.column_stack([-outward[:, 1], outward[:, 0]])
        farther = np.column_stack([outward * np.cos(angles)[:, None], -np.sin(angles)])
        farther /= np.polyval(self._slope, angles)[:, None]
        aside = np.column_stack([around, np.zeros(len(plane))])
        aside *= np.where(distances > 0.0, np.sin(angles) / distances, 1.0)[:, None]
        return farther[:, :, None] * outward[:, None, :] + aside[:, :, None] * around[:, None, :]

    def _polar(self, plane: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of points (N, 2): direction from the middle (N, 2), distance (N,) and angle (N,) from the optical axis."""
        distances = np.hypot(plane[:, 0], plane[:, 1])
        outward = np.where(distances[:, None] > 0.0, plane / distances[:, None], [1.0, 0.0])
        angles = np.interp(distances, self._distances, self._angles)
        for _ in range(ITERATIONS):
            residuals = np.polyval(self._distance, angles) - distances
            if not (np.abs(residuals) > 0.01 * TOLERANCE).any():
                break
            angles = angles - residuals / np.polyval(self._slope, angles)
        good = np.abs(np.polyval(self._distance, angles) - distances) <= TOLERANCE * (1.0 + distances)
        good &= (angles >= 0.0) & (angles <= self._angles[-1])
        return outward, distances, np.where(good, angles, np.nan)


@dataclass(frozen=True)
class PanoramaConfig:
    """A cylindrical image; the defaults are Poschmann's, four stitched cameras on a SCITOS."""

    width: int = parameter(1406, "of the image, pixels", low=1)
    height: int = parameter(240, "of the image, pixels", low=1)
    left_edge: float = parameter(
        math.pi, "azimuth of the image's left edge in the camera's frame, counterclockwise from its x axis, radians"
    )
    field: float = parameter(
        6.2832, "of view across, clockwise from the left edge, radians; 6.28 is a full circle", low=1e-3, high=6.2832
    )
    horizon: Optional[float] = parameter(None, "row at the camera's height, 0 is the topmost; null: the middle")
    rows_per_slope: Optional[float] = parameter(
        None, "rows that a slope of 1 takes, the tangent of the elevation; null: pixels are square at the horizon", 1e-3
    )


class Panorama(Camera):
    """A cylinder about the z axis, unrolled; of a full circle the right edge is the left one.

    Columns to the right and left of a full circle are those that they come to around it.
    """

    def __init__(self, config: PanoramaConfig) -> None:
        self.config = config
        self.width, self.height = config.width, config.height
        self.wraps = config.field > FULL_CIRCLE
        field = 2.0 * math.pi if self.wraps else config.field
        self._columns_per_radian = config.width / field
        self._azimuth = config.left_edge - 0.5 * field  # of the middle
        self._rows_per_slope = config.rows_per_slope or self._columns_per_radian
        self._middle = np.array(
            [0.5 * (config.width - 1), 0.5 * (config.height - 1) if config.horizon is None else config.horizon]
        )

    def project(self, points: np.ndarray) -> np.ndarray:
        """See Camera; columns of a full circle are within the image, others to the nearer side of it."""
        points = np.asarray(points, dtype=float)
        with np.errstate(all="ignore"):
            flat = np.hypot(points[:, 0], points[:, 1])
            clockwise = self._azimuth - bearings(points)
            clockwise = (clockwise + math.pi) % (2.0 * math.pi) - math.pi
            slopes = points[:, 2] / flat
            pixels = np.column_stack([clockwise * self._columns_per_radian, -slopes * self._rows_per_slope])
            return np.where(np.isfinite(slopes)[:, None], pixels + self._middle, np.nan)

    def rays(self, pixels: np.ndarray) -> np.ndarray:
        """See Camera."""
        return _unit(self._on_cylinder(pixels))

    def ray_jacobians(self, pixels: np.ndarray) -> np.ndarray:
        """See Camera; analytic."""
        flat = self._on_cylinder(pixels)
        by_pixel = np.zeros((len(flat), 3, 2))
        by_pixel[:, 0, 0], by_pixel[:, 1, 0] = flat[:, 1], -flat[:, 0]
        by_pixel[:, :, 0] /= self._columns_per_radian
        by_pixel[:, 2, 1] = -1.0 / self._rows_per_slope
        return _unit_jacobians(flat) @ by_pixel

    def _on_cylinder(self, pixels: np.ndarray) -> np.ndarray:
        """(N, 3) of radius 1."""
        clockwise, down = ((pixels - self._middle) / [self._columns_per_radian, self._rows_per_slope]).T
        if not self.wraps:
            clockwise = np.where(np.abs(clockwise) <= math.pi, clockwise, np.nan)
        azimuths = np.where(np.isfinite(clockwise), self._azimuth - clockwise, np.nan)
        return np.column_stack([np.cos(azimuths), np.sin(azimuths), -down])

    def _scaled(self, width: int, height: int) -> Camera:
        config, factor = self.config, height / self.height
        rows, horizon = config.rows_per_slope, config.horizon
        return Panorama(
            replace(
                config,
                width=width,
                height=height,
                horizon=None if horizon is None else (horizon + 0.5) * factor - 0.5,
                rows_per_slope=None if rows is None else rows * factor,
            )
        )


def _checked_matrix(K: np.ndarray) -> np.ndarray:
    matrix = np.array(K, dtype=float).reshape(3, 3)
    if not matrix.any():
        raise DataError("camera without a calibration", "K is zero")
    form = np.array([[matrix[0, 0], 0.0, matrix[0, 2]], [0.0, matrix[1, 1], matrix[1, 2]], [0.0, 0.0, 1.0]])
    if not (np.isfinite(matrix).all() and (matrix == form).all() and min(matrix[0, 0], matrix[1, 1]) > 0.0):
        raise DataError("camera with an impossible K", f"{matrix.tolist()} is not fx 0 cx / 0 fy cy / 0 0 1")
    return matrix


def _checked_rotation(R: np.ndarray) -> np.ndarray:
    matrix = np.array(R, dtype=float).reshape(3, 3)
    is_rotation = np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-4) and np.linalg.det(matrix) > 0.0
    if not is_rotation:
        raise DataError("camera with an impossible R", f"{matrix.tolist()} is no rotation")
    return matrix


def _first_false(flags: np.ndarray) -> int:
    return len(flags) if flags.all() else int(np.argmin(flags))


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """(N, 2, 2) of symmetric ones."""
    a, b, c = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    return np.array([[c, -b], [-b, a]]).transpose(2, 0, 1) / (a * c - b * b)[:, None, None]


def _on_unit_plane(xy: np.ndarray) -> np.ndarray:
    """(N, 3) with z 1."""
    return np.column_stack([xy, np.ones(len(xy))])


def _unit(vectors: np.ndarray) -> np.ndarray:
    """(N, 3) of length 1."""
    return vectors / np.linalg.norm(vectors, axis=1)[:, None]


def _unit_jacobians(vectors: np.ndarray) -> np.ndarray:
    """(N, 3, 3) derivative of `_unit`."""
    lengths = np.linalg.norm(vectors, axis=1)[:, None, None]
    rays = vectors[:, :, None] / lengths
    return (np.eye(3) - rays * np.swapaxes(rays, 1, 2)) / lengths
