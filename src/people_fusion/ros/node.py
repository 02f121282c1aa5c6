"""What every node of this package has: parameters, transforms, time that may jump, diagnostics, one timer, one lock."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Mapping
from typing import Any, Callable, List, Optional, Sequence, Tuple, Type, TypeVar

import rospy
from rosgraph_msgs.msg import Clock
from tf2_msgs.msg import TFMessage

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.core.stamps import to_seconds
from people_fusion.ros import topics
from people_fusion.ros.conversions import stamp_from_msg
from people_fusion.ros.diagnostics import PERIOD_S, Diagnostics
from people_fusion.ros.timeline import Timeline
from people_fusion.ros.transforms import Tf2Source, stamp_of_transform
from people_fusion.tracking.fusion import FusionConfig

S = TypeVar("S")

TF_QUEUE = 100
CLOCK = "clock"


class Part:
    """A cue or a tracker within a node; called with the node's lock held."""

    def serve(self) -> None:
        """Go on with what waited; called when a transform came and once a second."""

    def tick(self) -> None:
        """Time has passed; called, without the lock, when simulated time goes on and once a second."""

    def reset(self) -> None:
        """Time has jumped: forget everything."""


class Node:
    """The node that this process is.

    rospy calls back from one thread per connection; a lock lets one callback at a time touch the parts.

    Args:
        config: the preset.
        inputs: topics that should not be silent.
    """

    def __init__(self, config: FusionConfig, inputs: Sequence[str]) -> None:
        self.source = Tf2Source(config.transforms.history_s)
        self.diagnostics = Diagnostics(inputs, self.source.missing)
        self.timeline = Timeline(self._jumped)
        self.parts: List[Part] = []
        self._lock = threading.RLock()
        self._simulated = not rospy.rostime.is_wallclock()

    def start(self) -> None:
        """Listen to transforms and start the timer; the parts are there."""
        self.subscribe(topics.TF, TFMessage, self._on_transforms, TF_QUEUE)
        self.subscribe(topics.TF_STATIC, TFMessage, self._on_static_transforms, TF_QUEUE)
        if self._simulated:
            # Only wakes who waits for a time; rospy itself has taken the clock before.
            rospy.Subscriber(topics.CLOCK, Clock, self._on_clock, queue_size=1)
        # Not shut down by hand: it ends with the node.
        rospy.Timer(rospy.Duration.from_sec(PERIOD_S), self._on_timer, reset=True)

    @staticmethod
    def now_ns() -> int:
        """The clock of this graph, nanoseconds."""
        return stamp_from_msg(rospy.Time.now())

    def wall_seconds_until(self, stamp_ns: Optional[int]) -> Optional[float]:
        """How long to wait by the wall for a time of this graph; None: until somebody tells, as `tick` does."""
        if stamp_ns is None or self._simulated:
            return None
        return max(0.0, to_seconds(stamp_ns - self.now_ns()))

    def subscribe(
        self, topic: str, message_type: Any, callback: Callable[[Any], None], queue_size: int, buff_size: int = 65536
    ) -> None:
        """Call back with the lock held; a DataError is counted."""

        def guarded(message: Any) -> None:
            with self._lock:
                self._watch_clock()
                try:
                    callback(message)
                except DataError as error:
                    self.diagnostics.bad(error.reason, f"{topic}: {error}")

        rospy.Subscriber(topic, message_type, guarded, queue_size=queue_size, buff_size=buff_size, tcp_nodelay=True)

    def _on_transforms(self, message: Any, static: bool = False) -> None:
        for transform in message.transforms:
            if static or self.timeline.admit("tf " + transform.child_frame_id, stamp_of_transform(transform), False):
                try:
                    self.source.add(transform, static)
                except DataError as error:
                    self.diagnostics.bad(error.reason, str(error))
        self._serve()

    def _on_static_transforms(self, message: Any) -> None:
        self._on_transforms(message, static=True)

    def _on_timer(self, _event: Any) -> None:
        with self._lock:
            self._watch_clock()
            self._serve()
            self._on_clock(None)
            self.diagnostics.publish()

    def _on_clock(self, _message: Any) -> None:
        for part in self.parts:
            part.tick()

    def _serve(self) -> None:
        for part in self.parts:
            part.serve()

    def _watch_clock(self) -> None:
        if self._simulated:
            self.timeline.admit(CLOCK, self.now_ns())

    def _jumped(self, seconds: float) -> None:
        self.source.clear()
        for part in self.parts:
            part.reset()
        self.diagnostics.jumped(seconds)


def run(name: str, settings_type: Type[S], build: Callable[[S, FusionConfig], Node]) -> int:
    """Be a node until it is shut down; returns the exit status.

    Args:
        name: of the node, unless remapped.
        settings_type: frozen dataclass of the node's own private parameters; all others are the preset.
        build: makes the node from its settings and the preset.
    """
    rospy.init_node(name)
    try:
        settings, config = read_parameters(settings_type, rospy.get_param("~", {}), rospy.get_name())
        node = build(settings, config)
    except ConfigError as error:
        rospy.logfatal("%s", error)
        return 1
    node.start()
    rospy.spin()
    return 0


def read_parameters(settings_type: Type[S], parameters: Any, path: str) -> Tuple[S, FusionConfig]:
    """A node's own settings and the preset, from its private parameters.

    Raises:
        ConfigError: names the full path of the parameter that is refused.
    """
    if not isinstance(parameters, Mapping):
        raise ConfigError(f"{path}: expected a mapping, got {parameters!r}")
    own = {field.name for field in dataclasses.fields(settings_type)}  # type: ignore[arg-type]
    settings = parse(settings_type, {key: value for key, value in parameters.items() if key in own}, path)
    config = parse(FusionConfig, {key: value for key, value in parameters.items() if key not in own}, path)
    return settings, config
