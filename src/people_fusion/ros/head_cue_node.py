"""People in images: every head cue of the preset on each camera, in a node of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Callable, Dict, List, Optional, Tuple

import rospy
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import CompressedImage, LaserScan
from sensor_msgs.msg import Image as ImageMsg

from people_fusion.core.camera_models import Panorama
from people_fusion.core.cameras import Camera
from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.core.head_scores import NO_SCORES
from people_fusion.core.image_topics import camera_info_of, is_rectified, without_transport
from people_fusion.core.images import Image
from people_fusion.core.measurements import Measurement
from people_fusion.core.scans import Scan
from people_fusion.cues.cue import Cue
from people_fusion.cues.heads.detectors.fhog_head import FhogHeadConfig
from people_fusion.cues.heads.drawing import annotated
from people_fusion.cues.heads.heads import HeadCue
from people_fusion.cues.heads.native import is_native
from people_fusion.msg import HeadScores, TrackedPersons
from people_fusion.ros import topics
from people_fusion.ros.camera_cues import UNCALIBRATED, CameraCues
from people_fusion.ros.conversions import frame_from_msg, scan_from_msg, tracks_from_msg
from people_fusion.ros.cues import Waiting
from people_fusion.ros.head_scores import scores_to_msg
from people_fusion.ros.images import image_from_msg, image_to_msg
from people_fusion.ros.leg_cue_node import SCAN_BUFFER, SCAN_QUEUE
from people_fusion.ros.node import Node, run
from people_fusion.tracking.fusion import FusionConfig
from people_fusion.tracking.tracker import TRACKERS

SCORE_QUEUE = 2  # they are large


@dataclass(frozen=True)
class HeadCueSettings:
    """The head cue node's own parameters."""

    images: Tuple[str, ...] = parameter(
        (topics.IMAGE,), "topics of the cameras; compressed where they end so, rectified where they are called so"
    )
    camera_infos: Tuple[str, ...] = parameter((), "their camera_info, in the same order; empty: beside the images")
    scans: Tuple[str, ...] = parameter((topics.SCAN,), "topics of the scanners, for head cues with `ranges/scans`")

    def __post_init__(self) -> None:
        if not self.images or len(set(self.images)) < len(self.images):
            raise ConfigError(f"images: expected topics that differ, got {list(self.images)}")
        if self.camera_infos and len(self.camera_infos) != len(self.images):
            raise ConfigError(f"camera_infos: expected {len(self.images)} topics, got {len(self.camera_infos)}")


class HeadCues(CameraCues):
    """The head cues of one process."""

    def __init__(self, node: Node, settings: HeadCueSettings, config: FusionConfig) -> None:
        super().__init__(node, config, "head cues")
        if not config.head_cues:
            raise ConfigError("head_cues: the preset names none")
        self._panoramas: Dict[str, Camera] = {frame: Panorama(each) for frame, each in config.panoramas.items()}
        for place, topic in enumerate(settings.images):
            base = without_transport(topic)
            info = settings.camera_infos[place] if settings.camera_infos else camera_info_of(topic)
            self._calibrate(topic, info, is_rectified(topic))
            self._look_at(topic, CompressedImage if topic != base else ImageMsg, base, config.head_cues)
        if any(getattr(cue, "full_every", 1) != 1 for cue in config.head_cues.values()):
            node.subscribe(topics.HYPOTHESES, TrackedPersons, self._on_tracks, 1)
        noting = [cue for cue in self.cues.values() if Scan in cue.notes]
        for topic in settings.scans if noting else ():
            node.subscribe(topic, numpy_msg(LaserScan), self._on_scan(topic, noting), SCAN_QUEUE, SCAN_BUFFER)
        node.diagnostics.add_facts(lambda: {"native kernel": is_native()})
        detectors = [getattr(each, "detector", None) for each in config.head_cues.values()]
        if not is_native() and any(isinstance(each, FhogHeadConfig) for each in detectors):
            rospy.logwarn("the native kernel is not built: fhog_head takes many times as long")
        self._wanted = TRACKERS.build(config.tracker).scores
        self._scores: Optional[rospy.Publisher] = None
        if self._wanted != NO_SCORES:
            kind = numpy_msg(HeadScores)
            self._scores = rospy.Publisher(topics.HEAD_SCORES, kind, queue_size=SCORE_QUEUE, tcp_nodelay=True)
        self.start()

    def _on_tracks(self, message: Any) -> None:
        tracks = tracks_from_msg(message)
        for cue in self.cues.values():
            cue.set_tracks(tracks)

    def _on_scan(self, topic: str, cues: List[Cue]) -> Callable[[Any], None]:
        def on_scan(message: Any) -> None:
            scan = scan_from_msg(message)
            self.node.timeline.require(f"scans of {topic}", scan.stamp_ns, witness=False)
            for cue in cues:
                cue.note(scan)

        return on_scan

    def read(self, topic: str, message: Any) -> Image:
        """See CameraCues."""
        frame_id = frame_from_msg(message.header.frame_id)
        camera = self._panoramas.get(frame_id) or self.cameras.get(topic)
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
        info = None if measurement.frame_id in self._panoramas else self.infos[topic]
        self._scores.publish(scores_to_msg(measurement, info, is_rectified(topic)))
        return True


def _build(settings: HeadCueSettings, config: FusionConfig) -> Node:
    node = Node(config, settings.images)
    HeadCues(node, settings, config)
    return node


def main() -> int:
    """Entry of scripts/head_cue; returns the exit status."""
    return run("head_cue", HeadCueSettings, _build)
