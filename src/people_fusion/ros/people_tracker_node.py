"""The tracker: measurements of all cues in, tracks out; in a node of its own or within the composed one."""

from __future__ import annotations

import threading
import time
import traceback
from collections import deque
from dataclasses import dataclass
from typing import Any, Deque, Dict, FrozenSet, List, NamedTuple, Optional, Tuple, Union

import rospy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rospy.numpy_msg import numpy_msg

from people_fusion.core.camera_models import Panorama
from people_fusion.core.config import parameter
from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.head_scores import NO_SCORES
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.poses import UncertainPose
from people_fusion.core.stamps import NANOSECONDS, from_seconds, to_seconds
from people_fusion.core.waiting import WaitingRoom
from people_fusion.cues.cue import TransformRequest
from people_fusion.msg import DetectedPersons, HeadScores, MeasurementAnnouncement
from people_fusion.ros import topics
from people_fusion.ros.conversions import (
    announcement_from_msg,
    grid_from_msg,
    localisation_from_msg,
    measurement_from_msg,
)
from people_fusion.ros.head_scores import scored_from_msg
from people_fusion.ros.intake import Entry, Intake
from people_fusion.ros.node import Node, Part, run
from people_fusion.ros.outputs import COMPATIBLE, TrackOutputs
from people_fusion.ros.transforms import request_is_met
from people_fusion.tracking.fusion import Fusion, FusionConfig
from people_fusion.tracking.roster import MOST_CUES

# More than the intake holds, so that what is lost is lost there, where it is counted.
DETECTION_QUEUE = 1024
ANNOUNCEMENT_QUEUE = 1024
LOCALISATION_QUEUE = 10
SCORE_QUEUE, SCORE_BUFFER = 4, 1 << 25  # megabytes each
INTAKE = 64  # measurements a cue: a tracker that is too slow shall not lag by many seconds
ANNOUNCED = "announcements of "
JUMPED = "waited when time jumped"
LOSS_WORDS = ("lost", "dropped", "shed", "early", "jumped")  # in the names of counters
RECENT_NS = NANOSECONDS  # the output's delay and rate are those of so long
DELAYS = 1000
DESCRIBED_EVERY_S = 0.9


@dataclass(frozen=True)
class PeopleTrackerSettings:
    """The tracker node's own parameters."""

    particle_rate: float = parameter(5.0, "how often a second particles are published at most", 0.1, 100.0)
    compatible: str = parameter("none", "also publish what listeners of another tracker know", choices=COMPATIBLE)


class _Localised(NamedTuple):
    stamp_ns: int
    world_from_base: UncertainPose


class _Jump(NamedTuple):
    """What was put before it is of another time."""


