"""What every cue node does: announce, wait for transforms, measure, and tell the tracker."""

from __future__ import annotations

import dataclasses
from typing import Any, Callable, Dict, FrozenSet, NamedTuple, Optional, Tuple, Union

import rospy
from visualization_msgs.msg import MarkerArray

from people_fusion.core.errors import DataError, NotLooked, TransformUnavailable
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.waiting import WaitingRoom
from people_fusion.cues.cue import Cue, TransformRequest
from people_fusion.msg import DetectedPersons, MeasurementAnnouncement
from people_fusion.ros import topics
from people_fusion.ros.conversions import announcement_to_msg, measurement_to_msg
from people_fusion.ros.markers import detection_markers
from people_fusion.ros.node import Node, Part
from people_fusion.ros.transforms import request_is_met
from people_fusion.tracking.fusion import FusionConfig

DETECTION_QUEUE = 20
ANNOUNCEMENT_QUEUE = 100
MARKER_QUEUE = 2

Deliver = Callable[[Union[Announcement, Measurement]], None]


class Waiting(NamedTuple):
    """A sensor message that waits for its transforms; `data` is of the core's type and has a frame_id."""

    cue: Cue
    announcement: Announcement
    data: Any
    requests: Tuple[TransformRequest, ...]


class Cues(Part):
    """The cues of one process.

    Args:
        use_tf: whether there is tf.
        deliver: takes announcements the moment sensor messages come, and each measurement, in the sensor's frame, as
            soon as it is made; None: they are published for a tracker in another process.
        ears: subscriptions of this very process to what it publishes, for which nothing needs to be published.
    """

    def __init__(
        self, node: Node, config: FusionConfig, use_tf: bool, deliver: Optional[Deliver] = None, ears: int = 0
    ) -> None:
        self.node = node
        self.cues: Dict[str, Cue] = {}
        self._deliver, self._ears = deliver, ears
        self.source = node.source if use_tf else None
        self.waiting: WaitingRoom[Waiting] = WaitingRoom(
            self._is_ready, config.transforms.patience_s, gave_up=self._withdraw
        )
        self._announcements = rospy.Publisher(
            topics.ANNOUNCEMENTS, MeasurementAnnouncement, queue_size=ANNOUNCEMENT_QUEUE, tcp_nodelay=True
        )
        self._detections = rospy.Publisher(
            topics.DETECTIONS, DetectedPersons, queue_size=DETECTION_QUEUE, tcp_nodelay=True
        )
        self._markers = rospy.Publisher(topics.DETECTION_MARKERS, MarkerArray, queue_size=MARKER_QUEUE)
        node.diagnostics.add_losses(self.waiting.counters)
        node.parts.append(self)

    @property
    def names(self) -> FrozenSet[str]:
        """Of the cues."""
        return frozenset(self.cues)

    def serve(self) -> None:
        """Measure what has its transforms."""
        for waiting in self.waiting.poll(self.node.now_ns()) if self.waiting else ():
            self.measure(waiting)

    def reset(self) -> None:
        """Time has jumped."""
        self.waiting.reset()
        for cue in self.cues.values():
            cue.reset()

    def take(self, cue: Cue, data: Any) -> None:
        """Announce a sensor message; it is measured when it has its transforms.

        Raises:
            DataError: the message is unusable.
        """
        self.node.timeline.require(cue.name, data.stamp_ns)
        announcement = cue.announce(data.stamp_ns)
        self._announce(announcement, data.frame_id)
        waiting = Waiting(cue, announcement, data, ())
        try:
            requests = cue.transforms_needed(data) if self.source else ()
        except DataError:
            self._withdraw(waiting)
            raise
        self.waiting.push(cue.name, data.stamp_ns, waiting._replace(requests=requests), self.node.now_ns())

    def measure(self, waiting: Waiting) -> None:
        """Measure and tell, or withdraw."""
        cue = waiting.cue
        try:
            measurement = cue.measure(waiting.data, self.source)
        except DataError as error:
            self.node.diagnostics.bad(error.reason, f"{cue.name}: {error}")
            self._withdraw(waiting)
        except TransformUnavailable as error:
            self.node.diagnostics.bad("transform went missing", str(error))
            self._withdraw(waiting)
        except NotLooked:
            self._withdraw(waiting)
        else:
            self._publish(dataclasses.replace(measurement, sequence=waiting.announcement.sequence))

    def _is_ready(self, waiting: Waiting) -> bool:
        return all(request_is_met(self.node.source, request) for request in waiting.requests)

    def _withdraw(self, waiting: Waiting) -> None:
        self._announce(waiting.announcement._replace(withdrawn=True), waiting.data.frame_id)

    def _announce(self, announcement: Announcement, frame_id: str) -> None:
        if self._deliver is not None:
            self._deliver(announcement)
        elif self._announcements.get_num_connections():
            self._announcements.publish(announcement_to_msg(announcement, frame_id))

    def _publish(self, measurement: Measurement) -> None:
        if self._deliver is not None:
            self._deliver(measurement)
        scored = self._publish_scores(measurement)
        if self._detections.get_num_connections() > self._ears:
            message = measurement_to_msg(measurement)
            message.scored = scored
            self._detections.publish(message)
        if self._markers.get_num_connections():
            self._markers.publish(detection_markers(measurement))

    def _publish_scores(self, measurement: Measurement) -> bool:  # noqa: ARG002
        """Publish what a cue knows beyond detections; returns whether it did."""
        return False
