"""A ROS 1 bag, read without ROS; every message with the definition that its own connection carries."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Callable, Dict, Iterator, List, NamedTuple, Optional, Sequence, Tuple, Type, Union

from rosbags.rosbag1 import Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from people_fusion.core.errors import RecordingError
from people_fusion.core.stamps import from_seconds


@dataclass(frozen=True)
class Topic:
    """One topic of a recording.

    Attributes:
        name: as recorded.
        type: e.g. ``sensor_msgs/LaserScan``.
        count: number of messages.
    """

    name: str
    type: str
    count: int

    @property
    def kind(self) -> str:
        """Type without its package: `tf/tfMessage` and `tf2_msgs/TFMessage` differ in name only."""
        return self.type.split("/")[-1]


class RecordedMessage(NamedTuple):
    """A message as it lies in the bag; `read` turns it into an object with the fields of its type."""

    topic: str
    type: str
    arrival_ns: int
    read: Callable[[], Any]


class Recording:
    """A bag that is open for reading; use as a context manager.

    Attributes:
        path: the bag.
        topics: all topics, sorted by name; a topic that was recorded with two types stands there twice.
        start_ns, end_ns: arrival of the first message and just after the last.

    Raises:
        RecordingError: the file is missing, no bag or damaged; the message names it.
    """

    def __init__(self, path: Union[str, Path]) -> None:
        self.path = Path(path)
        self._decoders: Dict[str, Callable[[bytes], Any]] = {}
        if not self.path.is_file():
            raise RecordingError(f"{path}: no such file")
        try:
            self._reader = Reader(self.path)
            self._reader.open()
        except Exception as error:  # rosbags raises whatever a damaged byte leads to
            raise self._damaged(error) from error
        counts: Dict[Tuple[str, str], int] = {}
        for connection in self._reader.connections:
            counts[_key(connection)] = counts.get(_key(connection), 0) + connection.msgcount
        self.topics = tuple(Topic(name, kind, count) for (name, kind), count in sorted(counts.items()))
        self.start_ns: int = self._reader.start_time
        self.end_ns: int = self._reader.end_time
        if not self.topics or self.end_ns <= self.start_ns:
            self.close()
            raise RecordingError(f"{path}: no messages in this bag")

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: Optional[Type[BaseException]], value: Optional[BaseException], trace: Optional[TracebackType]
    ) -> None:
        self.close()

    def close(self) -> None:
        """Let go of the file."""
        self._reader.close()

    def topic(self, name: str) -> Topic:
        """The topic of this name, with or without the leading slash.

        Raises:
            RecordingError: if it was not recorded; the message lists what was.
        """
        for topic in self.topics:
            if topic.name.strip("/") == name.strip("/"):
                return topic
        there = ", ".join(f"{topic.name} ({topic.type})" for topic in self.topics)
        raise RecordingError(f"{self.path}: no topic {name}; there are {there}")

    def of_kind(self, *kinds: str) -> List[Topic]:
        """Topics with messages whose type, without its package, is one of `kinds`."""
        return [topic for topic in self.topics if topic.kind in kinds and topic.count]

    def messages(
        self, topics: Sequence[Topic], start_s: float = 0.0, duration_s: Optional[float] = None
    ) -> Iterator[RecordedMessage]:
        """Messages of some topics in order of arrival, from `start_s` after the recording's start for `duration_s`.

        Of messages that arrived at once those of the topic that is named first come first.

        Raises:
            RecordingError: the bag is damaged.
        """
        places = {(topic.name, topic.type): place for place, topic in enumerate(topics)}
        connections = [c for c in self._reader.connections if _key(c) in places]
        connections.sort(key=lambda connection: places[_key(connection)])
        if not connections:
            return
        decoders = {connection.id: self._decoder(connection) for connection in connections}
        names = {connection.id: _ros1_name(connection.msgtype) for connection in connections}
        begin = self.start_ns + from_seconds(start_s)
        end = None if duration_s is None else begin + from_seconds(duration_s)
        raw_messages = self._reader.messages(connections, start=begin, stop=end)
        while True:
            try:
                connection, arrival_ns, data = next(raw_messages)
            except StopIteration:
                return
            except Exception as error:
                raise self._damaged(error) from error
            decode = decoders[connection.id]
            yield RecordedMessage(connection.topic, names[connection.id], arrival_ns, _bound(decode, data))

    def _definitions(self, connection: Any) -> Dict[str, Any]:
        text = getattr(connection.msgdef, "data", connection.msgdef)  # rosbags before 0.10 gives the text itself
        try:
            return dict(get_types_from_msg(text, connection.msgtype))
        except Exception as error:
            raise RecordingError(
                f"{self.path}: the definition of {connection.msgtype} on {connection.topic} cannot be read: "
                f"{_one_line(error)}"
            ) from error

    def _decoder(self, connection: Any) -> Callable[[bytes], Any]:
        if connection.digest not in self._decoders:
            store = get_typestore(Stores.EMPTY)
            store.register(self._definitions(connection))
            kind = connection.msgtype

            def decode(data: bytes) -> Any:
                try:
                    return store.deserialize_ros1(data, kind)
                except Exception as error:
                    raise RecordingError(
                        f"{self.path}: a message on {connection.topic} cannot be read: {_one_line(error)}"
                    ) from error

            self._decoders[connection.digest] = decode
        return self._decoders[connection.digest]

    def _damaged(self, error: Exception) -> RecordingError:
        return RecordingError(f"{self.path}: not a readable ROS 1 bag (truncated or damaged): {_one_line(error)}")


def _key(connection: Any) -> Tuple[str, str]:
    return connection.topic, _ros1_name(connection.msgtype)


def _bound(decode: Callable[[bytes], Any], data: bytes) -> Callable[[], Any]:
    return lambda: decode(data)


def _ros1_name(rosbags_name: str) -> str:
    return rosbags_name.replace("/msg/", "/")


def _one_line(error: BaseException) -> str:
    return f"{type(error).__name__}: {' '.join(str(error).split())}"[:200]