class PeopleTracker(Part):
    """The tracker of one process.

    Callbacks leave in the intake what they are told; a thread of its own, to which the fusion belongs, does the work.
    It sleeps until something comes, what waits in the buffer is due, or transforms come that something waits for.
    """

    def __init__(self, node: Node, settings: PeopleTrackerSettings, config: FusionConfig) -> None:
        self._node, self._frames = node, config.frames
        self._panoramas = {frame: Panorama(each) for frame, each in config.panoramas.items()}
        self._fusion = Fusion(config, node.source)
        self._waiting: WaitingRoom[Measurement] = WaitingRoom(
            self._is_ready, config.transforms.patience_s, gave_up=self._withdraw
        )
        with_legs = self._fusion.legs() is not None
        particle_rate = settings.particle_rate if self._fusion.particles() is not None else 0.0
        self._outputs = TrackOutputs(
            node.source, config.frames, settings.compatible, self._fusion.buffer.revisable, with_legs, particle_rate
        )
        self._intake = Intake(INTAKE, 2 * MOST_CUES)
        self._own: FrozenSet[str] = frozenset()
        self._ahead_ns = from_seconds(self._fusion.buffer.config.ahead_s)
        self._due_ns: Optional[int] = None
        self._waits_for_transforms = False
        self._processed_ns: Optional[int] = None
        self._delivered_ns: Optional[int] = None
        self._released: List[Measurement] = []
        self._lost_in_jumps = 0
        self._delays: Deque[Tuple[int, int]] = deque(maxlen=DELAYS)  # when tracks were published, and how old they were
        self._facts: Dict[str, Any] = {}
        self._events: Dict[str, int] = {}
        self._losses: Dict[str, int] = {}
        self._described_at = float("-inf")
        self._shown: Dict[str, Any] = {"tracks": 0, "confirmed": 0, "frame": "none yet"}
        node.subscribe(topics.LOCALISATION, PoseWithCovarianceStamped, self._on_localisation, LOCALISATION_QUEUE)
        node.subscribe(topics.MAP, numpy_msg(OccupancyGridMsg), self._on_map, 1)
        node.diagnostics.add_losses(lambda: self._losses)
        node.diagnostics.add_events(lambda: {**self._events, **self._intake.counters()})
        node.diagnostics.add_facts(lambda: self._facts)
        node.parts.append(self)
        threading.Thread(target=self._work, name="tracker", daemon=True).start()

    def listen(self, own: FrozenSet[str] = frozenset()) -> None:
        """Take measurements and their announcements from the cues of other processes: all but `own`."""
        self._own = own
        subscribe = self._node.subscribe
        subscribe(topics.ANNOUNCEMENTS, MeasurementAnnouncement, self._on_announcement, ANNOUNCEMENT_QUEUE, 1 << 20)
        subscribe(topics.DETECTIONS, DetectedPersons, self._on_detections, DETECTION_QUEUE, 1 << 20)
        if self._fusion.scores != NO_SCORES:
            subscribe(topics.HEAD_SCORES, numpy_msg(HeadScores), self._on_scores, SCORE_QUEUE, SCORE_BUFFER)

    def receive(self, item: Union[Announcement, Measurement]) -> None:
        """Take what a cue announces or delivers, in its sensor's frame."""
        source = item.cue if isinstance(item, Measurement) else ANNOUNCED + item.cue
        now_ns = self._node.now_ns()
        shed = self._intake.put(source, item, now_ns)
        if isinstance(shed, Measurement):
            self._intake.put(ANNOUNCED + shed.cue, _withdrawal(shed), now_ns)

    def serve(self) -> None:
        """A transform came."""
        if self._waits_for_transforms:
            self._intake.wake()

    def tick(self) -> None:
        """Time has passed."""
        is_due = self._due_ns is not None and self._node.now_ns() >= self._due_ns
        if is_due or time.monotonic() - self._described_at > DESCRIBED_EVERY_S:
            self._intake.wake()

    def reset(self) -> None:
        """Time has jumped."""
        self._intake.put("clock", _Jump(), 0)

    def _work(self) -> None:
        while not rospy.is_shutdown():
            entries = self._intake.take(self._node.wall_seconds_until(self._due_ns))
            try:
                self._go_on(entries)
            except Exception:  # as rospy does with its callbacks: the next message may be a better one
                rospy.logerr("the tracker failed: %s", traceback.format_exc())
                self._node.diagnostics.bad("the tracker failed")

    def _go_on(self, entries: List[Entry]) -> None:
        """Fuse what came, and what is due or ready by now."""
        news_ns = self._delivered_ns
        for item, at_ns, _ in entries:
            if isinstance(item, _Jump):
                self._start_anew()
                news_ns = None
            elif isinstance(item, Announcement):
                self._released += self._fusion.push(item, at_ns)
            elif isinstance(item, Measurement):
                self._waiting.push(item.cue, item.stamp_ns, item, at_ns)
                self._push_ready(at_ns)
            elif isinstance(item, _Localised):
                self._fusion.transforms.add_localisation(*item)
            else:
                self._fusion.set_map(item)
        now_ns = self._node.now_ns()
        self._push_ready(now_ns)
        self._released += self._fusion.poll(now_ns)
        self._process()
        if self._outputs.previewed and self._delivered_ns not in (None, news_ns):
            self._outputs.publish_preview(self._fusion.preview(self._delivered_ns))
        now_ns = self._node.now_ns()
        self._waits_for_transforms = len(self._waiting) > 0
        sleep_ns = self._fusion.buffer.sleep_ns(now_ns)
        self._due_ns = None if sleep_ns is None else now_ns + sleep_ns
        if time.monotonic() - self._described_at > DESCRIBED_EVERY_S:
            self._described_at = time.monotonic()
            self._describe(now_ns)

    def _push_ready(self, now_ns: int) -> None:
        """Push the measurements whose transforms are there."""
        for measurement in self._waiting.poll(now_ns):
            try:
                self._released += self._fusion.push(measurement, now_ns)
            except TransformUnavailable as error:
                self._node.diagnostics.bad("transform went missing", str(error))
                self._withdraw(measurement)
            else:
                self._delivered_ns = max(self._delivered_ns or 0, measurement.stamp_ns)

    def _withdraw(self, measurement: Measurement) -> None:
        self._released += self._fusion.push(_withdrawal(measurement), self._node.now_ns())

    def _process(self) -> None:
        """Process what was handed out; tracks are published at each new stamp, and once for all that came late."""
        is_revised = False
        while self._released:
            measurement = self._released.pop(0)  # gone before anything can fail: it would fail again and again
            if not self._fusion.process(measurement):
                continue
            is_revised = True
            if self._processed_ns is None or measurement.stamp_ns >= self._processed_ns:
                self._processed_ns = measurement.stamp_ns
                self._publish()
                is_revised = False
        if is_revised:
            self._publish()

    def _publish(self) -> None:
        tracks = self._fusion.tracks()
        self._shown = {"tracks": len(tracks), "confirmed": int(tracks.confirmed.sum()), "frame": tracks.frame_id}
        self._outputs.publish(tracks)
        legs = self._fusion.legs() if self._outputs.legs_watched else None
        if legs is not None:
            self._outputs.publish_legs(legs)
        particles = self._fusion.particles() if self._outputs.particles_due(tracks.stamp_ns) else None
        if particles is not None:
            self._outputs.publish_particles(particles)
        now_ns = self._node.now_ns()
        self._delays.append((now_ns, now_ns - tracks.stamp_ns))

    def _start_anew(self) -> None:
        self._lost_in_jumps += len(self._released)
        self._released = []
        self._waiting.reset()
        self._fusion.reset()
        self._outputs.reset()
        self._delays.clear()
        self._processed_ns = self._delivered_ns = None

    def _describe(self, now_ns: int) -> None:
        """What diagnostics will say; made here, as all of this belongs to the worker."""
        roster = self._fusion.buffer.roster
        fused = self._fusion.counters()
        warned = {name: count for name, count in fused.items() if name in roster.counters() or _is_loss(name)}
        self._events = {**warned, JUMPED: warned.get(JUMPED, 0) + self._lost_in_jumps}
        self._losses = self._waiting.counters()
        self._facts = {
            "measurements waiting": len(self._waiting),
            "measurements in the buffer": len(self._fusion.buffer.held),
            **self._shown,
            **delay_facts(self._delays, now_ns),
            **{f"cue {name}": fact for name, fact in roster.facts(now_ns).items()},
            **{name: count for name, count in fused.items() if name not in warned},
        }

    def _on_announcement(self, message: Any) -> None:
        if message.cue in self._own:
            return
        announcement = announcement_from_msg(message)
        if not announcement.withdrawn:
            self._admit(ANNOUNCED + announcement.cue, announcement.stamp_ns)
        self.receive(announcement)

    def _on_detections(self, message: Any) -> None:
        if message.cue in self._own:
            return
        self._node.diagnostics.heard(topics.DETECTIONS)
        if message.scored and self._fusion.scores != NO_SCORES:
            return  # it comes with scores, too
        measurement = measurement_from_msg(message)
        self._admit(measurement.cue, measurement.stamp_ns)
        self.receive(measurement)

    def _on_scores(self, message: Any) -> None:
        self._node.diagnostics.heard(topics.HEAD_SCORES)
        measurement = scored_from_msg(message, self._panoramas)
        self._admit(measurement.cue, measurement.stamp_ns)
        self.receive(measurement)

    def _admit(self, stream: str, stamp_ns: int) -> None:
        # What the graph's clock contradicts is no time jump.
        if stamp_ns > self._node.now_ns() + self._ahead_ns:
            raise DataError(f"{stream}: stamp from the future")
        self._node.timeline.require(stream, stamp_ns)

    def _on_localisation(self, message: Any) -> None:
        stamp_ns, frame_id, world_from_base = localisation_from_msg(message)
        if frame_id != self._frames.world:
            raise DataError("localisation in another frame", f"{frame_id} instead of {self._frames.world}")
        if self._node.timeline.admit(topics.LOCALISATION, stamp_ns, witness=False):
            self._intake.put(topics.LOCALISATION, _Localised(stamp_ns, world_from_base), self._node.now_ns())

    def _on_map(self, message: Any) -> None:
        self._intake.put(topics.MAP, grid_from_msg(message), self._node.now_ns())

    def _is_ready(self, measurement: Measurement) -> bool:
        request = TransformRequest(self._fusion.tracking_frame, measurement.frame_id, measurement.stamp_ns)
        return request_is_met(self._node.source, request)


def _withdrawal(measurement: Measurement) -> Announcement:
    return Announcement(*measurement.order, withdrawn=True)


def _is_loss(name: str) -> bool:
    return any(word in name for word in LOSS_WORDS)


def delay_facts(delays: Deque[Tuple[int, int]], now_ns: int) -> Dict[str, str]:
    """How late the output was in the last second, and how often it came."""
    while delays and not now_ns - RECENT_NS < delays[0][0] <= now_ns:
        delays.popleft()
    old_ms = [1e-6 * delay_ns for _, delay_ns in delays]
    return {
        "outputs a second": f"{len(old_ms) / to_seconds(RECENT_NS):.0f}",
        "output delay, mean ms": f"{sum(old_ms) / len(old_ms):.1f}" if old_ms else "-",
        "output delay, max ms": f"{max(old_ms):.1f}" if old_ms else "-",
    }


def _build(settings: PeopleTrackerSettings, config: FusionConfig) -> Node:
    node = Node(config, [topics.DETECTIONS])
    PeopleTracker(node, settings, config).listen()
    return node


def main() -> int:
    """Entry of scripts/people_tracker; returns the exit status."""
    return run("people_tracker", PeopleTrackerSettings, _build)
