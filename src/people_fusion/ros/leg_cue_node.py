"""Legs in laser scans: a cue for each scanner, in a node of its own or within the composed one."""

from __future__ import annotations

import dataclasses
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Callable, Dict, NamedTuple, Optional, Tuple, Union

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import MarkerArray

from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError, DataError, TransformUnavailable
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.scans import Scan
from people_fusion.core.waiting import WaitingRoom
from people_fusion.cues.cue import CUES, Cue, TransformRequest
from people_fusion.msg import DetectedPersons, MeasurementAnnouncement
from people_fusion.ros import topics
from people_fusion.ros.conversions import (
    announcement_to_msg,
    grid_from_msg,
    localisation_from_msg,
    measurement_to_msg,
    scan_from_msg,
)
from people_fusion.ros.markers import detection_markers
from people_fusion.ros.node import Node, Part, run
from people_fusion.ros.transforms import request_is_met
from people_fusion.tracking.fusion import FusionConfig

SCAN_QUEUE = 10  # a second of most scanners: the node may stall for that long, and must not lag by more
SCAN_BUFFER = 1 << 20  # bytes; rospy lags where a message does not fit
DETECTION_QUEUE = 20
ANNOUNCEMENT_QUEUE = 100
LOCALISATION_QUEUE = 10
MARKER_QUEUE = 2
MAP_PATIENCE_S = 3.0  # a map whose frame has never been seen for so long is laid aside until it is


Deliver = Callable[[Union[Announcement, Measurement]], None]


@dataclass(frozen=True)
class LegCueSettings:
    """The leg cue node's own parameters."""

    scans: Tuple[str, ...] = parameter((topics.SCAN,), "topics of the scanners; a cue has its topic's name")
    use_tf: bool = parameter(True, "whether there is tf; without, scanners stand still and no map is used")

    def __post_init__(self) -> None:
        if not self.scans or len(set(self.scans)) < len(self.scans):
            raise ConfigError(f"scans: expected topics that differ, got {list(self.scans)}")


class _Waiting(NamedTuple):
    cue: Cue
    announcement: Announcement
    scan: Scan
    requests: Tuple[TransformRequest, ...]


