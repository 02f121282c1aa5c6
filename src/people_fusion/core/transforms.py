"""Transforms between frames at a stamp, with the covariance of every uncertain link on the way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict, Tuple

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.localisation import DriftConfig, LocalisationHistory
from people_fusion.core.poses import Pose, UncertainPose, lever_jacobian, point_jacobians
from people_fusion.core.transform_tree import HISTORY_S, TransformSource, TransformTree, normalise_frame

__all__ = [
    "DriftConfig",
    "FramesConfig",
    "LinkUncertainty",
    "LocalisationHistory",
    "TransformSource",
    "TransformTree",
    "TransformsConfig",
    "UncertainTransform",
    "UncertainTransforms",
    "normalise_frame",
]

SENSOR, BODY, WORLD = range(3)


@dataclass(frozen=True)
class FramesConfig:
    """Names of the robot's frames (REP-105)."""

    world: str = parameter("map", "frame of the reported tracks; if it is never seen, `odom` is used and said so")
    odom: str = parameter("odom", "locally smooth frame; empty where the robot has none")
    base: str = parameter("base_link", "frame of the robot's body, whose pose the localisation estimates")


@dataclass(frozen=True)
class LinkUncertainty:
    """Uncertainty of where a sensor is on the robot; standard deviations in the parent's (base's) axes."""

    calibration_position_std: float = parameter(0.0, "of the mounting's position, slow, metres", low=0.0)
    calibration_rotation_std: float = parameter(0.0, "of the mounting's angles, slow, radians", low=0.0)
    jitter_position_std: float = parameter(0.0, "fresh at each look-up (joints, vibration), metres", low=0.0)
    jitter_rotation_std: float = parameter(0.0, "fresh at each look-up (joints, vibration), radians", low=0.0)

    @property
    def calibration_covariance(self) -> np.ndarray:
        """(6, 6), the same in all axes."""
        return np.diag([self.calibration_position_std**2] * 3 + [self.calibration_rotation_std**2] * 3)

    @property
    def jitter_covariance(self) -> np.ndarray:
        """(6, 6), the same in all axes."""
        return np.diag([self.jitter_position_std**2] * 3 + [self.jitter_rotation_std**2] * 3)


@dataclass(frozen=True)
class TransformsConfig:
    """Uncertainty of the transforms."""

    links: Dict[str, LinkUncertainty] = parameter({}, "by sensor frame: uncertainty of its place on the robot")
    default_link: LinkUncertainty = section(LinkUncertainty, "of sensor frames that `links` does not name")
    drift: DriftConfig = section(DriftConfig, "odometry drift since the last localisation fix")
    patience_s: float = parameter(0.3, "how long a sensor message waits for its transform, seconds", low=0.0, high=10.0)
    history_s: float = parameter(HISTORY_S, "how long transforms and fixes are remembered, seconds", low=1.0)


