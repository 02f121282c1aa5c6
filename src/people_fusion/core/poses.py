"""Poses in SE(3), in batches, with and without covariance, under ROS's convention (REP-103).

The error of a pose is (x, y, z, rotX, rotY, rotZ): a translation and a small rotation about the fixed axes of the
parent frame, that is  R_true = exp([rot]x) R,  t_true = t + xyz.  The rotation does not turn the translation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, List, Tuple, Union

import numpy as np

from people_fusion.core.errors import DataError


@dataclass(frozen=True, eq=False)
class Pose:
    """Rigid transform parent_from_child, or a batch of them.

    Attributes:
        rotation: (..., 3, 3).
        translation: (..., 3) metres.
    """

    rotation: np.ndarray
    translation: np.ndarray

    @staticmethod
    def identity() -> Pose:
        """The transform that changes nothing."""
        return Pose(np.eye(3), np.zeros(3))

    @staticmethod
    def from_quaternion(translation: np.ndarray, quaternion: np.ndarray) -> Pose:
        """Pose from (..., 3) metres and (..., 4) x y z w, which is normalised.

        Raises:
            DataError: if a value is not finite or a quaternion is zero.
        """
        translation = np.asarray(translation, dtype=float)
        quaternion = np.asarray(quaternion, dtype=float)
        norm = np.sqrt(np.sum(quaternion * quaternion, axis=-1, keepdims=True))
        if not (np.isfinite(translation).all() and np.isfinite(norm).all()):
            raise DataError("pose is not finite", f"translation {translation}, quaternion {quaternion}")
        if not norm.all():
            raise DataError("quaternion is zero")
        return Pose(_matrix_from_quaternion(quaternion / norm), translation)

    @staticmethod
    def from_xy_yaw(x: float, y: float, yaw: float, z: float = 0.0) -> Pose:
        """Pose in the plane."""
        cos, sin = math.cos(yaw), math.sin(yaw)
        rotation = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return Pose(rotation, np.array([x, y, z], dtype=float))

    @property
    def quaternion(self) -> np.ndarray:
        """(..., 4) x y z w, w not negative."""
        if self.rotation.ndim == 2:
            return np.array(_quaternion_from_matrix(self.rotation))
        rows = [_quaternion_from_matrix(matrix) for matrix in self.rotation.reshape(-1, 3, 3)]
        return np.array(rows).reshape(*self.rotation.shape[:-2], 4)

    @property
    def yaw(self) -> np.ndarray:
        """(...) rotation about z of the fixed-axes (roll, pitch, yaw) decomposition, radians."""
        return np.arctan2(self.rotation[..., 1, 0], self.rotation[..., 0, 0])

    def __matmul__(self, other: Pose) -> Pose:
        """parent_from_child @ child_from_grandchild."""
        return Pose(self.rotation @ other.rotation, self.apply(other.translation))

    def inverse(self) -> Pose:
        """child_from_parent."""
        if self.rotation.ndim == 2:
            return Pose(self.rotation.T, -(self.translation @ self.rotation))
        rotation = np.swapaxes(self.rotation, -1, -2)
        return Pose(rotation, -(rotation @ self.translation[..., None])[..., 0])

    def apply(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points of the child frame in the parent frame; of a batch of poses one point each or one for all."""
        if self.rotation.ndim == 2:
            return points @ self.rotation.T + self.translation
        return (self.rotation @ points[..., None])[..., 0] + self.translation

    def perturbed(self, error: np.ndarray) -> Pose:
        """The pose whose error is (..., 6) x y z rotX rotY rotZ, see the module."""
        return Pose(rotation_from_vector(error[..., 3:]) @ self.rotation, self.translation + error[..., :3])


