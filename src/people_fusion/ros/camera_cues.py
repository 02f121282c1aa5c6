"""What nodes with cues of cameras share: of each camera the newest image alone is looked at, in a thread of its own."""

from __future__ import annotations

import threading
import traceback
from typing import Any, Callable, Dict, List, Mapping, NamedTuple

import rospy
from sensor_msgs.msg import CameraInfo
from sensor_msgs.msg import Image as ImageMsg

from people_fusion.core.cameras import Camera
from people_fusion.core.errors import DataError
from people_fusion.core.measurements import Announcement
from people_fusion.core.waiting import WaitingRoom
from people_fusion.cues.cue import CUES, Cue
from people_fusion.ros import topics
from people_fusion.ros.conversions import stamp_from_msg
from people_fusion.ros.cues import Cues, Waiting
from people_fusion.ros.images import camera_from_msg, same_camera
from people_fusion.ros.node import Node
from people_fusion.tracking.fusion import FusionConfig

IMAGE_BUFFER = 1 << 25  # bytes; rospy lags where an image does not fit
BUSY = "images skipped: the cues are busy"
UNCALIBRATED = "image before its camera_info"
UNSTAMPED = "image without a stamp or a frame"


class _Arrived(NamedTuple):
    """An image, as it came, and what the cues announced of it."""

    topic: str
    message: Any
    announcements: Dict[str, Announcement]


class CameraCues(Cues):
    """Cues that look at the images of cameras.

    Callbacks announce an image and leave it in its camera's place, where the next one replaces it if it is not taken by
    then: no image is looked at that is not the newest. A thread of its own looks at them.

    Attributes:
        infos: the newest sensor_msgs/CameraInfo of each camera, by the topic of its images.
        cameras: made of them.

    Args:
        kind: of the cues, for whoever reads the log.
    """

    def __init__(self, node: Node, config: FusionConfig, kind: str) -> None:
        super().__init__(node, config, use_tf=True)
        self.waiting = WaitingRoom(self._is_ready, config.transforms.patience_s, capacity=1, gave_up=self._withdraw)
        self.infos: Dict[str, Any] = {}
        self.cameras: Dict[str, Camera] = {}
        self._kind, self._config = kind, config
        self._by_topic: Dict[str, List[Cue]] = {}
        self._topics: Dict[str, str] = {}  # of the cues' images
        self._debug: Dict[str, rospy.Publisher] = {}
        self._arrived: Dict[str, _Arrived] = {}
        self._jumped = self._woken = False
        self._changed = threading.Condition()
        self._skipped = 0
        node.diagnostics.add_losses(lambda: {BUSY: self._skipped})

    def start(self) -> None:
        """Look at what comes; all cues are there."""
        threading.Thread(target=self._work, name=self._kind, daemon=True).start()

    def serve(self) -> None:
        """A transform came, or time has passed."""
        with self._changed:
            self._woken = True
            self._changed.notify()

    def reset(self) -> None:
        """Time has jumped."""
        with self._changed:
            self._jumped = True
            self._arrived.clear()

    def read(self, topic: str, message: Any) -> Any:
        """Core type of an image; called by the thread.

        Raises:
            DataError: it is unusable.
        """
        raise NotImplementedError

    def _look_at(self, topic: str, message_type: Any, base: str, configs: Mapping[str, object]) -> None:
        """Give the images of a topic to cues of their own, which are named after `base`."""
        self._by_topic[topic] = [self._cue(base, key, config) for key, config in configs.items()]
        self._topics.update({cue.name: topic for cue in self._by_topic[topic]})
        self.node.subscribe(topic, message_type, self._on_image(topic), 1, IMAGE_BUFFER)

    def _calibrate(self, topic: str, info_topic: str, rectified: bool) -> None:
        """Listen to the camera_info of a topic's images."""

        def on_camera(message: Any) -> None:
            if topic not in self.infos or not same_camera(message, self.infos[topic]):
                self.cameras[topic] = camera_from_msg(message, rectified)
            self.infos[topic] = message

        self.node.subscribe(info_topic, CameraInfo, on_camera, 1)

    def _cue(self, base: str, key: str, config: object) -> Cue:
        name = f"{rospy.resolve_name(base).strip('/')}/{key}"
        self.cues[name] = cue = CUES.build(config, name=name, frames=self._config.frames)
        self._debug[name] = rospy.Publisher(f"{topics.DEBUG}/{name}", ImageMsg, queue_size=1)
        return cue

    def _on_image(self, topic: str) -> Callable[[Any], None]:
        def on_image(message: Any) -> None:
            self.node.diagnostics.heard(topic)
            stamp_ns, frame_id = stamp_from_msg(message.header.stamp), message.header.frame_id
            if stamp_ns == 0 or not frame_id:
                raise DataError(UNSTAMPED)
            for cue in self._by_topic[topic]:
                self.node.timeline.require(cue.name, stamp_ns)
            with self._changed:
                stale = self._arrived.pop(topic, None)
            skipped = stale.announcements if stale is not None else {}
            cues = [cue for cue in self._by_topic[topic] if cue.wants(stamp_ns) or cue.name in skipped]
            announcements = {cue.name: cue.announce(stamp_ns) for cue in cues}
            for announcement in announcements.values():
                self._announce(announcement, frame_id)
            if cues:
                with self._changed:
                    self._arrived[topic] = _Arrived(topic, message, announcements)
                    self._changed.notify()
            if stale is not None:
                self._skipped += 1
                self._give_up(stale)

        return on_image

    def _work(self) -> None:
        while not rospy.is_shutdown():
            with self._changed:
                self._changed.wait_for(lambda: self._arrived or self._jumped or (self._woken and self.waiting), 1.0)
                arrived, self._arrived = list(self._arrived.values()), {}
                jumped, self._jumped, self._woken = self._jumped, False, False
            if jumped:
                super().reset()
            try:
                for each in arrived:
                    self._admit(each)
                super().serve()
            except Exception:  # as rospy does with its callbacks: the next message may be a better one
                rospy.logerr("the %s failed: %s", self._kind, traceback.format_exc())
                self.node.diagnostics.bad(f"the {self._kind} failed")

    def _admit(self, arrived: _Arrived) -> None:
        try:
            image = self.read(arrived.topic, arrived.message)
        except DataError as error:
            self.node.diagnostics.bad(error.reason, f"{arrived.topic}: {error}")
            self._give_up(arrived)
            return
        for name, announcement in arrived.announcements.items():
            cue = self.cues[name]
            waiting = Waiting(cue, announcement, image, cue.transforms_needed(image))
            self.waiting.push(cue.name, image.stamp_ns, waiting, self.node.now_ns())

    def _give_up(self, arrived: _Arrived) -> None:
        for announcement in arrived.announcements.values():
            self._announce(announcement._replace(withdrawn=True), arrived.message.header.frame_id)