class LegCues(Part):
    """The leg cues of one process.

    Args:
        deliver: takes announcements the moment scans come, and each measurement, in the sensor's frame, as soon as it
            is made; None: they are published for a tracker in another process.
    """

    def __init__(
        self, node: Node, settings: LegCueSettings, config: FusionConfig, deliver: Optional[Deliver] = None
    ) -> None:
        self._node, self._deliver = node, deliver
        self._announcements = rospy.Publisher(
            topics.ANNOUNCEMENTS, MeasurementAnnouncement, queue_size=ANNOUNCEMENT_QUEUE, tcp_nodelay=True
        )
        self._source = node.source if settings.use_tf else None
        self._waiting: WaitingRoom[_Waiting] = WaitingRoom(
            self._is_ready, config.transforms.patience_s, gave_up=self._withdraw
        )
        self._cues: Dict[str, Cue] = {}
        self._grid: Optional[OccupancyGrid] = None
        self._map_is_used = False
        self._newest: Optional[Scan] = None
        self._detections = rospy.Publisher(
            topics.DETECTIONS, DetectedPersons, queue_size=DETECTION_QUEUE, tcp_nodelay=True
        )
        self._markers = rospy.Publisher(topics.DETECTION_MARKERS, MarkerArray, queue_size=MARKER_QUEUE)
        for topic in settings.scans:
            name = rospy.resolve_name(topic).strip("/")
            cue = self._cues[topic] = CUES.build(config.leg_cue, name=name, frames=config.frames)
            node.subscribe(topic, numpy_msg(LaserScan), self._callback(topic, cue), SCAN_QUEUE, SCAN_BUFFER)
        if settings.use_tf:
            node.subscribe(topics.MAP, numpy_msg(OccupancyGridMsg), self._on_map, 1)
            node.subscribe(topics.LOCALISATION, PoseWithCovarianceStamped, self._on_localisation, LOCALISATION_QUEUE)
        node.diagnostics.add_losses(self._waiting.counters)
        node.diagnostics.add_facts(lambda: {"scans waiting": len(self._waiting), "map in use": self._map_is_used})
        node.parts.append(self)

    def serve(self) -> None:
        """Measure the scans whose transforms are there."""
        self._watch_map()
        if not self._waiting:
            return
        for waiting in self._waiting.poll(self._node.now_ns()):
            cue, announcement = waiting.cue, waiting.announcement
            try:
                measurement = cue.measure(waiting.scan, self._source)
            except DataError as error:
                self._node.diagnostics.bad(error.reason, f"{cue.name}: {error}")
                self._withdraw(waiting)
            except TransformUnavailable as error:
                self._node.diagnostics.bad("transform went missing", str(error))
                self._withdraw(waiting)
            else:
                self._publish(dataclasses.replace(measurement, sequence=announcement.sequence))

    def reset(self) -> None:
        """Time has jumped."""
        self._waiting.reset()
        for cue in self._cues.values():
            cue.reset()

    def _callback(self, topic: str, cue: Cue) -> Callable[[Any], None]:
        def on_scan(message: Any) -> None:
            self._node.diagnostics.heard(topic)
            scan = scan_from_msg(message)
            self._node.timeline.require(cue.name, scan.stamp_ns)
            announcement = cue.announce(scan.stamp_ns)
            self._announce(announcement, scan.frame_id)
            self._newest = scan
            waiting = _Waiting(cue, announcement, scan, ())
            try:
                requests = cue.transforms_needed(scan) if self._source else ()
            except DataError:
                self._withdraw(waiting)
                raise
            waiting = waiting._replace(requests=requests)
            self._waiting.push(cue.name, scan.stamp_ns, waiting, self._node.now_ns())
            self.serve()

        return on_scan

    def _on_localisation(self, message: Any) -> None:
        _, _, world_from_base = localisation_from_msg(message)
        for cue in self._cues.values():
            cue.set_localisation(world_from_base.covariance)

    def _on_map(self, message: Any) -> None:
        self._grid = grid_from_msg(message)
        self._use_map(True)

    def _watch_map(self) -> None:
        """Without localisation a map must not keep the cues from working; it counts from when its frame is seen."""
        if self._grid is None or self._newest is None:
            return
        if not self._map_is_used:
            newest = TransformRequest(self._grid.frame_id, self._newest.frame_id, self._newest.stamp_ns)
            with suppress(TransformUnavailable):
                self._use_map(request_is_met(self._node.source, newest))
        elif any(
            missing.target_frame == self._grid.frame_id and not missing.ever_found and missing.seconds > MAP_PATIENCE_S
            for missing in self._node.source.missing()
        ):
            rospy.logwarn("no transform to %s: the map is not used until there is one", self._grid.frame_id)
            self._use_map(False)

    def _use_map(self, is_used: bool) -> None:
        if is_used or self._map_is_used:
            for cue in self._cues.values():
                cue.set_map(self._grid if is_used else None)
        self._map_is_used = is_used

    def _is_ready(self, waiting: _Waiting) -> bool:
        return all(request_is_met(self._node.source, request) for request in waiting.requests)

    def _withdraw(self, waiting: _Waiting) -> None:
        self._announce(waiting.announcement._replace(withdrawn=True), waiting.scan.frame_id)

    def _announce(self, announcement: Announcement, frame_id: str) -> None:
        if self._deliver is not None:
            self._deliver(announcement)
        elif self._announcements.get_num_connections():
            self._announcements.publish(announcement_to_msg(announcement, frame_id))

    def _publish(self, measurement: Measurement) -> None:
        if self._deliver is not None:
            self._deliver(measurement)
        if self._detections.get_num_connections():
            self._detections.publish(measurement_to_msg(measurement))
        if self._markers.get_num_connections():
            self._markers.publish(detection_markers(measurement))


def _build(settings: LegCueSettings, config: FusionConfig) -> Node:
    node = Node(config, settings.scans)
    LegCues(node, settings, config)
    return node


def main() -> int:
    """Entry of scripts/leg_cue; returns the exit status."""
    return run("leg_cue", LegCueSettings, _build)