@dataclass(frozen=True, eq=False)
class UncertainPose:
    """A single pose with covariance.

    Attributes:
        mean: the pose.
        covariance: (6, 6) of its error in the order x y z rotX rotY rotZ, see the module.
    """

    mean: Pose
    covariance: np.ndarray

    @staticmethod
    def certain(mean: Pose) -> UncertainPose:
        """A pose without error."""
        return UncertainPose(mean, np.zeros((6, 6)))

    def __matmul__(self, other: UncertainPose) -> UncertainPose:
        """Composition of two independent poses; Volkhardt eq. 1 for poses."""
        J_w = lever_jacobian(self.mean.rotation @ other.mean.translation)
        J_a = np.zeros((6, 6))
        J_a[:3, :3] = J_a[3:, 3:] = self.mean.rotation
        C_y = J_a @ other.covariance @ J_a.T + J_w @ self.covariance @ J_w.T
        return UncertainPose(self.mean @ other.mean, C_y)

    def inverse(self) -> UncertainPose:
        """child_from_parent."""
        inverse = self.mean.inverse()
        J = np.zeros((6, 6))
        J[:3, :3] = J[3:, 3:] = -inverse.rotation
        J[:3, 3:] = -inverse.rotation @ skew(self.mean.translation)
        return UncertainPose(inverse, J @ self.covariance @ J.T)

    def point_jacobians(self, points: np.ndarray) -> np.ndarray:
        """(N, 3, 6) derivative of transformed points with respect to the pose's error; points (N, 3) in the child."""
        return point_jacobians(self.mean, points)

    def transform(self, points: np.ndarray, covariances: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Points (N, 3) with covariances (N, 3, 3) of the child in the parent frame; Volkhardt eq. 1."""
        J_w, J_a = self.point_jacobians(points), self.mean.rotation
        C_y = J_a @ covariances @ J_a.T + J_w @ self.covariance @ np.swapaxes(J_w, -1, -2)
        return self.mean.apply(points), C_y


def interpolate(first: Pose, second: Pose, fractions: Union[float, np.ndarray]) -> Pose:
    """(F,) poses on the way from `first` (0) to `second` (1): straight in translation, constant turn in rotation.

    Of single poses `first` and `second`. A scalar fraction gives a single pose.
    """
    x, y, z, w = _quaternion_from_matrix(first.rotation.T @ second.rotation)
    sine = math.sqrt(x * x + y * y + z * z)
    half_angle = math.atan2(sine, w)
    if isinstance(fractions, float):
        s = math.sin(fractions * half_angle) / sine if sine else 0.0
        turn = _matrix_from_components(x * s, y * s, z * s, math.cos(fractions * half_angle))
        way = fractions * (second.translation - first.translation)
    else:
        fractions = np.asarray(fractions, dtype=float)
        scale = np.sin(fractions * half_angle) / sine if sine else np.zeros_like(fractions)
        turn = _matrix_from_components(x * scale, y * scale, z * scale, np.cos(fractions * half_angle))
        way = fractions[..., None] * (second.translation - first.translation)
    return Pose(first.rotation @ turn, first.translation + way)


def point_jacobians(pose: Pose, points: np.ndarray) -> np.ndarray:
    """(N, 3, 6) derivative of pose.apply(points) with respect to the error of the single `pose`; points (N, 3)."""
    jacobians = np.empty((len(points), 3, 6))
    jacobians[:, :, :3] = np.eye(3)
    jacobians[:, :, 3:] = -skew(points @ pose.rotation.T)
    return jacobians


def lever_jacobian(lever: np.ndarray) -> np.ndarray:
    """(6, 6) derivative of a composed pose's error with respect to the error of its left part.

    Args:
        lever: (3,) from the left part's child to the composed pose's child, in the axes of the left part's parent.
    """
    jacobian = np.eye(6)
    jacobian[:3, 3:] = -skew(lever)
    return jacobian


def skew(vectors: np.ndarray) -> np.ndarray:
    """(..., 3, 3) matrices [v]x with [v]x u = v x u, of (..., 3) vectors."""
    x, y, z = _components(vectors)
    o = 0.0 if np.ndim(vectors) == 1 else np.zeros_like(x)
    return _last_axes(np.array([[o, -z, y], [z, o, -x], [-y, x, o]]))


def rotation_from_vector(vectors: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotations exp([v]x) of (..., 3) vectors, radians."""
    vectors = np.asarray(vectors, dtype=float)
    half_angles = 0.5 * np.linalg.norm(vectors, axis=-1, keepdims=True)
    sines = 0.5 * np.sinc(half_angles / math.pi) * vectors
    return _matrix_from_quaternion(np.concatenate([sines, np.cos(half_angles)], axis=-1))


def vector_from_rotation(rotation: np.ndarray) -> np.ndarray:
    """(3,) vector v of a single rotation exp([v]x), at most pi long, radians."""
    x, y, z, w = _quaternion_from_matrix(rotation)
    sine = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(sine, w) / sine if sine else 2.0
    return scale * np.array([x, y, z])


def _matrix_from_quaternion(quaternion: np.ndarray) -> np.ndarray:
    return _matrix_from_components(*_components(quaternion))


def _matrix_from_components(x: Any, y: Any, z: Any, w: Any) -> np.ndarray:
    """Rotations of unit quaternions whose components are floats or arrays."""
    xx, yy, zz, xy, xz, yz, wx, wy, wz = x * x, y * y, z * z, x * y, x * z, y * z, w * x, w * y, w * z
    rows = [
        [1.0 - 2.0 * (yy + zz), 2.0 * (xy - wz), 2.0 * (xz + wy)],
        [2.0 * (xy + wz), 1.0 - 2.0 * (xx + zz), 2.0 * (yz - wx)],
        [2.0 * (xz - wy), 2.0 * (yz + wx), 1.0 - 2.0 * (xx + yy)],
    ]
    return _last_axes(np.array(rows))


def _quaternion_from_matrix(matrix: np.ndarray) -> Tuple[float, float, float, float]:
    """x y z w of one rotation, w not negative: the row of 4 q q' with the largest diagonal element (Shepperd 1978)."""
    (a, b, c), (d, e, f), (g, h, i) = matrix.tolist()
    diagonal = (1.0 + a - e - i, 1.0 - a + e - i, 1.0 - a - e + i, 1.0 + a + e + i)
    largest = diagonal.index(max(diagonal))
    x, y, z, w = (
        (diagonal[0], b + d, c + g, h - f),
        (b + d, diagonal[1], f + h, c - g),
        (c + g, f + h, diagonal[2], d - b),
        (h - f, c - g, d - b, diagonal[3]),
    )[largest]
    scale = math.copysign(1.0 / math.sqrt(x * x + y * y + z * z + w * w), w)
    return x * scale, y * scale, z * scale, w * scale


def _components(vectors: np.ndarray) -> List[Any]:
    """Last axis apart: floats of a single vector (quick), arrays of a batch."""
    vectors = np.asarray(vectors, dtype=float)
    return vectors.tolist() if vectors.ndim == 1 else list(np.moveaxis(vectors, -1, 0))


def _last_axes(matrices: np.ndarray) -> np.ndarray:
    """(3, 3, ...) as (..., 3, 3)."""
    return matrices if matrices.ndim == 2 else np.ascontiguousarray(np.moveaxis(matrices, (0, 1), (-2, -1)))
