"""People in images: every head cue of the preset on each camera, in a node of its own."""

from __future__ import annotations

import threading
import traceback
from dataclasses import dataclass
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Tuple

import rospy
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import CameraInfo, CompressedImage
from sensor_msgs.msg import Image as ImageMsg

from people_fusion.core.camera_models import Panorama
from people_fusion.core.cameras import Camera
from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.core.head_scores import NO_SCORES
from people_fusion.core.image_topics import camera_info_of, is_rectified, without_transport
from people_fusion.core.images import Image
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.waiting import WaitingRoom
from people_fusion.cues.cue import CUES, Cue
from people_fusion.cues.heads.detectors.fhog_head import FhogHeadConfig
from people_fusion.cues.heads.drawing import annotated
from people_fusion.cues.heads.heads import HeadCue
from people_fusion.cues.heads.native import is_native
from people_fusion.msg import HeadScores, TrackedPersons
from people_fusion.ros import topics
from people_fusion.ros.conversions import frame_from_msg, stamp_from_msg, tracks_from_msg
from people_fusion.ros.cues import Cues, Waiting
from people_fusion.ros.head_scores import scores_to_msg
from people_fusion.ros.images import camera_from_msg, image_from_msg, image_to_msg
from people_fusion.ros.node import Node, run
from people_fusion.tracking.fusion import FusionConfig
from people_fusion.tracking.tracker import TRACKERS

SCORE_QUEUE = 2  # they are large
IMAGE_BUFFER = 1 << 25  # bytes; rospy lags where an image does not fit
BUSY = "images skipped: the cues are busy"
UNCALIBRATED = "image before its camera_info"


@dataclass(frozen=True)
class HeadCueSettings:
    """The head cue node's own parameters."""

    images: Tuple[str, ...] = parameter(
        (topics.IMAGE,), "topics of the cameras; compressed where they end so, rectified where image_rect is in them"
    )
    camera_infos: Tuple[str, ...] = parameter((), "their camera_info, in the same order; empty: beside the images")

    def __post_init__(self) -> None:
        if not self.images or len(set(self.images)) < len(self.images):
            raise ConfigError(f"images: expected topics that differ, got {list(self.images)}")
        if self.camera_infos and len(self.camera_infos) != len(self.images):
            raise ConfigError(f"camera_infos: expected {len(self.images)} topics, got {len(self.camera_infos)}")


class _Arrived(NamedTuple):
    """An image, as it came, and what the cues announced of it."""

    topic: str
    message: Any
    announcements: Dict[str, Announcement]


