"""A recording driven through cues and fusion in order of arrival, as the live graph does it, as fast as it goes."""

from __future__ import annotations

import dataclasses
import heapq
from collections import Counter, defaultdict
from dataclasses import dataclass
from functools import partial
from typing import (
    Any,
    Callable,
    DefaultDict,
    Dict,
    Iterable,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Tuple,
    Union,
)

from people_fusion.core.camera_models import Panorama
from people_fusion.core.cameras import Camera
from people_fusion.core.depth_images import DepthImage
from people_fusion.core.errors import ConfigError, DataError, NotLooked, TransformUnavailable
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.image_topics import is_rectified
from people_fusion.core.images import Image
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.core.timeline import Timeline
from people_fusion.core.transforms import TransformTree
from people_fusion.core.waiting import WaitingRoom, transforms_ready
from people_fusion.cues.cue import CUES, Cue, TransformRequest
from people_fusion.replay import conversions
from people_fusion.replay.cameras import CameraSource, DepthSource
from people_fusion.replay.depths import DepthCamera
from people_fusion.replay.discovery import Sources
from people_fusion.replay.recording import RecordedMessage, Recording, Topic
from people_fusion.tracking.fusion import Fusion, FusionConfig

AFTERWARDS_NS = 10**18
SCANS, IMAGES, DEPTHS, RECORDED = "scans", "images", "depth images", "recorded measurements"
TRACKER = "tracker"


class Work(NamedTuple):
    """What a cue or the tracker had to do.

    Attributes:
        times: how often.
        seconds: all together, of the session's clock.
    """

    times: int = 0
    seconds: float = 0.0


class Update(NamedTuple):
    """One measurement that the tracker processed.

    Attributes:
        measurement: in the tracking frame.
        changed: whether it changed the tracks.
        arrival_ns: on the bag's clock.
    """

    measurement: Measurement
    changed: bool
    arrival_ns: int


@dataclass(frozen=True, eq=False)
class _Waiting:
    announcement: Announcement
    requests: Sequence[TransformRequest]
    measure: Callable[[], Measurement]
    kind: str


