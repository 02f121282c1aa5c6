"""What a cue hands to a tracker: position estimates of people with honest covariance."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import NamedTuple, Optional, Tuple

import numpy as np

from people_fusion.core.angles import bearings
from people_fusion.core.head_scores import HeadScores

XY_OBSERVED = (True, True, False)
XYZ_OBSERVED = (True, True, True)
PERSON_DEPTH_M = 0.4  # a beam that ends less than this before a person's middle may have hit the person


@dataclass(frozen=True, eq=False)
class Sight:
    """How far a sensor could see in each direction, so that a tracker knows what a missing detection means.

    A planar sensor's directions are about its z axis, from x. Those of a camera with optical axes are about the
    vertical, from where it looks, positive to the left; its position is the origin, its yaw 0.

    Attributes:
        position: (2,) sensor in the measurement's frame, metres.
        yaw: direction of the sensor's x axis in that frame, radians.
        angle_min, angle_increment: directions of `ranges` in the sensor, radians.
        ranges: (B,) metres that were seen through before something was hit; NaN where the beam gave no information.
            Where the cue would not have told a person from what was hit, metres up to which it would have, less
            PERSON_DEPTH_M.
        range_max: beyond this nothing is seen, metres.
    """

    position: np.ndarray
    yaw: float
    angle_min: float
    angle_increment: float
    ranges: np.ndarray
    range_max: float

    def visible(self, points: np.ndarray, half_width_m: float, depth_m: float = PERSON_DEPTH_M) -> np.ndarray:
        """(T,) share in [0, 1] of each person that the sensor saw or looked through.

        A direction without information counts as not seen: absence of evidence is none of absence.

        Args:
            points: (T, 2) where people are believed to be, in the measurement's frame.
            half_width_m: half the width of what the sensor would see of a person.
            depth_m: a beam that ends less than this before a person's middle has hit the person.
        """
        if len(points) == 0 or len(self.ranges) == 0:
            return np.zeros(len(points))
        to_point = points - self.position
        distance = np.hypot(to_point[:, 0], to_point[:, 1])
        bearing = bearings(to_point) - self.yaw
        half_angle = np.arctan2(half_width_m, np.maximum(distance, half_width_m))
        angles = bearing[:, None] + half_angle[:, None] * _ACROSS - self.angle_min
        # Count beams, each half an increment to both sides, from the first one in the scan's own direction of turning.
        turn = 2.0 * np.pi * np.sign(self.angle_increment) / self.angle_increment
        beams = np.floor((angles / self.angle_increment + 0.5) % turn).astype(int)
        inside = beams < len(self.ranges)
        reach = self.ranges[np.where(inside, beams, 0)]
        with np.errstate(invalid="ignore"):
            seen = inside & (reach >= distance[:, None] - depth_m)
        return np.where(distance <= self.range_max, seen.mean(axis=1), 0.0)


_ACROSS = np.linspace(-1.0, 1.0, 7)


class Bodies(NamedTuple):
    """What a sensor that sees whole people tells of N of them beside their place.

    Attributes:
        heights: (N,) of the tops of their heads over the floor, metres.
        height_stds: (N,) metres.
        sitting: (N,) probability that they sit and do not stand.
    """

    heights: np.ndarray
    height_stds: np.ndarray
    sitting: np.ndarray

    def select(self, rows: np.ndarray) -> Bodies:
        """Some of them, by mask or index."""
        return Bodies(*(each[rows] for each in self))


Order = Tuple[int, str, int]  # stamp, cue, sequence: total over all measurements of all cues, independent of arrival


class Announcement(NamedTuple):
    """Told to the tracker the moment a sensor message arrives: a measurement of it is under way.

    Attributes:
        stamp_ns: acquisition time of the sensor message.
        cue: unique name of the cue.
        sequence: that the measurement will have.
        withdrawn: no measurement comes after all; the message was skipped.
    """

    stamp_ns: int
    cue: str
    sequence: int
    withdrawn: bool = False

    @property
    def order(self) -> Order:
        """Place of the announced measurement among all."""
        return (self.stamp_ns, self.cue, self.sequence)


@dataclass(frozen=True, eq=False)
class Measurement:
    """All detections that one cue made in one sensor message. N may be 0: to have seen nobody is information.

    Attributes:
        stamp_ns: acquisition time of the sensor message.
        cue: unique name of the cue, e.g. ``"scan_front"``; reliability and rate are kept by cue.
        modality: kind of the cue, e.g. ``"legs"``.
        frame_id: frame of everything below; a cue gives its sensor's frame, a tracker gets its tracking frame.
        positions: (N, 3) metres. An axis that is not observed holds a nominal value.
        covariances: (N, 3, 3) m^2, errors that are fresh in each measurement. Zero on axes that are not observed.
        confidences: (N,) in [0, 1], probability that the detection is a person as far as the cue can tell.
        observed: which axes of positions the sensor observes.
        period_s: time between this cue's measurements, seconds.
        sequence: number that the cue gave the sensor message when it announced it; orders equal stamps.
        shared_jacobians: (N, 3, 6) of the position with respect to the pose error that all detections share (its axes:
            x y z rotX rotY rotZ, see core.poses), or None where there is none.
        shared_covariance: (6, 6) of that slowly varying pose error, or None.
        sight: what the sensor could see, or None where the cue cannot tell.
        points: (P, 2) sensor points that the detections are made of, for rviz and for weighing particles.
        point_labels: (P,) index of the leg that a point belongs to.
        legs: (L, 2) centres of the legs.
        leg_owners: (L,) index of the detection that a leg belongs to.
        scores: of an image that the detections were found in, or None where nobody asked for them.
        bodies: of the people, or None of a cue that does not see them.
    """

    stamp_ns: int
    cue: str
    modality: str
    frame_id: str
    positions: np.ndarray
    covariances: np.ndarray
    confidences: np.ndarray
    observed: Tuple[bool, bool, bool] = XYZ_OBSERVED
    period_s: float = 0.1
    sequence: int = 0
    shared_jacobians: Optional[np.ndarray] = None
    shared_covariance: Optional[np.ndarray] = None
    sight: Optional[Sight] = None
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    point_labels: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    legs: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))
    leg_owners: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=int))
    scores: Optional[HeadScores] = None
    bodies: Optional[Bodies] = None

    def __len__(self) -> int:
        return len(self.positions)

    def select(self, rows: np.ndarray) -> Measurement:
        """The given detections, by mask or index, without the points and legs that they are made of."""
        return dataclasses.replace(
            self,
            positions=self.positions[rows],
            covariances=self.covariances[rows],
            confidences=self.confidences[rows],
            shared_jacobians=None if self.shared_jacobians is None else self.shared_jacobians[rows],
            points=np.zeros((0, 2)),
            point_labels=np.zeros(0, dtype=int),
            legs=np.zeros((0, 2)),
            leg_owners=np.zeros(0, dtype=int),
            scores=None if self.scores is None else self.scores.select(rows),
            bodies=None if self.bodies is None else self.bodies.select(rows),
        )

    @property
    def order(self) -> Order:
        """Sort key."""
        return (self.stamp_ns, self.cue, self.sequence)
