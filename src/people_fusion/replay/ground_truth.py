"""Annotated people of a recording, whatever message type they were stored in.

A message is understood by its fields: a list of persons, or one person alone, each with a position (`pose`,
`pose.pose`, `position` or `x`, `y` of its own) and an identity (`track_id`, `id`, ...). That covers TrackedPersons of
this package and of spencer_tracking_msgs, people_msgs/People, leg_tracker's Person and PersonArray, and
geometry_msgs/PoseArray, whose persons are told apart by their place in the list.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.errors import RecordingError
from people_fusion.core.transforms import TransformSource, normalise_frame
from people_fusion.core.wire import UNOBSERVED_VARIANCE
from people_fusion.replay.conversions import stamp
from people_fusion.replay.recording import Recording, Topic

UNKNOWN = (math.nan, math.nan, math.nan)
IDENTITIES = ("track_id", "person_id", "object_id", "id", "name")


@dataclass(frozen=True, eq=False)
class Instant:
    """The annotated people at one stamp.

    Attributes:
        stamp_ns: instant of the positions.
        frame_id: frame of the positions and velocities.
        ids: (n,) int64.
        positions: (n, 3) metres.
        velocities: (n, 3) metres a second, NaN where unknown.
    """

    stamp_ns: int
    frame_id: str
    ids: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray

    def into(self, frame_id: str, transforms: TransformSource) -> Instant:
        """The same people in another frame.

        Raises:
            TransformUnavailable: as TransformSource.lookup.
        """
        if frame_id == self.frame_id:
            return self
        pose = transforms.lookup(frame_id, self.frame_id, self.stamp_ns)
        return Instant(
            self.stamp_ns, frame_id, self.ids, pose.apply(self.positions), self.velocities @ pose.rotation.T
        )


class _Person(NamedTuple):
    identity: Any
    position: Tuple[float, float, float]
    velocity: Tuple[float, float, float]


def read_ground_truth(
    recording: Recording,
    topic: Topic,
    scans: Sequence[Topic],
    start_s: float = 0.0,
    duration_s: Optional[float] = None,
) -> List[Instant]:
    """All annotated instants in order of stamps.

    A message without stamp or frame belongs to the scan that arrived last before it, as an annotator saw it. Messages
    with one person each that share a stamp are one instant. Of two positions of one person at one instant the first
    counts; a position that is not finite is left out.

    Raises:
        RecordingError: the messages hold no people that can be understood.
    """
    people: Dict[int, Dict[int, _Person]] = {}
    frames: Dict[int, str] = {}
    numbers: Dict[Any, int] = {}
    scan_stamp_ns, scan_frame = 0, ""
    for recorded in recording.messages([*scans, topic], start_s, duration_s):
        message = recorded.read()
        if recorded.topic != topic.name:
            scan_stamp_ns, scan_frame = stamp(message.header), normalise_frame(message.header.frame_id)
            continue
        header = getattr(message, "header", None)
        stamp_ns = (stamp(header) if header is not None else 0) or scan_stamp_ns
        frame_id = (normalise_frame(header.frame_id) if header is not None else "") or scan_frame
        persons = _persons(message)
        if persons is None:
            raise RecordingError(f"{recording.path}: no people in the messages of {topic.name} ({topic.type})")
        if not stamp_ns or frames.setdefault(stamp_ns, frame_id) != frame_id or not frame_id:
            continue  # nobody tells when and where
        instant = people.setdefault(stamp_ns, {})
        for person in persons:
            if all(map(math.isfinite, person.position)):
                instant.setdefault(_number(person.identity, numbers), person)
    return [
        Instant(
            stamp_ns,
            frames[stamp_ns],
            np.array(list(instant), dtype=np.int64),
            np.array([person.position for person in instant.values()], dtype=float).reshape(-1, 3),
            np.array([person.velocity for person in instant.values()], dtype=float).reshape(-1, 3),
        )
        for stamp_ns, instant in sorted(people.items())
    ]


def _persons(message: Any) -> Optional[List[_Person]]:
    """People in a message; None if it has no place for any."""
    alone = _person(message, 0)
    if alone is not None and _identity(message) is not None:
        return [alone]
    lists = [value for value in vars(message).values() if isinstance(value, list)]
    for entries in lists:
        persons = [_person(entry, i) for i, entry in enumerate(entries)]
        if persons and all(person is not None for person in persons):
            return [person for person in persons if person is not None]
    return [] if lists and not any(lists) else None


def _person(entry: Any, index: int) -> Optional[_Person]:
    place = getattr(entry, "pose", entry)
    place = getattr(place, "pose", place)
    position = _vector(getattr(place, "position", place))
    if position is None:
        return None
    identity = _identity(entry)
    return _Person(index if identity is None else identity, position, _velocity(entry))


def _velocity(entry: Any) -> Tuple[float, float, float]:
    motion = getattr(entry, "twist", None)
    if getattr(motion, "covariance", [0.0])[0] >= UNOBSERVED_VARIANCE:
        return UNKNOWN
    linear = getattr(getattr(motion, "twist", motion), "linear", None)
    return _vector(linear if linear is not None else getattr(entry, "velocity", None)) or UNKNOWN


def _vector(value: Any) -> Optional[Tuple[float, float, float]]:
    try:
        return float(value.x), float(value.y), float(getattr(value, "z", 0.0))
    except (AttributeError, TypeError):
        return None


def _identity(entry: Any) -> Any:
    return next((getattr(entry, name) for name in IDENTITIES if hasattr(entry, name)), None)


def _number(identity: Any, numbers: Dict[Any, int]) -> int:
    """Identities are numbers as they are; names are counted from the first one seen."""
    if isinstance(identity, (int, np.integer)):
        return int(identity)
    return numbers.setdefault(identity, len(numbers))