class HeadCues(Cues):
    """The head cues of one process.

    Callbacks announce an image and leave it in its camera's place, where the next one replaces it if it is not taken by
    then: no image is looked at that is not the newest. A thread of its own looks at them.
    """

    def __init__(self, node: Node, settings: HeadCueSettings, config: FusionConfig) -> None:
        super().__init__(node, config, use_tf=True)
        if not config.head_cues:
            raise ConfigError("head_cues: the preset names none")
        self.waiting = WaitingRoom(self._is_ready, config.transforms.patience_s, capacity=1, gave_up=self._withdraw)
        self._panoramas: Dict[str, Camera] = {frame: Panorama(each) for frame, each in config.panoramas.items()}
        self._cameras: Dict[str, Camera] = {}
        self._infos: Dict[str, Any] = {}
        self._topics: Dict[str, str] = {}  # of the cues' images
        self._by_topic: Dict[str, List[Cue]] = {}
        self._debug: Dict[str, rospy.Publisher] = {}
        self._arrived: Dict[str, _Arrived] = {}
        self._jumped = self._woken = False
        self._changed = threading.Condition()
        self._skipped = 0
        for place, topic in enumerate(settings.images):
            base = without_transport(topic)
            info = settings.camera_infos[place] if settings.camera_infos else camera_info_of(topic)
            self._by_topic[topic] = [self._cue(base, key, each, config) for key, each in config.head_cues.items()]
            self._topics.update({cue.name: topic for cue in self._by_topic[topic]})
            kind = CompressedImage if topic != base else ImageMsg
            node.subscribe(info, CameraInfo, self._on_camera(topic), 1)
            node.subscribe(topic, kind, self._on_image(topic), 1, IMAGE_BUFFER)
        if any(getattr(cue, "full_every", 1) != 1 for cue in config.head_cues.values()):
            node.subscribe(topics.HYPOTHESES, TrackedPersons, self._on_tracks, 1)
        node.diagnostics.add_losses(lambda: {BUSY: self._skipped})
        node.diagnostics.add_facts(lambda: {"native kernel": is_native()})
        detectors = [getattr(each, "detector", None) for each in config.head_cues.values()]
        if not is_native() and any(isinstance(each, FhogHeadConfig) for each in detectors):
            rospy.logwarn("the native kernel is not built: fhog_head takes many times as long")
        self._wanted = TRACKERS.build(config.tracker).scores
        self._scores: Optional[rospy.Publisher] = None
        if self._wanted != NO_SCORES:
            kind = numpy_msg(HeadScores)
            self._scores = rospy.Publisher(topics.HEAD_SCORES, kind, queue_size=SCORE_QUEUE, tcp_nodelay=True)
        threading.Thread(target=self._work, name="head cues", daemon=True).start()

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

    def _cue(self, topic: str, key: str, config: object, preset: FusionConfig) -> Cue:
        name = f"{rospy.resolve_name(topic).strip('/')}/{key}"
        self.cues[name] = cue = CUES.build(config, name=name, frames=preset.frames)
        self._debug[name] = rospy.Publisher(f"{topics.DEBUG}/{name}", ImageMsg, queue_size=1)
        return cue

    def _on_camera(self, topic: str) -> Callable[[Any], None]:
        def on_camera(message: Any) -> None:
            self._infos[topic] = message
            self._cameras[topic] = camera_from_msg(message, rectified=is_rectified(topic))

        return on_camera

    def _on_tracks(self, message: Any) -> None:
        tracks = tracks_from_msg(message)
        for cue in self.cues.values():
            cue.set_tracks(tracks)

    def _on_image(self, topic: str) -> Callable[[Any], None]:
        def on_image(message: Any) -> None:
            self.node.diagnostics.heard(topic)
            stamp_ns, frame_id = stamp_from_msg(message.header.stamp), message.header.frame_id
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
                rospy.logerr("the head cues failed: %s", traceback.format_exc())
                self.node.diagnostics.bad("the head cues failed")

    def _admit(self, arrived: _Arrived) -> None:
        try:
            image = self._image(arrived)
        except DataError as error:
            self.node.diagnostics.bad(error.reason, f"{arrived.topic}: {error}")
            self._give_up(arrived)
            return
        for name, announcement in arrived.announcements.items():
            cue = self.cues[name]
            waiting = Waiting(cue, announcement, image, cue.transforms_needed(image))
            self.waiting.push(cue.name, image.stamp_ns, waiting, self.node.now_ns())

    def _image(self, arrived: _Arrived) -> Image:
        message = arrived.message
        frame_id = frame_from_msg(message.header.frame_id)
        camera = self._panoramas.get(frame_id) or self._cameras.get(arrived.topic)
        if camera is None:
            raise DataError(UNCALIBRATED)
        return image_from_msg(message, camera)

    def measure(self, waiting: Waiting) -> None:
        """Measure and tell, and draw what was done where somebody looks."""
        cue = waiting.cue
        watched = self._scores is not None and self._scores.get_num_connections() > 0
        cue.set_scores(self._wanted if watched else NO_SCORES)
        super().measure(waiting)
        debug = self._debug[cue.name]
        if debug.get_num_connections() and isinstance(cue, HeadCue) and cue.look is not None:
            image = waiting.data
            debug.publish(image_to_msg(annotated(image.pixels, cue.look), image.stamp_ns, image.frame_id))

    def _publish_scores(self, measurement: Measurement) -> bool:
        if self._scores is None or measurement.scores is None:
            return False
        topic = self._topics[measurement.cue]
        info = None if measurement.frame_id in self._panoramas else self._infos[topic]
        self._scores.publish(scores_to_msg(measurement, info, is_rectified(topic)))
        return True

    def _give_up(self, arrived: _Arrived) -> None:
        for announcement in arrived.announcements.values():
            self._announce(announcement._replace(withdrawn=True), arrived.message.header.frame_id)


def _build(settings: HeadCueSettings, config: FusionConfig) -> Node:
    node = Node(config, settings.images)
    HeadCues(node, settings, config)
    return node


def main() -> int:
    """Entry of scripts/head_cue; returns the exit status."""
    return run("head_cue", HeadCueSettings, _build)