@dataclass(frozen=True, eq=False)
class UncertainTransform:
    """target_from_source at one stamp, its error kept in two parts.

    Attributes:
        pose: target_from_source.
        white_covariance: (6, 6) error of `pose` that is fresh at each look-up (joint jitter).
        shared_covariance: (6, 6) error of `pose` that persists between look-ups (localisation, calibration).
    """

    pose: Pose
    white_covariance: np.ndarray
    shared_covariance: np.ndarray

    def transform(self, points: np.ndarray, covariances: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (N, 3) and covariances (N, 3, 3) in the target frame, with the white part of the error included, and
        the Jacobians (N, 3, 6) of the points with respect to the shared error."""
        R, J_w = self.pose.rotation, point_jacobians(self.pose, points)
        C_y = R @ covariances @ R.T + J_w @ self.white_covariance @ np.swapaxes(J_w, -1, -2)  # Volkhardt eq. 1
        return self.pose.apply(points), C_y, J_w

    def inverse(self) -> UncertainTransform:
        """source_from_target."""
        white = UncertainPose(self.pose, self.white_covariance).inverse()
        shared = UncertainPose(self.pose, self.shared_covariance).inverse()
        return UncertainTransform(white.mean, white.covariance, shared.covariance)

    def __matmul__(self, other: UncertainTransform) -> UncertainTransform:
        """Composition of two transforms whose errors are independent."""
        white = UncertainPose(self.pose, self.white_covariance) @ UncertainPose(other.pose, other.white_covariance)
        shared = UncertainPose(self.pose, self.shared_covariance) @ UncertainPose(other.pose, other.shared_covariance)
        return UncertainTransform(white.mean, white.covariance, shared.covariance)


class UncertainTransforms:
    """Transforms with covariance. Not thread-safe; feed and ask from one thread.

    Means come from the source alone; this adds how far they are off. Localisation errs in where the robot is in the
    world, hence in the world against every other frame. A sensor's frame, that is any but world, odom and base, errs in
    where it sits on the robot.
    """

    def __init__(self, source: TransformSource, frames: FramesConfig, config: TransformsConfig) -> None:
        self.source, self.frames, self.config = source, frames, config
        self._links = {normalise_frame(frame): link for frame, link in config.links.items()}
        self._base = normalise_frame(frames.base)
        self._body = {normalise_frame(frames.odom), self._base}
        self._world = normalise_frame(frames.world)
        self._localisation = LocalisationHistory(
            source, normalise_frame(frames.odom), self._base, config.drift, config.history_s
        )

    @property
    def has_localisation(self) -> bool:
        """Whether there was a fix; without one, localisation counts as free of error."""
        return len(self._localisation) > 0

    def add_localisation(self, stamp_ns: int, world_from_base: UncertainPose) -> None:
        """A localisation fix (AMCL), in order of stamps or not.

        Raises:
            DataError: if the pose is not finite or the covariance is none.
        """
        self._localisation.add(stamp_ns, world_from_base)

    def localisation_covariance(self, stamp_ns: int) -> np.ndarray:
        """(6, 6) of world_from_base at the stamp, zero before there is any fix; see LocalisationHistory."""
        return self._localisation.covariance(stamp_ns)

    def reset(self) -> None:
        """Time has jumped: forget the fixes. The source is its owner's to reset."""
        self._localisation.reset()

    def lookup(self, target_frame: str, source_frame: str, stamp_ns: int) -> UncertainTransform:
        """target_from_source with the uncertainty of every link on the way.

        Raises:
            TransformUnavailable: as TransformSource.lookup.
        """
        target, source = normalise_frame(target_frame), normalise_frame(source_frame)
        target_rank, source_rank = self._rank(target), self._rank(source)
        if target_rank < source_rank:
            return self.lookup(source, target, stamp_ns).inverse()
        if target_rank == source_rank == SENSOR and target != source and not self._are_certain(target, source):
            base_from_target = self.lookup(self._base, target, stamp_ns)
            return base_from_target.inverse() @ self.lookup(self._base, source, stamp_ns)
        pose = self.source.lookup(target, source, stamp_ns)
        white, shared = np.zeros((6, 6)), np.zeros((6, 6))
        if target_rank > source_rank == SENSOR:  # the same in the base's and the target's axes
            link = self._link(source)
            white, shared = link.jitter_covariance, link.calibration_covariance
        if target_rank > source_rank and target_rank == WORLD and self.has_localisation:
            world_from_base = self.source.lookup(target, self._base, stamp_ns)
            J_w = lever_jacobian(pose.translation - world_from_base.translation)
            shared = shared + J_w @ self._localisation.covariance(stamp_ns) @ J_w.T
        return UncertainTransform(pose, white, shared)

    def _rank(self, frame: str) -> int:
        """How far a frame is from the sensors; without odometry or localisation the world counts as body."""
        if frame in self._body:
            return BODY
        return WORLD if frame == self._world else SENSOR

    def _link(self, sensor_frame: str) -> LinkUncertainty:
        return self._links.get(sensor_frame, self.config.default_link)

    def _are_certain(self, *sensor_frames: str) -> bool:
        return all(self._link(frame) == LinkUncertainty() for frame in sensor_frames)
