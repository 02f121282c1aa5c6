"""Transforms between frames at a stamp, with the covariance of every uncertain link on the way."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import Dict, Tuple

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.poses import Pose, UncertainPose


class TransformSource(abc.ABC):
    """Where poses between frames come from: tf2 when live (ros.transforms), a TransformTree from a bag when not."""

    @abc.abstractmethod
    def lookup(self, target_frame: str, source_frame: str, stamp_ns: int) -> Pose:
        """target_from_source at the stamp, finite.

        Raises:
            TransformUnavailable: with `may_arrive` true where the frame or the stamp is not known *yet*.
        """


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


@dataclass(frozen=True)
class DriftConfig:
    """Odometry drift since the last localisation fix, as variances that grow with the way (Thrun et al. 2005, 5.4)."""

    translation_per_metre: float = parameter(0.05, "std of translation after one metre, metres", low=0.0)
    translation_per_radian: float = parameter(0.01, "std of translation after turning one radian, metres", low=0.0)
    rotation_per_radian: float = parameter(0.05, "std of yaw after turning one radian, radians", low=0.0)
    rotation_per_metre: float = parameter(0.02, "std of yaw after one metre, radians", low=0.0)


@dataclass(frozen=True)
class TransformsConfig:
    """Uncertainty of the transforms."""

    links: Dict[str, LinkUncertainty] = parameter({}, "by sensor frame: uncertainty of its place on the robot")
    default_link: LinkUncertainty = section(LinkUncertainty, "of sensor frames that `links` does not name")
    drift: DriftConfig = section(DriftConfig, "odometry drift since the last localisation fix")
    patience_s: float = parameter(0.3, "how long a sensor message waits for its transform, seconds", low=0.0, high=10.0)
    history_s: float = parameter(15.0, "how long transforms and localisation fixes are remembered, seconds", low=1.0)


@dataclass(frozen=True, eq=False)
class UncertainTransform:
    """target_from_source at one stamp, its error kept in two parts.

    Attributes:
        pose: target_from_source.
        white_covariance: (6, 6) error of `pose` that is fresh at each look-up (joint jitter).
        shared_covariance: (6, 6) error of `pose` that persists from one look-up to the next (localisation, calibration).
    """

    pose: Pose
    white_covariance: np.ndarray
    shared_covariance: np.ndarray

    def transform(self, points: np.ndarray, covariances: np.ndarray) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (N, 3) and covariances (N, 3, 3) in the target frame, with the white part of the error included, and
        the Jacobians (N, 3, 6) of the points with respect to the shared error."""
        raise NotImplementedError


class TransformTree(TransformSource):
    """Frames as a tree with a history per link: tf2's buffer for a recording, without ROS."""


class UncertainTransforms:
    """Transforms with covariance. Not thread-safe; feed and ask from one thread."""

    def __init__(self, source: TransformSource, frames: FramesConfig, config: TransformsConfig) -> None:
        self.source, self.frames, self.config = source, frames, config

    def add_localisation(self, stamp_ns: int, world_from_base: UncertainPose) -> None:
        """A localisation fix (AMCL), in order of stamps or not."""
        raise NotImplementedError

    def lookup(self, target_frame: str, source_frame: str, stamp_ns: int) -> UncertainTransform:
        """target_from_source with the uncertainty of every link on the way.

        Raises:
            TransformUnavailable: as TransformSource.lookup.
        """
        raise NotImplementedError
