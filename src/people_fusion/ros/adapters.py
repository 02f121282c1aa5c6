"""Tracks in the messages of other packages, where those are installed: plain copies."""

from __future__ import annotations

import importlib
from typing import Any, Callable, NamedTuple, Optional

from people_fusion.core.tracks import Tracks
from people_fusion.ros.conversions import header_to_msg, tracks_to_msg


class Adapter(NamedTuple):
    """A message type and how tracks get into it."""

    message_type: Any
    convert: Callable[[Tracks], Any]


def people_adapter() -> Optional[Adapter]:
    """people_msgs/People, or None where that package is not installed."""
    messages = _messages("people_msgs")
    return None if messages is None else Adapter(messages.People, lambda tracks: people_to_msg(tracks, messages))


def spencer_adapter() -> Optional[Adapter]:
    """spencer_tracking_msgs/TrackedPersons, or None where that package is not installed."""
    messages = _messages("spencer_tracking_msgs")
    if messages is None:
        return None
    return Adapter(messages.TrackedPersons, lambda tracks: spencer_to_msg(tracks, messages))


def people_to_msg(tracks: Tracks, messages: Any) -> Any:
    """people_msgs/People; `messages` is that package's module of messages."""
    message = messages.People(header=header_to_msg(tracks.stamp_ns, tracks.frame_id))
    for person in tracks_to_msg(tracks).tracks:
        one = messages.Person(name=str(person.track_id), reliability=person.existence)
        one.position, one.velocity = person.pose.pose.position, _point(one.velocity, person.twist.twist.linear)
        message.people.append(one)
    return message


def spencer_to_msg(tracks: Tracks, messages: Any) -> Any:
    """spencer_tracking_msgs/TrackedPersons; `messages` is that package's module of messages."""
    message = messages.TrackedPersons(header=header_to_msg(tracks.stamp_ns, tracks.frame_id))
    for person in tracks_to_msg(tracks).tracks:
        one = messages.TrackedPerson()
        for name in ("track_id", "is_occluded", "is_matched", "detection_id", "age", "pose", "twist"):
            setattr(one, name, getattr(person, name))
        message.tracks.append(one)
    return message


def _messages(package: str) -> Any:
    try:
        return importlib.import_module(f"{package}.msg")
    except ImportError:
        return None


def _point(point: Any, vector: Any) -> Any:
    point.x, point.y, point.z = vector.x, vector.y, vector.z
    return point
