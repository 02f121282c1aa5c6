"""Detections and tracks as the messages that the live nodes publish, written to a bag and read from one."""

from __future__ import annotations

import math
from pathlib import Path
from types import TracebackType
from typing import Any, Callable, Dict, List, Optional, Sequence, Type, Union

import numpy as np
from rosbags.rosbag1 import Writer

from people_fusion.core.errors import RecordingError
from people_fusion.core.measurements import Measurement
from people_fusion.core.stamps import NANOSECONDS, from_seconds, split, to_seconds
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import normalise_frame
from people_fusion.core.wire import DETECTIONS_PER_MESSAGE, UNOBSERVED_VARIANCE, bodies_on_wire, headings
from people_fusion.replay.conversions import stamp
from people_fusion.replay.recording import Recording, Topic
from people_fusion.replay.typestore import typestore

TRACKS_TOPIC = "/people_fusion/tracks"
DETECTIONS_TOPIC = "/people_fusion/detections"
ANNOUNCEMENTS_TOPIC = "/people_fusion/announcements"
PREDICTION_LIMIT_NS = NANOSECONDS  # older tracks say nothing about an instant

_TRACKS = "people_fusion/msg/TrackedPersons"
_DETECTIONS = "people_fusion/msg/DetectedPersons"


class TrackWriter:
    """Writes a bag of detections and tracks; use as a context manager. Same input, same bytes.

    The bag gets its name when it is whole; one that was there is replaced then, so that a failure loses nothing.

    Raises:
        RecordingError: the bag cannot be written; the message names it.
    """

    def __init__(self, path: Union[str, Path]) -> None:
        self.path = Path(path)
        self._unfinished = self.path.with_name(self.path.name + ".unfinished")
        self._store = typestore()
        self._counts: Dict[str, int] = {}
        try:
            if self._unfinished.exists():
                self._unfinished.unlink()
            self._writer = Writer(self._unfinished)
            self._writer.open()
        except OSError as error:
            raise RecordingError(f"{path}: {error.strerror}") from error
        self._connections = {
            topic: self._writer.add_connection(topic, kind, typestore=self._store, callerid="/replay_bag")
            for topic, kind in ((DETECTIONS_TOPIC, _DETECTIONS), (TRACKS_TOPIC, _TRACKS))
        }

    def __enter__(self) -> TrackWriter:
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], value: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        try:
            self._writer.close()
            if kind is None:
                self._unfinished.replace(self.path)
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror}") from error
        finally:
            if self._unfinished.exists():
                self._unfinished.unlink()

    def write_tracks(self, tracks: Tracks, arrival_ns: int) -> None:
        """The confirmed tracks."""
        shown = tracks.select(tracks.confirmed)
        yaws, yaw_variances = headings(shown.means, shown.covariances)
        people = [self._tracked(shown, row, yaws[row], yaw_variances[row]) for row in range(len(shown))]
        self._write(TRACKS_TOPIC, _TRACKS, arrival_ns, tracks.stamp_ns, tracks.frame_id, tracks=people)

    def write_measurement(self, measurement: Measurement, arrival_ns: int) -> None:
        """A cue's detections, in its sensor's frame."""
        fields = detection_fields(measurement, self._make)
        self._write(DETECTIONS_TOPIC, _DETECTIONS, arrival_ns, measurement.stamp_ns, measurement.frame_id, **fields)

    def _write(self, topic: str, kind: str, arrival_ns: int, stamp_ns: int, frame_id: str, **fields: Any) -> None:
        sequence = self._counts.get(topic, 0)
        self._counts[topic] = sequence + 1
        time = self._make("builtin_interfaces/msg/Time", *split(stamp_ns))
        header = self._make("std_msgs/msg/Header", sequence, time, frame_id)
        message = self._store.types[kind](header=header, **fields)
        try:
            self._writer.write(self._connections[topic], arrival_ns, self._store.serialize_ros1(message, kind))
        except OSError as error:
            raise RecordingError(f"{self.path}: {error.strerror}") from error

    def _make(self, kind: str, *fields: Any) -> Any:
        return self._store.types[kind](*fields)

    def _tracked(self, tracks: Tracks, row: int, yaw: float, yaw_variance: float) -> Any:
        pose_covariance, twist_covariance = np.zeros((6, 6)), np.zeros((6, 6))
        pose_covariance[:3, :3] = tracks.covariances[row, :3, :3]
        pose_covariance[[3, 4, 5], [3, 4, 5]] = UNOBSERVED_VARIANCE, UNOBSERVED_VARIANCE, yaw_variance
        twist_covariance[[2, 3, 4, 5], [2, 3, 4, 5]] = UNOBSERVED_VARIANCE
        size = tracks.means.shape[1] - 3
        twist_covariance[:size, :size] = tracks.covariances[row, 3:, 3:]
        velocity = [*tracks.means[row, 3:].tolist(), 0.0][:3]
        linear = self._make("geometry_msgs/msg/Vector3", *velocity)
        angular = self._make("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
        twist = self._make("geometry_msgs/msg/Twist", linear, angular)
        return self._make(
            "people_fusion/msg/TrackedPerson",
            int(tracks.ids[row]),
            bool(tracks.occluded[row]),
            bool(tracks.matched[row]),
            0,
            self._make("builtin_interfaces/msg/Duration", *split(from_seconds(float(tracks.ages_s[row])))),
            float(tracks.existence[row]),
            _pose(tracks.means[row, :3], yaw, pose_covariance, self._make),
            self._make("geometry_msgs/msg/TwistWithCovariance", twist, twist_covariance.ravel()),
        )


def detection_fields(measurement: Measurement, make: Callable[..., Any]) -> Dict[str, Any]:
    """Fields of people_fusion/DetectedPersons but its header; `make` builds a message of its type and its fields."""
    sight = measurement.sight
    bodies = bodies_on_wire(measurement).tolist()
    return {
        "cue": measurement.cue,
        "modality": measurement.modality,
        "sequence": measurement.sequence,
        "period": float(measurement.period_s),
        "detections": [_detected(measurement, row, body, make) for row, body in enumerate(bodies)],
        "sight_angle_min": 0.0 if sight is None else float(sight.angle_min),
        "sight_angle_increment": 0.0 if sight is None else float(sight.angle_increment),
        "sight_range_max": 0.0 if sight is None else float(sight.range_max),
        "sight_ranges": np.zeros(0, np.float32) if sight is None else sight.ranges.astype(np.float32),
        "legs": [make("geometry_msgs/msg/Point32", *leg, 0.0) for leg in measurement.legs.tolist()],
        "leg_owners": measurement.leg_owners.astype(np.uint32),
        "scored": False,  # recordings hold no HeadScores
    }


def _detected(measurement: Measurement, row: int, body: Sequence[float], make: Callable[..., Any]) -> Any:
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = measurement.covariances[row]
    unobserved = [*np.flatnonzero(~np.array(measurement.observed)), 3, 4, 5]
    covariance[unobserved, unobserved] = UNOBSERVED_VARIANCE
    return make(
        "people_fusion/msg/DetectedPerson",
        measurement.sequence * DETECTIONS_PER_MESSAGE + row,
        float(measurement.confidences[row]),
        _pose(measurement.positions[row], 0.0, covariance, make),
        measurement.modality,
        *body,
    )


def _pose(position: np.ndarray, yaw: float, covariance: np.ndarray, make: Callable[..., Any]) -> Any:
    point = make("geometry_msgs/msg/Point", *position.tolist())
    turn = make("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
    pose = make("geometry_msgs/msg/Pose", point, turn)
    return make("geometry_msgs/msg/PoseWithCovariance", pose, covariance.ravel())


def read_tracks(recording: Recording, topic: Topic) -> List[Tracks]:
    """Recorded tracks in order of arrival; all of them are confirmed, and D is 5.

    Raises:
        RecordingError: the topic holds no TrackedPersons of this package.
    """
    if topic.type != _TRACKS.replace("/msg/", "/"):
        raise RecordingError(f"{recording.path}: {topic.name} is not people_fusion/TrackedPersons but {topic.type}")
    return [_tracks(recorded.read()) for recorded in recording.messages([topic])]


def _tracks(message: Any) -> Tracks:
    people = message.tracks
    covariances = np.zeros((len(people), 5, 5))
    means = np.zeros((len(people), 5))
    for row, person in enumerate(people):
        position, velocity = person.pose.pose.position, person.twist.twist.linear
        means[row] = position.x, position.y, position.z, velocity.x, velocity.y
        covariances[row, :3, :3] = person.pose.covariance.reshape(6, 6)[:3, :3]
        covariances[row, 3:, 3:] = person.twist.covariance.reshape(6, 6)[:2, :2]
    return Tracks(
        stamp_ns=stamp(message.header),
        frame_id=normalise_frame(message.header.frame_id),
        ids=np.array([person.track_id for person in people], dtype=np.int64),
        means=means,
        covariances=covariances,
        existence=np.array([person.existence for person in people], dtype=float),
        confirmed=np.ones(len(people), dtype=bool),
        matched=np.array([person.is_matched for person in people], dtype=bool),
        occluded=np.array([person.is_occluded for person in people], dtype=bool),
        ages_s=np.array([person.age.sec + person.age.nanosec / NANOSECONDS for person in people], dtype=float),
    )


def predicted(tracks: Tracks, stamp_ns: int) -> Tracks:
    """Recorded tracks at a later stamp, each moved on by its own velocity."""
    step_s = to_seconds(stamp_ns - tracks.stamp_ns)
    transition = np.eye(5)
    transition[0, 3] = transition[1, 4] = step_s
    return Tracks(
        stamp_ns,
        tracks.frame_id,
        tracks.ids,
        tracks.means @ transition.T,
        transition @ tracks.covariances @ transition.T,
        tracks.existence,
        tracks.confirmed,
        tracks.matched,
        tracks.occluded,
        tracks.ages_s,
    )
