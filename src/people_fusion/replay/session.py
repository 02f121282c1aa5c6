"""A recording driven through cues and fusion in order of arrival, as the live graph does it, as fast as it goes."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from functools import partial
from typing import Any, Callable, Dict, List, NamedTuple, Optional, Sequence

from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Measurement
from people_fusion.core.scans import Scan
from people_fusion.core.transforms import TransformTree
from people_fusion.core.waiting import WaitingRoom, transforms_ready
from people_fusion.cues.cue import CUES, Cue, TransformRequest
from people_fusion.replay import conversions
from people_fusion.replay.discovery import Sources
from people_fusion.replay.recording import RecordedMessage, Recording, Topic
from people_fusion.tracking.fusion import Fusion, FusionConfig

AFTERWARDS_NS = 10**18


class Update(NamedTuple):
    """One measurement that went through.

    Attributes:
        measurement: in the sensor's frame.
        changed: whether it changed the tracks.
        arrival_ns: on the bag's clock.
    """

    measurement: Measurement
    changed: bool
    arrival_ns: int


@dataclass(frozen=True, eq=False)
class _Waiting:
    cue: Cue
    scan: Scan
    requests: Sequence[TransformRequest]


class Session:
    """Cues and fusion, fed with recorded messages.

    Args:
        config: preset with the frames of this recording.
        sources: what to take of the recording.
        before: called with the stamp of a measurement before the tracker gets it.
        after: called when the tracker has it.

    Attributes:
        fusion: where the tracks are.
        transforms: the recording's transforms so far.
        grid: newest map, or None.
    """

    def __init__(
        self,
        config: FusionConfig,
        sources: Sources,
        before: Optional[Callable[[int], None]] = None,
        after: Optional[Callable[[Update], None]] = None,
    ) -> None:
        self.transforms = TransformTree(config.transforms.history_s)
        self.fusion = Fusion(config, self.transforms)
        self.grid: Optional[OccupancyGrid] = None
        self._sources, self._before, self._after = sources, before, after
        self._waiting: WaitingRoom[_Waiting] = WaitingRoom(self._is_ready, config.transforms.patience_s)
        self._cues: List[Cue] = []
        self._feeders: Dict[str, Callable[[Any], None]] = {}
        for topic in sources.transforms:
            self._feeders[topic.name] = partial(self._feed_links, is_static=_is_static(topic))
        for topic in sources.scans:
            cue = CUES.build(config.leg_cue, name=topic.name.strip("/"), frames=config.frames)
            self._cues.append(cue)
            self._feeders[topic.name] = partial(self._feed_scan, cue)
        if sources.localisation:
            self._feeders[sources.localisation.name] = self._feed_localisation
        if sources.map:
            self._feeders[sources.map.name] = self._feed_map
        self._counts: Counter = Counter()
        self._now_ns = 0

    def run(self, recording: Recording, start_s: float = 0.0, duration_s: Optional[float] = None) -> None:
        """Drive a whole recording, or `duration_s` of it from `start_s` on, through.

        Raises:
            RecordingError: the recording is damaged.
        """
        sources = self._sources
        latched = [topic for topic in sources.transforms if _is_static(topic)]
        latched += [sources.map] if sources.map else []
        flowing = [topic for topic in sources.transforms if not _is_static(topic)]
        flowing += [sources.localisation] if sources.localisation else []
        if start_s > 0.0:
            for recorded in recording.messages(latched, 0.0, start_s):
                self.feed(recorded)
        for recorded in recording.messages([*latched, *flowing, *sources.scans], start_s, duration_s):
            self.feed(recorded)
        self.finish()

    def feed(self, recorded: RecordedMessage) -> None:
        """Take one message; messages come in order of arrival."""
        self._now_ns = recorded.arrival_ns - self._sources.clock_offset_ns
        try:
            self._feeders[recorded.topic](recorded.read())
        except DataError as error:
            self._counts[error.reason] += 1
        if len(self._waiting):
            self._serve(self._now_ns, recorded.arrival_ns)

    def finish(self) -> None:
        """No more messages come: whoever still waits is served or given up."""
        self._serve(self._now_ns + AFTERWARDS_NS, self._now_ns + self._sources.clock_offset_ns)

    def counters(self) -> Dict[str, int]:
        """Events since the start, by name."""
        return {**self._counts, **self._waiting.counters(), **self.fusion.counters()}

    @property
    def scans(self) -> int:
        """Scans that arrived."""
        return self._counts["scans"]

    @property
    def processed(self) -> int:
        """Scans that went through."""
        return self._counts["scans processed"]

    def _feed_links(self, message: Any, is_static: bool) -> None:
        for link in conversions.links(message):
            if (link.parent, link.child) in self._sources.links:
                try:
                    self.transforms.add(link.parent, link.child, link.stamp_ns, link.pose(), static=is_static)
                except DataError as error:
                    self._counts[f"transform: {error.reason}"] += 1

    def _feed_localisation(self, message: Any) -> None:
        self.fusion.transforms.add_localisation(
            conversions.stamp(message.header), conversions.uncertain_pose(message.pose)
        )

    def _feed_map(self, message: Any) -> None:
        self.grid = conversions.occupancy_grid(message)
        self.fusion.set_map(self.grid)
        for cue in self._cues:
            cue.set_map(self.grid)

    def _feed_scan(self, cue: Cue, message: Any) -> None:
        self._counts["scans"] += 1
        scan = conversions.scan(message)
        requests = {TransformRequest(self.fusion.tracking_frame, scan.frame_id, scan.stamp_ns)}
        if self._sources.transforms:
            requests.update(cue.transforms_needed(scan))
        newest_first = sorted(requests, key=lambda request: (-request.stamp_ns, request))
        self._waiting.push(cue.name, scan.stamp_ns, _Waiting(cue, scan, newest_first), self._now_ns)

    def _is_ready(self, waiting: _Waiting) -> bool:
        return all(
            transforms_ready(self.transforms, request.target_frame, request.source_frame, (request.stamp_ns,))
            for request in waiting.requests
        )

    def _serve(self, now_ns: int, arrival_ns: int) -> None:
        for waiting in self._waiting.poll(now_ns):
            try:
                measurement = waiting.cue.measure(waiting.scan, self.transforms if self._sources.transforms else None)
                if self._before is not None:
                    self._before(measurement.stamp_ns)
                changed = self.fusion.push(measurement, self._now_ns)
            except DataError as error:
                self._counts[error.reason] += 1
            except TransformUnavailable:
                self._counts["transform unavailable"] += 1
            else:
                self._counts["scans processed"] += 1
                if self._after is not None:
                    self._after(Update(measurement, changed, arrival_ns))


def _is_static(topic: Topic) -> bool:
    return topic.name.endswith("tf_static")
