"""What to take of a recording that nobody has described: scans, frames, map, localisation and ground truth."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass
from statistics import median
from typing import Any, Dict, FrozenSet, List, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.errors import RecordingError
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.core.transforms import FramesConfig, normalise_frame
from people_fusion.replay.cameras import CameraSource, DepthSource, find_cameras, find_depth_cameras
from people_fusion.replay.conversions import links, odometry_link, stamp
from people_fusion.replay.recording import Recording, Topic

SAMPLE = 30  # messages of a topic that are looked at
TRUTH_WORDS = ("truth", "annotat")
TRUTH_KINDS = ("TrackedPersons", "PersonArray", "People", "Person")
OWN_OUTPUT = "people_fusion/"
BASES = ("base_link", "base_footprint")
SAME_INSTANT_NS = from_seconds(0.001)
SAME_CLOCK_NS = from_seconds(1.0)
NOTABLE_OFFSET_NS = from_seconds(0.1)


@dataclass(frozen=True)
class Sources:
    """What a replay takes of a recording.

    Attributes:
        scans: topics of the scanners, one per scanner.
        transforms: topics of tf.
        odometry: stands in for the transform odom to base that tf lacks, or None.
        localisation: poses of the base in the world frame, or None.
        map: of the world, or None.
        ground_truth: annotated people, or None.
        cameras: whose images head cues work on.
        depth_cameras: whose images RGB-D cues work on.
        announcements, detections: topics of cues that were recorded, beside those that work on the scans.
        frames: world, odometry and base of this recording; `odom` is empty where there is none.
        links: (parent, child) of the transforms between these frames and the scanners.
        clock_offset_ns: bag time minus header time that is not latency but two clocks.
        notes: what was taken and why, one line each.
    """

    scans: Tuple[Topic, ...]
    transforms: Tuple[Topic, ...]
    odometry: Optional[Topic]
    localisation: Optional[Topic]
    map: Optional[Topic]
    ground_truth: Optional[Topic]
    frames: FramesConfig
    links: FrozenSet[Tuple[str, str]]
    clock_offset_ns: int
    notes: Tuple[str, ...]
    announcements: Tuple[Topic, ...] = ()
    detections: Tuple[Topic, ...] = ()
    cameras: Tuple[CameraSource, ...] = ()
    depth_cameras: Tuple[DepthSource, ...] = ()


@dataclass(frozen=True)
class _Scanner:
    topic: Topic
    frame_id: str
    beams: int
    delays_ns: Tuple[int, ...]  # bag time minus header time
    annotated: float = 0.0  # share of the scans and annotations that belong to each other

    @property
    def rank(self) -> Tuple[float, int, int, str]:
        """Of topics in one frame the annotated scan comes first, then the raw one: the soonest, the most frequent."""
        delay = round(median(self.delays_ns) / from_seconds(0.02))
        return (-round(self.annotated, 1), delay, -self.topic.count, self.topic.name)


def discover(
    recording: Recording,
    frames: FramesConfig,
    scan_topics: Sequence[str] = (),
    world_frame: Optional[str] = None,
    ground_truth: Optional[str] = None,
    odometry: Optional[str] = None,
    images: bool = False,
    depths: bool = False,
    described: FrozenSet[str] = frozenset(),
) -> Sources:
    """Find what a replay needs.

    Args:
        recording: the bag.
        frames: names to prefer, of the preset.
        scan_topics: scans to take; empty: one per scanner frame that is connected with the world.
        world_frame: frame of the tracks; None: `frames.world`, else `frames.odom`, else the root of the scanner's tree.
        ground_truth: topic of annotated people; None: found by name and type.
        odometry: topic that stands in for a transform odom to base that tf lacks; None: found by type, "": none.
        images: whether cameras are wanted.
        depths: whether depth cameras are.
        described: frames of cameras that need no CameraInfo.

    Raises:
        RecordingError: a topic or frame that was asked for is not there, or nothing is there to work on.
    """
    transforms = recording.of_kind("TFMessage", "tfMessage")
    parents = _parents(recording, transforms)
    truth = find_ground_truth(recording, ground_truth)
    scanners = _with_annotations(recording, _scanners(recording, scan_topics), truth)
    wheels, odometry_notes = _odometry(recording, scanners, parents, odometry)
    chosen, chain, notes = _connected(recording, scanners, parents, frames, world_frame, bool(scan_topics))
    found = _frames(chain, frames, world_frame)
    detections = recording.of_kind("DetectedPersons")
    carried = {scanner.frame_id for scanner in chosen}
    on_robot = frozenset(name for name in parents if _ancestors(name, parents)[-1] == chain[-1])
    cameras, camera_notes = find_cameras(recording, on_robot, described) if images else ([], [])
    depth_cameras, depth_notes = find_depth_cameras(recording, on_robot) if depths else ([], [])
    carried.update(camera.frame_id for camera in cameras)
    carried.update(camera.frame_id for camera in depth_cameras)
    if detections:
        carried.update(on_robot)
    needed: Dict[str, List[str]] = {name: _ancestors(name, parents) for name in carried}
    pairs = frozenset(pair for line in needed.values() for pair in zip(line[1:], line))
    connected = {name for line in needed.values() for name in line}
    grid = _map(recording, connected)
    localisation = _localisation(recording, found.world)
    offset_ns = _clock_offset([delay for scanner in chosen for delay in scanner.delays_ns])
    notes = [
        *(f"scan {scanner.topic.name}: {scanner.beams} beams in {scanner.frame_id}" for scanner in chosen),
        *notes,
        *(f"images {camera.image.name} of {camera.frame_id}" for camera in cameras),
        *camera_notes,
        *(f"depths {camera.image.name} of {camera.frame_id}" for camera in depth_cameras),
        *depth_notes,
        *(f"detections {topic.name}, but of cues that work on these scans" for topic in detections),
        *odometry_notes,
        f"frames: world {found.world}, odometry {found.odom or 'none'}, base {found.base}",
        f"localisation {localisation.name}" if localisation else "no localisation: the robot's pose is taken as exact",
        f"map {grid.name}" if grid else "no map that is connected with the scanners",
        f"ground truth {truth.name} ({truth.type})" if truth else "no ground truth",
    ]
    if abs(offset_ns) > NOTABLE_OFFSET_NS:
        notes.append(f"the bag's clock is {to_seconds(offset_ns):+.3f} s off the stamps; the stamps are taken")
    return Sources(
        scans=tuple(scanner.topic for scanner in chosen),
        transforms=tuple(transforms) if pairs else (),
        odometry=wheels if pairs else None,
        localisation=localisation,
        map=grid,
        ground_truth=truth,
        frames=found,
        links=pairs,
        clock_offset_ns=offset_ns,
        notes=tuple(notes),
        announcements=tuple(recording.of_kind("MeasurementAnnouncement")) if detections else (),
        detections=tuple(detections),
        cameras=tuple(cameras),
        depth_cameras=tuple(depth_cameras),
    )


def _parents(recording: Recording, transforms: Sequence[Topic]) -> Dict[str, str]:
    """Parent of each frame, the last one told."""
    parents: Dict[str, str] = {}
    for recorded in recording.messages(transforms):
        for link in links(recorded.read()):
            parents[link.child] = link.parent
    return parents


def _odometry(
    recording: Recording, scanners: Sequence[_Scanner], parents: Dict[str, str], name: Optional[str]
) -> Tuple[Optional[Topic], List[str]]:
    """Odometry that carries a scanner whose base tf does not place; its link is added to the parents. And notes."""
    if name == "":
        return None, []
    topics = [recording.topic(name)] if name is not None else recording.of_kind("Odometry")
    carrying = {frame for scanner in scanners for frame in _ancestors(scanner.frame_id, parents)}
    for topic in sorted(topics, key=lambda topic: -topic.count):
        if topic.kind != "Odometry":
            raise RecordingError(f"{recording.path}: {topic.name} is not Odometry but a {topic.type}")
        link = odometry_link(_sample(recording, topic)[0][1])
        if link.parent and link.child in carrying and link.child not in parents and link.parent not in carrying:
            parents[link.child] = link.parent
            return topic, [f"odometry {topic.name} stands in for {link.parent} to {link.child}, which tf lacks"]
    return None, [] if name is None else [f"odometry {name} is left out: tf places its base, or no scanner is on it"]


def _ancestors(name: str, parents: Dict[str, str]) -> List[str]:
    """The frame itself, its parent and so on to the root."""
    line = [name]
    while line[-1] in parents and parents[line[-1]] not in line:
        line.append(parents[line[-1]])
    return line


def _sample(recording: Recording, topic: Topic) -> List[Tuple[int, Any]]:
    return [(m.arrival_ns, m.read()) for m in itertools.islice(recording.messages([topic]), SAMPLE)]


def _scanners(recording: Recording, names: Sequence[str]) -> List[_Scanner]:
    topics = [recording.topic(name) for name in names] if names else recording.of_kind("LaserScan")
    scanners = []
    for topic in topics:
        if topic.kind != "LaserScan":
            raise RecordingError(f"{recording.path}: {topic.name} is not a LaserScan but a {topic.type}")
        sample = _sample(recording, topic)
        if sample:
            first = sample[0][1]
            delays = tuple(arrival_ns - stamp(message.header) for arrival_ns, message in sample)
            scanners.append(_Scanner(topic, normalise_frame(first.header.frame_id), len(first.ranges), delays))
    if not scanners:
        there = ", ".join(f"{topic.name} ({topic.type})" for topic in recording.topics)
        raise RecordingError(f"{recording.path}: no laser scans in this recording; there are {there}")
    return scanners


def _with_annotations(
    recording: Recording, scanners: List[_Scanner], truth: Optional[Topic]
) -> List[_Scanner]:
    """The scanners with the share of their scans that something is annotated in; annotations are poses of legs, too.

    An annotation belongs to the scan of its stamp, or where it has none, of its arrival.
    """
    labels = [truth] if truth is not None else recording.of_kind("PoseArray")
    if len(scanners) < 2 or not labels:
        return scanners
    stamped: List[int] = []
    unstamped: List[int] = []
    for recorded in recording.messages(labels):
        header = getattr(recorded.read(), "header", None)
        stamp_ns = stamp(header) if header is not None else 0
        (stamped if stamp_ns else unstamped).append(stamp_ns or recorded.arrival_ns)
    told = []
    for scanner in scanners:
        times = np.array([(stamp(m.read().header), m.arrival_ns) for m in recording.messages([scanner.topic])])
        shared = _count_near(stamped, times[:, 0]) + _count_near(unstamped, times[:, 1])
        either = len(stamped) + len(unstamped) + len(times) - shared
        told.append(dataclasses.replace(scanner, annotated=shared / either))
    return told


def _count_near(instants_ns: Sequence[int], times_ns: np.ndarray) -> int:
    """How many of the instants are among the times."""
    times_ns, at_ns = np.sort(times_ns), np.array(instants_ns, dtype=np.int64)
    first = np.searchsorted(times_ns, at_ns - SAME_INSTANT_NS)
    return int(np.sum(np.searchsorted(times_ns, at_ns + SAME_INSTANT_NS, side="right") > first))


def _connected(
    recording: Recording,
    scanners: Sequence[_Scanner],
    parents: Dict[str, str],
    frames: FramesConfig,
    world_frame: Optional[str],
    by_name: bool,
) -> Tuple[List[_Scanner], List[str], List[str]]:
    """Scanners that share a tree with the world, the frames from the first of them to the root, and notes."""
    worlds = [normalise_frame(world_frame)] if world_frame is not None else [frames.world, frames.odom]
    lines = {scanner.frame_id: _ancestors(scanner.frame_id, parents) for scanner in scanners}
    ranked = sorted(scanners, key=lambda scanner: scanner.rank)
    for world in worlds:
        within = [scanner for scanner in ranked if world in lines[scanner.frame_id]]
        if within:
            break
    else:
        if world_frame is not None:
            there = ", ".join(sorted({name for line in lines.values() for name in line}))
            raise RecordingError(f"{recording.path}: no frame {world_frame} above the scanners; there are {there}")
        most = max(ranked, key=lambda scanner: (-scanner.rank[0], scanner.topic.count, -ranked.index(scanner)))
        root = lines[most.frame_id][-1]
        within = [scanner for scanner in ranked if lines[scanner.frame_id][-1] == root]
    chosen: Dict[str, _Scanner] = {}
    notes = []
    for scanner in within:
        key = scanner.topic.name if by_name else scanner.frame_id
        if key in chosen:
            taken = chosen[key]
            why = ", to which the annotations belong" if taken.rank[0] < scanner.rank[0] else ""
            notes.append(f"scan {scanner.topic.name} is left out: it is of the scanner of {taken.topic.name}{why}")
        else:
            chosen[key] = scanner
    for scanner in ranked:
        if scanner not in within:
            if by_name:
                raise RecordingError(
                    f"{recording.path}: no transform connects {scanner.frame_id} of {scanner.topic.name} with "
                    f"{within[0].frame_id} of {within[0].topic.name}"
                )
            notes.append(f"scan {scanner.topic.name} is left out: no transform connects {scanner.frame_id}")
    by_topic = sorted(chosen.values(), key=lambda scanner: scanner.topic.name)
    return by_topic, lines[within[0].frame_id], notes


def _frames(chain: Sequence[str], frames: FramesConfig, world_frame: Optional[str]) -> FramesConfig:
    """Names of the frames on the way from a scanner to the root."""
    if world_frame is not None:
        world = normalise_frame(world_frame)
    else:
        world = next((name for name in (frames.world, frames.odom) if name in chain), chain[-1])
    below = list(chain[: chain.index(world) + 1])  # scanner ... world
    odom = frames.odom if frames.odom in below else ""
    top = below.index(odom or world)
    named = [name for name in (frames.base, *BASES) if name in below]
    base = named[0] if named else below[max(top - 1, 0)]
    return FramesConfig(world=world, odom=odom, base=base)


def _map(recording: Recording, connected: Any) -> Optional[Topic]:
    """A map whose frame is connected with a scanner; costmaps are no maps."""
    for topic in recording.of_kind("OccupancyGrid"):
        first = _sample(recording, topic)[0][1]
        if "costmap" not in topic.name and normalise_frame(first.header.frame_id) in connected:
            return topic
    return None


def _localisation(recording: Recording, world: str) -> Optional[Topic]:
    candidates = []
    for topic in recording.of_kind("PoseWithCovarianceStamped"):
        first = _sample(recording, topic)[0][1]
        if normalise_frame(first.header.frame_id) == world and not topic.name.endswith("initialpose"):
            candidates.append(topic)
    return max(candidates, key=lambda topic: topic.count, default=None)


def find_ground_truth(recording: Recording, name: Optional[str] = None) -> Optional[Topic]:
    """Topic of annotated people: the one asked for, else one that is called so, else one of a type for people.

    Raises:
        RecordingError: the topic that was asked for is not there.
    """
    if name is not None:
        return recording.topic(name)
    topics = [topic for topic in recording.topics if topic.count]
    hinted = [t for t in topics if any(word in t.name for word in TRUTH_WORDS)]
    typed = [t for t in topics if t.kind in TRUTH_KINDS and OWN_OUTPUT not in t.name]
    both = [topic for topic in hinted if topic in typed or topic.kind == "PoseArray"]
    return next(iter(both or typed), None)


def _clock_offset(delays_ns: Sequence[int]) -> int:
    """Difference of the two clocks; up to a second it is latency of the messages, which replay keeps."""
    least = min(delays_ns)
    return 0 if 0 <= least < SAME_CLOCK_NS else least
