"""The tracker: measurements of all cues in, tracks out; in a node of its own or within the composed one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Dict

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid
from rospy.numpy_msg import numpy_msg

from people_fusion.core.config import parameter
from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.measurements import Measurement
from people_fusion.core.waiting import WaitingRoom
from people_fusion.cues.cue import TransformRequest
from people_fusion.msg import DetectedPersons
from people_fusion.ros import topics
from people_fusion.ros.conversions import grid_from_msg, localisation_from_msg, measurement_from_msg
from people_fusion.ros.node import Node, Part, run
from people_fusion.ros.outputs import COMPATIBLE, TrackOutputs
from people_fusion.ros.transforms import request_is_met
from people_fusion.tracking.fusion import Fusion, FusionConfig

DETECTION_QUEUE = 50  # of all cues together
LOCALISATION_QUEUE = 10


@dataclass(frozen=True)
class PeopleTrackerSettings:
    """The tracker node's own parameters."""

    compatible: str = parameter("none", "also publish what listeners of another tracker know", choices=COMPATIBLE)


class PeopleTracker(Part):
    """The tracker of one process."""

    def __init__(self, node: Node, settings: PeopleTrackerSettings, config: FusionConfig) -> None:
        self._node, self._frames = node, config.frames
        self._fusion = Fusion(config, node.source)
        self._waiting: WaitingRoom[Measurement] = WaitingRoom(self._is_ready, config.transforms.patience_s)
        self._outputs = TrackOutputs(node.source, config.frames, settings.compatible)
        self._facts: Dict[str, Any] = {"tracks": 0, "confirmed": 0, "frame": "none yet"}
        node.subscribe(topics.LOCALISATION, PoseWithCovarianceStamped, self._on_localisation, LOCALISATION_QUEUE)
        node.subscribe(topics.MAP, numpy_msg(OccupancyGrid), self._on_map, 1)
        node.diagnostics.add_losses(self._waiting.counters)
        node.diagnostics.add_facts(
            lambda: {"measurements waiting": len(self._waiting), **self._facts, **self._fusion.counters()}
        )
        node.parts.append(self)

    def listen(self) -> None:
        """Take measurements from the cues of other processes."""
        self._node.subscribe(topics.DETECTIONS, DetectedPersons, self._on_detections, DETECTION_QUEUE, 1 << 20)

    def receive(self, measurement: Measurement) -> None:
        """Take a measurement in its sensor's frame."""
        self._waiting.push(measurement.cue, measurement.stamp_ns, measurement, self._node.now_ns())
        self.serve()

    def serve(self) -> None:
        """Fuse the measurements whose transforms are there; tracks are published after each."""
        if not self._waiting:
            return
        now_ns = self._node.now_ns()
        for measurement in self._waiting.poll(now_ns):
            try:
                released = self._fusion.push(measurement, now_ns)
            except TransformUnavailable as error:
                self._node.diagnostics.bad("transform went missing", str(error))
                continue
            for entry in released:
                if self._fusion.process(entry):
                    self._publish()

    def reset(self) -> None:
        """Time has jumped."""
        self._waiting.reset()
        self._fusion.reset()
        self._outputs.reset()

    def _publish(self) -> None:
        tracks = self._fusion.tracks()
        self._facts = {"tracks": len(tracks), "confirmed": int(tracks.confirmed.sum()), "frame": tracks.frame_id}
        self._outputs.publish(tracks)

    def _on_detections(self, message: Any) -> None:
        self._node.diagnostics.heard(topics.DETECTIONS)
        measurement = measurement_from_msg(message)
        if not self._node.timeline.admit(measurement.cue, measurement.stamp_ns):
            raise DataError("detections left over from before a time jump")
        self.receive(measurement)

    def _on_localisation(self, message: Any) -> None:
        stamp_ns, frame_id, world_from_base = localisation_from_msg(message)
        if frame_id != self._frames.world:
            raise DataError("localisation in another frame", f"{frame_id} instead of {self._frames.world}")
        if self._node.timeline.admit(topics.LOCALISATION, stamp_ns, witness=False):
            self._fusion.transforms.add_localisation(stamp_ns, world_from_base)

    def _on_map(self, message: Any) -> None:
        self._fusion.set_map(grid_from_msg(message))

    def _is_ready(self, measurement: Measurement) -> bool:
        request = TransformRequest(self._fusion.tracking_frame, measurement.frame_id, measurement.stamp_ns)
        return request_is_met(self._node.source, request)


def _build(settings: PeopleTrackerSettings, config: FusionConfig) -> Node:
    node = Node(config, [topics.DETECTIONS])
    PeopleTracker(node, settings, config).listen()
    return node


def main() -> int:
    """Entry of scripts/people_tracker; returns the exit status."""
    return run("people_tracker", PeopleTrackerSettings, _build)
