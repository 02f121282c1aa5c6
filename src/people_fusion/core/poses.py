"""Poses in SE(3), in batches, with and without covariance, under ROS's convention (REP-103).

The error of a pose is (x, y, z, rotX, rotY, rotZ): a translation and a small rotation about the fixed axes of the
parent frame, that is  R_true = exp([rot]x) R,  t_true = t + xyz.  The rotation does not turn the translation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np


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
        raise NotImplementedError

    @staticmethod
    def from_xy_yaw(x: float, y: float, yaw: float, z: float = 0.0) -> Pose:
        """Pose in the plane."""
        raise NotImplementedError

    @property
    def quaternion(self) -> np.ndarray:
        """(..., 4) x y z w, w not negative."""
        raise NotImplementedError

    @property
    def yaw(self) -> np.ndarray:
        """(...) rotation about z of the fixed-axes (roll, pitch, yaw) decomposition, radians."""
        raise NotImplementedError

    def __matmul__(self, other: Pose) -> Pose:
        """parent_from_child @ child_from_grandchild."""
        return Pose(self.rotation @ other.rotation, self.apply(other.translation))

    def inverse(self) -> Pose:
        """child_from_parent."""
        raise NotImplementedError

    def apply(self, points: np.ndarray) -> np.ndarray:
        """(..., 3) points of the child frame in the parent frame."""
        raise NotImplementedError


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
        raise NotImplementedError

    def inverse(self) -> UncertainPose:
        """child_from_parent."""
        raise NotImplementedError

    def point_jacobians(self, points: np.ndarray) -> np.ndarray:
        """(N, 3, 6) derivative of the transformed points with respect to the pose's error; points (N, 3) in the child."""
        raise NotImplementedError

    def transform(self, points: np.ndarray, covariances: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Points (N, 3) with covariances (N, 3, 3) of the child in the parent frame; Volkhardt eq. 1."""
        raise NotImplementedError


def interpolate(first: Pose, second: Pose, fractions: np.ndarray) -> Pose:
    """(F,) poses on the way from `first` (0) to `second` (1): straight in translation, constant turn in rotation."""
    raise NotImplementedError