class Session:
    """Cues and fusion, fed with recorded messages.

    Args:
        config: preset with the frames of this recording.
        sources: what to take of the recording.
        measured: called with each measurement in its sensor's frame, and its arrival on the bag's clock.
        before: called with the stamp of a measurement before the tracker gets it.
        after: called when the tracker has it.
        told: called with each announcement that is not withdrawn, before the buffer gets it.
        passing: called with the time, on the clock of the stamps, before anything happens at it.
        make_cue: makes the cue of a scan topic from its name; None: the preset's.
        processing_s: how long the cues work on a scan or an image, by name of the cue; none is 0. A cue works on one
            at a time; one more may wait.
        clock: seconds by which `work` is measured, e.g. time.process_time; None: it is not.

    Attributes:
        fusion: where the tracks are.
        transforms: the recording's transforms so far.
        grid: newest map, or None.
        work: what was done, by the cue's name, and TRACKER for each measurement that was processed.

    Raises:
        ConfigError: `processing_s` names no cue.
    """

    def __init__(
        self,
        config: FusionConfig,
        sources: Sources,
        measured: Callable[[Measurement, int], None] = lambda _measurement, _arrival_ns: None,
        before: Callable[[int], None] = lambda _stamp_ns: None,
        after: Callable[[Update], None] = lambda _update: None,
        told: Callable[[Announcement], None] = lambda _announcement: None,
        passing: Callable[[int], None] = lambda _now_ns: None,
        make_cue: Optional[Callable[[str], Cue]] = None,
        processing_s: Optional[Mapping[str, float]] = None,
        clock: Optional[Callable[[], float]] = None,
    ) -> None:
        self.work: Dict[str, Work] = {}
        self._clock = clock
        self.transforms = TransformTree(config.transforms.history_s)
        self.fusion = Fusion(config, self.transforms)
        self.grid: Optional[OccupancyGrid] = None
        self._sources = sources
        self._measured, self._before, self._after = measured, before, after
        self._told, self._passing = told, passing
        self._processing_ns = {name: from_seconds(seconds) for name, seconds in (processing_s or {}).items()}
        self._deliveries: List[Tuple[int, int, _Waiting, Measurement]] = []  # a heap: when, turn
        self._free_ns: Dict[str, int] = {}  # when a cue has done what it has to do
        self._waiting: WaitingRoom[_Waiting] = WaitingRoom(
            self._is_ready, config.transforms.patience_s, gave_up=self._withdraw
        )
        self._lead_s = config.transforms.history_s
        self._cues: List[Cue] = []
        self._models: Dict[str, Camera] = {}  # of cameras, by frame
        self._depth_cameras: Dict[str, DepthCamera] = {}  # by cue
        self._feeders: DefaultDict[str, List[Callable[[Any], None]]] = defaultdict(list)
        for topic in sources.transforms:
            self._feeders[topic.name].append(partial(self._feed_links, is_static=_is_static(topic)))
        if sources.odometry:
            self._feeders[sources.odometry.name].append(self._feed_odometry)
        for topic in sources.scans:
            cue = make_cue(topic.name) if make_cue else build_cue(config, topic.name)
            self._cues.append(cue)
            self._feeders[topic.name].append(partial(self._feed_scan, cue))
        if sources.localisation:
            self._feeders[sources.localisation.name].append(self._feed_localisation)
        if sources.map:
            self._feeders[sources.map.name].append(self._feed_map)
        for camera in sources.cameras:
            looks = [build_head_cue(config, key, camera.name) for key in config.head_cues]
            for cue in looks:
                cue.set_scores(self.fusion.scores)
            self._cues += looks
            self._feeders[camera.image.name].append(partial(self._feed_image, camera, looks))
            if camera.info is not None:
                self._feeders[camera.info.name].append(partial(self._feed_camera, camera))
            elif camera.frame_id in config.panoramas:
                self._models[camera.frame_id] = Panorama(config.panoramas[camera.frame_id])
        for depths in sources.depth_cameras:
            self._take_depths(config, depths)
        for topic in sources.announcements:
            self._feeders[topic.name].append(self._feed_announcement)
        for topic in sources.detections:
            self._feeders[topic.name].append(self._feed_detections)
        self._own = {cue.name for cue in self._cues}
        for name in self._processing_ns:
            if name not in self._own:
                raise ConfigError(f"processing time of {name}: cues are {', '.join(sorted(self._own))}")
        self._counts: Counter = Counter()
        self._now_ns = 0
        self._turns = 0
        self._arrival_ns = 0
        self._offset_ns = sources.clock_offset_ns
        self._timeline = Timeline(self._jumped, lambda: self._arrival_ns)
        self._recorded_ns = 0  # before the last time jump
        self._first_ns = self._last_ns = 0  # stamps of scans since

    def run(self, recording: Recording, start_s: float = 0.0, duration_s: Optional[float] = None) -> None:
        """Drive a whole recording, or `duration_s` of it from `start_s` on, through.

        What was said once before the start counts: static transforms, the map, the localisation; and the transforms
        of the last seconds before it, which the first scans need.

        Raises:
            RecordingError: the recording is damaged.
        """
        sources = self._sources
        latched = [topic for topic in sources.transforms if _is_static(topic)]
        latched += [topic for topic in (sources.map, sources.localisation) if topic]
        flowing = [topic for topic in sources.transforms if not _is_static(topic)]
        flowing += [sources.odometry] if sources.odometry else []
        lead_s = min(start_s, self._lead_s)
        if start_s > lead_s:
            for recorded in recording.messages(latched, 0.0, start_s - lead_s):
                self.feed(recorded)
        if lead_s > 0.0:
            for recorded in recording.messages([*latched, *flowing], start_s - lead_s, lead_s):
                self.feed(recorded)
        cues = [*sources.scans, *sources.announcements, *sources.detections]
        for camera in sources.cameras:
            cues += [camera.info, camera.image] if camera.info else [camera.image]
        for depths in sources.depth_cameras:
            cues += [depths.info, depths.image] + ([depths.colour] if depths.colour else [])
        for recorded in recording.messages(list(dict.fromkeys([*latched, *flowing, *cues])), start_s, duration_s):
            self.feed(recorded)
        self.finish()

    def feed(self, recorded: RecordedMessage) -> None:
        """Take one message; messages come in order of arrival."""
        self._arrival_ns = recorded.arrival_ns
        self._wake_until(recorded.arrival_ns - self._offset_ns)
        message = recorded.read()
        for feeder in self._feeders[recorded.topic]:
            try:
                feeder(message)
            except DataError as error:
                self._counts[error.reason] += 1
        if len(self._waiting):
            self._serve(self._now_ns)

    def finish(self) -> None:
        """No more messages come: whoever still waits is served or given up."""
        self._serve(self._now_ns + AFTERWARDS_NS)
        self._wake_until(self._now_ns + AFTERWARDS_NS)

    def counters(self) -> Dict[str, int]:
        """Events since the start, by name."""
        return {**self._counts, **self._waiting.counters(), **self.fusion.counters()}

    @property
    def scans(self) -> int:
        """Scans that arrived."""
        return self._counts[SCANS]

    @property
    def recorded_s(self) -> float:
        """Seconds from the first scan's stamp to the last one's, what lies between time jumps added."""
        return to_seconds(self._recorded_ns + self._last_ns - self._first_ns)

    @property
    def processed(self) -> int:
        """Scans that went through."""
        return self._counts["scans processed"]

    def _feed_links(self, message: Any, is_static: bool) -> None:
        for link in conversions.links(message):
            self._feed_link(link, is_static)

    def _feed_odometry(self, message: Any) -> None:
        self._feed_link(conversions.odometry_link(message), is_static=False)

    def _feed_link(self, link: conversions.Link, is_static: bool) -> None:
        if (link.parent, link.child) in self._sources.links:
            try:
                if not is_static:
                    self._timeline.require(f"tf {link.child}", link.stamp_ns, witness=False)
                self.transforms.add(link.parent, link.child, link.stamp_ns, link.pose(), static=is_static)
            except DataError as error:
                self._counts[f"transform: {error.reason}"] += 1

    def _feed_localisation(self, message: Any) -> None:
        stamp_ns = conversions.stamp(message.header)
        self._timeline.require("localisation", stamp_ns, witness=False)
        world_from_base = conversions.uncertain_pose(message.pose)
        self.fusion.transforms.add_localisation(stamp_ns, world_from_base)
        for cue in self._cues:
            cue.set_localisation(world_from_base.covariance)

    def _feed_map(self, message: Any) -> None:
        self.grid = conversions.occupancy_grid(message)
        self.fusion.set_map(self.grid)
        for cue in self._cues:
            cue.set_map(self.grid)

    def _feed_scan(self, cue: Cue, message: Any) -> None:
        self._counts[SCANS] += 1
        scan = conversions.scan(message)
        self._feed_cue(cue, scan, SCANS)
        for other in self._cues:
            if Scan in other.notes:
                other.note(scan)

    def _feed_camera(self, camera: CameraSource, message: Any) -> None:
        self._models[camera.frame_id] = conversions.camera(message, is_rectified(camera.name))

    def _feed_image(self, camera: CameraSource, cues: Sequence[Cue], message: Any) -> None:
        self._counts[IMAGES] += 1
        if camera.frame_id not in self._models:
            raise DataError("image before its camera_info")
        image = conversions.image(message, self._models[camera.frame_id])
        for cue in cues:
            if cue.wants(image.stamp_ns):
                self._feed_cue(cue, image, IMAGES)

    def _take_depths(self, config: FusionConfig, source: DepthSource) -> None:
        """Cues of a depth camera, and where their messages go."""
        camera = DepthCamera(source)
        cues = [build_rgbd_cue(config, key, source.name) for key in config.rgbd_cues]
        self._cues += cues
        self._depth_cameras.update({cue.name: camera for cue in cues})
        self._feeders[source.info.name].append(camera.calibrate)
        self._feeders[source.image.name].append(partial(self._feed_depths, camera, cues))
        if source.colour is not None and any(getattr(each, "colour", False) for each in config.rgbd_cues.values()):
            self._feeders[source.colour.name].append(camera.keep_colour)

    def _feed_depths(self, camera: DepthCamera, cues: Sequence[Cue], message: Any) -> None:
        self._counts[DEPTHS] += 1
        image = camera.image(message)
        for cue in cues:
            self._feed_cue(cue, image, DEPTHS)

    def _coloured(self, cue: Cue, image: DepthImage) -> DepthImage:
        try:
            return self._depth_cameras[cue.name].coloured(image)
        except DataError as error:
            self._counts[error.reason] += 1
            return image

    def _feed_cue(self, cue: Cue, data: Union[Scan, Image, DepthImage], kind: str) -> None:
        self._timeline.require(cue.name, data.stamp_ns)
        newest_ns = self._timeline.newest_ns(cue.name)
        self._wake_until(newest_ns)  # the bag's clock may be slower than the stamps
        if kind == SCANS:
            self._first_ns = min(self._first_ns or newest_ns, newest_ns)
            self._last_ns = max(self._last_ns, newest_ns)
        requests = {TransformRequest(self.fusion.tracking_frame, data.frame_id, data.stamp_ns)}
        if self._sources.links:
            requests.update(cue.transforms_needed(data))
        newest_first = sorted(requests, key=lambda request: (-request.stamp_ns, request))
        announcement = cue.announce(data.stamp_ns)
        self._announce(announcement)
        waiting = _Waiting(announcement, newest_first, partial(self._measure, cue, data), kind)
        self._waiting.push(cue.name, data.stamp_ns, waiting, self._now_ns)

    def _measure(self, cue: Cue, data: Union[Scan, Image, DepthImage]) -> Measurement:
        if cue.takes is Image:
            cue.set_tracks(self.fusion.tracks())
        if isinstance(data, DepthImage):
            data = self._coloured(cue, data)
        return cue.measure(data, self.transforms if self._sources.links else None)

    def _feed_announcement(self, message: Any) -> None:
        announcement = conversions.announcement(message)
        if announcement.cue not in self._own:
            self._timeline.require(f"announcements of {announcement.cue}", announcement.stamp_ns, witness=False)
            self._announce(announcement)

    def _feed_detections(self, message: Any) -> None:
        measurement = conversions.measurement(message)
        if measurement.cue in self._own:
            return
        self._timeline.require(measurement.cue, measurement.stamp_ns)
        self._wake_until(self._timeline.newest_ns(measurement.cue))
        announcement = Announcement(measurement.stamp_ns, measurement.cue, measurement.sequence)
        request = TransformRequest(self.fusion.tracking_frame, measurement.frame_id, measurement.stamp_ns)
        waiting = _Waiting(announcement, (request,), lambda: measurement, RECORDED)
        self._waiting.push(measurement.cue, measurement.stamp_ns, waiting, self._now_ns)

    def _jumped(self, back_s: float) -> None:
        self._counts["time jumps"] += 1
        self._waiting.reset()
        if self._deliveries:
            self._counts["time jumped while a cue was at work"] += len(self._deliveries)
        self._deliveries.clear()
        self._free_ns.clear()
        self.transforms.reset(keep_static=True)
        self.fusion.reset()
        for cue in self._cues:
            cue.reset()
        for camera in self._depth_cameras.values():
            camera.reset()
        self._offset_ns += from_seconds(back_s)
        self._now_ns = self._arrival_ns - self._offset_ns
        self._recorded_ns += self._last_ns - self._first_ns
        self._first_ns = self._last_ns = 0

    def _is_ready(self, waiting: _Waiting) -> bool:
        return all(
            transforms_ready(self.transforms, request.target_frame, request.source_frame, (request.stamp_ns,))
            for request in waiting.requests
        )

    def _serve(self, now_ns: int) -> None:
        for waiting in self._waiting.poll(now_ns):
            announcement = waiting.announcement
            processing_ns = self._processing_ns.get(announcement.cue, 0) if waiting.kind != RECORDED else 0
            begin_ns = max(self._now_ns, self._free_ns.get(announcement.cue, 0))
            if begin_ns - self._now_ns > processing_ns:
                self._counts[f"{waiting.kind} skipped: the cue is busy"] += 1
                self._withdraw(waiting)
                continue
            began_s = self._seconds()
            try:
                measurement = dataclasses.replace(waiting.measure(), sequence=announcement.sequence)
            except DataError as error:
                self._counts[error.reason] += 1
                self._withdraw(waiting)
            except TransformUnavailable:
                self._counts["transform unavailable"] += 1
                self._withdraw(waiting)
            except NotLooked:
                self._counts[f"{waiting.kind} without a look"] += 1
                self._withdraw(waiting)
            else:
                self._worked(announcement.cue, began_s)
                self._free_ns[announcement.cue] = begin_ns + processing_ns
                if processing_ns == 0:
                    self._deliver(waiting, measurement)
                else:
                    self._turns += 1
                    heapq.heappush(self._deliveries, (begin_ns + processing_ns, self._turns, waiting, measurement))

    def _deliver(self, waiting: _Waiting, measurement: Measurement) -> None:
        try:
            self._push(measurement)
        except TransformUnavailable:
            self._counts["transform unavailable"] += 1
            self._withdraw(waiting)
        else:
            self._counts[RECORDED if waiting.kind == RECORDED else f"{waiting.kind} processed"] += 1
            self._measured(measurement, self._now_ns + self._offset_ns)

    def _withdraw(self, waiting: _Waiting) -> None:
        self._push(waiting.announcement._replace(withdrawn=True))

    def _wake_until(self, now_ns: int) -> None:
        """Let time pass: cues deliver, and what waits in the buffer goes when it is due."""
        while True:
            sleep_ns = self.fusion.buffer.sleep_ns(self._now_ns)
            due_ns = None if sleep_ns is None else self._now_ns + sleep_ns
            if self._deliveries and (due_ns is None or self._deliveries[0][0] < due_ns):
                due_ns = self._deliveries[0][0]
            if due_ns is None or due_ns > now_ns:
                break
            self._pass(due_ns)
            if self._deliveries and self._deliveries[0][0] <= due_ns:
                _, _, waiting, measurement = heapq.heappop(self._deliveries)
                self._deliver(waiting, measurement)
            else:
                self._process(self.fusion.poll(self._now_ns))
        self._pass(max(self._now_ns, now_ns))

    def _pass(self, now_ns: int) -> None:
        self._passing(now_ns)
        self._now_ns = now_ns

    def _announce(self, announcement: Announcement) -> None:
        if not announcement.withdrawn:
            self._told(announcement)
        self._push(announcement)

    def _push(self, item: Union[Announcement, Measurement]) -> None:
        self._process(self.fusion.push(item, self._now_ns))

    def _process(self, measurements: Iterable[Measurement]) -> None:
        for measurement in measurements:
            self._before(measurement.stamp_ns)
            began_s = self._seconds()
            changed = self.fusion.process(measurement)
            if self._clock is not None:
                _ = self.fusion.tracker  # which processes when it is asked for
            self._worked(TRACKER, began_s)
            self._after(Update(measurement, changed, self._now_ns + self._offset_ns))

    def _seconds(self) -> float:
        return 0.0 if self._clock is None else self._clock()

    def _worked(self, name: str, began_s: float) -> None:
        if self._clock is not None:
            done = self.work.get(name, Work())
            self.work[name] = Work(done.times + 1, done.seconds + self._clock() - began_s)


def build_cue(config: FusionConfig, topic: str) -> Cue:
    """The preset's cue for a topic of scans."""
    return CUES.build(config.leg_cue, name=topic.strip("/"), frames=config.frames)


def build_head_cue(config: FusionConfig, key: str, topic: str) -> Cue:
    """One of the preset's head cues for a camera's topic."""
    return CUES.build(config.head_cues[key], name=f"{topic.strip('/')}/{key}", frames=config.frames)


def build_rgbd_cue(config: FusionConfig, key: str, topic: str) -> Cue:
    """One of the preset's RGB-D cues for a depth camera's topic."""
    return CUES.build(config.rgbd_cues[key], name=f"{topic.strip('/')}/{key}", frames=config.frames)


def _is_static(topic: Topic) -> bool:
    return topic.name.endswith("tf_static")
