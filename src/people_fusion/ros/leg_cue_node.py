"""Legs in laser scans: a cue for each scanner, in a node of its own or within the composed one."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Callable, Optional, Tuple

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import LaserScan

from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError, TransformUnavailable
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.scans import Scan
from people_fusion.cues.cue import CUES, Cue, TransformRequest
from people_fusion.ros import topics
from people_fusion.ros.conversions import grid_from_msg, localisation_from_msg, scan_from_msg
from people_fusion.ros.cues import Cues, Deliver
from people_fusion.ros.node import Node, run
from people_fusion.ros.transforms import request_is_met
from people_fusion.tracking.fusion import FusionConfig

SCAN_QUEUE = 10  # a second of most scanners: the node may stall for that long, and must not lag by more
SCAN_BUFFER = 1 << 20  # bytes; rospy lags where a message does not fit
LOCALISATION_QUEUE = 10
MAP_PATIENCE_S = 3.0  # a map whose frame has never been seen for so long is laid aside until it is


@dataclass(frozen=True)
class LegCueSettings:
    """The leg cue node's own parameters."""

    scans: Tuple[str, ...] = parameter((topics.SCAN,), "topics of the scanners; a cue has its topic's name")
    use_tf: bool = parameter(True, "whether there is tf; without, scanners stand still and no map is used")

    def __post_init__(self) -> None:
        if not self.scans or len(set(self.scans)) < len(self.scans):
            raise ConfigError(f"scans: expected topics that differ, got {list(self.scans)}")


class LegCues(Cues):
    """The leg cues of one process."""

    def __init__(
        self,
        node: Node,
        settings: LegCueSettings,
        config: FusionConfig,
        deliver: Optional[Deliver] = None,
        ears: int = 0,
    ) -> None:
        super().__init__(node, config, settings.use_tf, deliver, ears)
        self._grid: Optional[OccupancyGrid] = None
        self._map_is_used = False
        self._newest: Optional[Scan] = None
        for topic in settings.scans:
            name = rospy.resolve_name(topic).strip("/")
            cue = self.cues[name] = CUES.build(config.leg_cue, name=name, frames=config.frames)
            node.subscribe(topic, numpy_msg(LaserScan), self._callback(topic, cue), SCAN_QUEUE, SCAN_BUFFER)
        if settings.use_tf:
            node.subscribe(topics.MAP, numpy_msg(OccupancyGridMsg), self._on_map, 1)
            node.subscribe(topics.LOCALISATION, PoseWithCovarianceStamped, self._on_localisation, LOCALISATION_QUEUE)
        node.diagnostics.add_facts(lambda: {"scans waiting": len(self.waiting), "map in use": self._map_is_used})

    def serve(self) -> None:
        """Measure the scans whose transforms are there."""
        self._watch_map()
        super().serve()

    def _callback(self, topic: str, cue: Cue) -> Callable[[Any], None]:
        def on_scan(message: Any) -> None:
            self.node.diagnostics.heard(topic)
            self._newest = scan = scan_from_msg(message)
            self.take(cue, scan)
            self.serve()

        return on_scan

    def _on_localisation(self, message: Any) -> None:
        _, _, world_from_base = localisation_from_msg(message)
        for cue in self.cues.values():
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
                self._use_map(request_is_met(self.node.source, newest))
        elif any(
            missing.target_frame == self._grid.frame_id and not missing.ever_found and missing.seconds > MAP_PATIENCE_S
            for missing in self.node.source.missing()
        ):
            rospy.logwarn("no transform to %s: the map is not used until there is one", self._grid.frame_id)
            self._use_map(False)

    def _use_map(self, is_used: bool) -> None:
        if is_used or self._map_is_used:
            for cue in self.cues.values():
                cue.set_map(self._grid if is_used else None)
        self._map_is_used = is_used


def _build(settings: LegCueSettings, config: FusionConfig) -> Node:
    node = Node(config, settings.scans)
    LegCues(node, settings, config)
    return node


def main() -> int:
    """Entry of scripts/leg_cue; returns the exit status."""
    return run("leg_cue", LegCueSettings, _build)
