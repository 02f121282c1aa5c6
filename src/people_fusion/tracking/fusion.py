"""The whole path from measurements in sensor frames to tracks in the world: transforms, buffer, tracker.

The same object runs in the tracker node, in the composed node, in a replay and in tests.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple, Union

import numpy as np

from people_fusion.core.camera_models import PanoramaConfig
from people_fusion.core.config import component, components, load_yaml, merge, parameter, parse, section
from people_fusion.core.depth_images import DepthImage
from people_fusion.core.errors import ConfigError, TransformUnavailable
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.head_scores import HeadScores
from people_fusion.core.images import Image
from people_fusion.core.measurements import Announcement, Measurement, Sight
from people_fusion.core.poses import Pose
from people_fusion.core.resources import directory
from people_fusion.core.scans import Scan
from people_fusion.core.tracks import Legs, Particles, Tracks
from people_fusion.core.transforms import (
    FramesConfig,
    TransformsConfig,
    TransformSource,
    UncertainTransform,
    UncertainTransforms,
)
from people_fusion.cues.cue import CUES
from people_fusion.cues.legs.legs import LegCueConfig
from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.buffers.reprocess import ReprocessConfig
from people_fusion.tracking.rewind import Rewind
from people_fusion.tracking.tracker import TRACKERS, Tracker
from people_fusion.tracking.trackers.kalman import KalmanConfig

OPTICAL_BELOW = math.cos(math.radians(45.0))  # cosine between a frame's z and the vertical: what looks along z
TREATMENTS = ("output", "white", "consider", "none")


@dataclass(frozen=True)
class FusionConfig:
    """A preset: everything between sensor messages and tracks."""

    frames: FramesConfig = section(FramesConfig, "names of the robot's frames")
    transforms: TransformsConfig = section(TransformsConfig, "uncertainty of the transforms")
    localisation: str = parameter(
        "output",
        "where the localisation's error goes: `output`: track in the odometry frame, add it on output; `white`: into "
        "each measurement as if it were fresh; `consider`: a Schmidt-Kalman state; `none`: nowhere",
        choices=TREATMENTS,
    )
    leg_cue: object = component(CUES, LegCueConfig, "how legs are found in a scan")
    panoramas: Dict[str, PanoramaConfig] = parameter({}, "cameras that no CameraInfo describes, by their frame")
    head_cues: Dict[str, object] = components(CUES, "how people are found in an image, by names of your choice")
    rgbd_cues: Dict[str, object] = components(CUES, "how people are found in a depth image, by names of your choice")
    buffer: object = component(BUFFERS, ReprocessConfig, "what happens to late measurements")
    modalities: Tuple[str, ...] = parameter((), "that the tracker heeds, e.g. [face, upper_body]; empty: all")
    tracker: object = component(TRACKERS, KalmanConfig, "the tracker")

    def __post_init__(self) -> None:
        cues: List[Tuple[str, object, type]] = [("leg_cue", self.leg_cue, Scan)]
        cues += [(f"head_cues/{name}", cue, Image) for name, cue in self.head_cues.items()]
        cues += [(f"rgbd_cues/{name}", cue, DepthImage) for name, cue in self.rgbd_cues.items()]
        for path, cue, sensor in cues:
            name = CUES.name_of(cue)
            takes = CUES.class_of(name).takes
            if takes is not sensor:
                raise ConfigError(f"{path}: {name!r} takes {takes.__name__}, not {sensor.__name__}")


def load_config(preset: Union[str, Path, None] = None, overrides: Optional[Mapping[str, Any]] = None) -> FusionConfig:
    """A preset with overrides laid over it.

    Args:
        preset: YAML file, or the name of one in config/ such as "volkhardt"; None is "default".
        overrides: nested mapping.

    Raises:
        ConfigError: names the file, or the full path of the parameter that is refused.
    """
    path = Path(preset or "default")
    if not path.is_file() and path.suffix == "" and len(path.parts) == 1:
        path = directory("config") / f"{path}.yaml"
    mapping = merge(load_yaml(path) or {}, overrides or {})
    try:
        return parse(FusionConfig, mapping)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


class Fusion:
    """Measurements in, tracks out. One thread; no clock but the stamps that it is given."""

    def __init__(self, config: FusionConfig, source: TransformSource) -> None:
        self.config = _with_shared_error(config)
        self.transforms = UncertainTransforms(source, config.frames, config.transforms)
        self.buffer = BUFFERS.build(self.config.buffer)
        self._past = Rewind(TRACKERS.build(self.config.tracker), self.buffer.config)
        self._counts: Counter = Counter()
        self._world_from_tracking: Optional[UncertainTransform] = None

    @property
    def tracking_frame(self) -> str:
        """Frame that the tracker works in: locally smooth where the localisation's error is added on output."""
        frames = self.config.frames
        return frames.odom if self.config.localisation == "output" and frames.odom else frames.world

    @property
    def tracker(self) -> Tracker:
        """The tracker, with everything that was processed."""
        return self._past.tracker

    def push(self, item: Union[Announcement, Measurement], now_ns: int) -> List[Measurement]:
        """Take what a cue announces or delivers; each measurement that is handed out goes to `process`.

        Args:
            item: an announcement, or a measurement in its sensor's frame as Cue.measure gives it.
            now_ns: arrival, on the clock of the stamps.

        Returns:
            Measurements in the tracking frame that may be processed now, in order but for those that came too late.

        Raises:
            TransformUnavailable: the measurement is not taken; withdraw its announcement, which is still waited for.
        """
        if isinstance(item, Measurement) and self.config.modalities and item.modality not in self.config.modalities:
            item = Announcement(item.stamp_ns, item.cue, item.sequence, withdrawn=True)
        if isinstance(item, Measurement):
            transform = self.transforms.lookup(self.tracking_frame, item.frame_id, item.stamp_ns)
            item = place(item, transform, self.tracking_frame, self.config.localisation)
        return self.buffer.push(item, now_ns)

    def poll(self, now_ns: int) -> List[Measurement]:
        """What may be processed now that time has passed; due when BufferPolicy.sleep_ns says so."""
        return self.buffer.poll(now_ns)

    def process(self, measurement: Measurement) -> bool:
        """Process what `push` or `poll` handed out; True if the tracks changed."""
        return self._past.process(measurement)

    def preview(self, stamp_ns: Optional[int] = None) -> Tracks:
        """Tracks as `tracks` gives them, with what still waits in the buffer processed; to be revised."""
        with self._past.ahead(self.buffer.held):
            return self.tracks(stamp_ns)

    def tracks(self, stamp_ns: Optional[int] = None) -> Tracks:
        """All tracks in the world frame, at the tracker's stamp or predicted to a later one."""
        tracks = dataclasses.replace(self.tracker.tracks(stamp_ns), frame_id=self.tracking_frame)
        if self.tracking_frame == self.config.frames.world or len(tracks) == 0:
            return dataclasses.replace(tracks, frame_id=self.config.frames.world)
        if not self._find_world(tracks.stamp_ns):
            # The localisation is slower than the sensors: its newest word holds until the next.
            self._counts["tracks placed with an older localisation"] += 1
        if self._world_from_tracking is None:
            return tracks
        return move_tracks(tracks, self._world_from_tracking, self.config.frames.world)

    def legs(self) -> Optional[Legs]:
        """The legs that the tracker follows, in the frame of `tracks`; None where it follows none."""
        legs = self.tracker.legs()
        if legs is None:
            return None
        legs = dataclasses.replace(legs, frame_id=self.tracking_frame)
        if self.tracking_frame == self.config.frames.world:
            return legs
        self._find_world(legs.stamp_ns)
        if self._world_from_tracking is None:
            return legs
        return move_legs(legs, self._world_from_tracking, self.config.frames.world)

    def particles(self) -> Optional[Particles]:
        """The particles of the tracks, in the frame of `tracks`; None of a tracker that has none."""
        particles = self.tracker.particles()
        if particles is None:
            return None
        particles = dataclasses.replace(particles, frame_id=self.tracking_frame)
        if self.tracking_frame == self.config.frames.world:
            return particles
        self._find_world(particles.stamp_ns)
        if self._world_from_tracking is None:
            return particles
        pose = self._world_from_tracking.pose
        velocities = np.pad(particles.velocities, ((0, 0), (0, 0), (0, 1))) @ pose.rotation.T
        return dataclasses.replace(
            particles,
            frame_id=self.config.frames.world,
            positions=particles.positions @ pose.rotation.T + pose.translation,
            velocities=velocities[..., :2],
        )

    def _find_world(self, stamp_ns: int) -> bool:
        """Look for world_from_tracking; where it is not there yet, the last remains."""
        try:
            self._world_from_tracking = self.transforms.lookup(self.config.frames.world, self.tracking_frame, stamp_ns)
        except TransformUnavailable:
            return False
        return True

    @property
    def scores(self) -> str:
        """What head cues are to give beside detections, see Tracker."""
        return self.tracker.scores

    def set_map(self, grid: Optional[OccupancyGrid]) -> None:
        """A new map; pruning uses it where the tracker works in the map's frame."""
        self.tracker.set_map(grid if grid is not None and grid.frame_id == self.tracking_frame else None)

    def reset(self) -> None:
        """Time has jumped: forget all tracks and everything buffered; identities are not given again."""
        self.buffer.reset()
        self._past.reset()
        self.transforms.reset()
        self._world_from_tracking = None

    def counters(self) -> Dict[str, int]:
        """Events since the start, by name."""
        return {**self._counts, **self.buffer.counters(), **self._past.counters()}


def place(measurement: Measurement, transform: UncertainTransform, frame_id: str, localisation: str) -> Measurement:
    """A measurement in another frame, the slow part of the transform's error treated as `localisation` says."""
    observed = np.array(measurement.observed)
    positions, covariances, jacobians = transform.transform(measurement.positions, measurement.covariances)
    shared: Optional[np.ndarray] = transform.shared_covariance
    if localisation == "white":
        covariances = covariances + jacobians @ transform.shared_covariance @ jacobians.swapaxes(-1, -2)
    if localisation in ("white", "none") or not transform.shared_covariance.any():
        shared = None
    covariances = covariances * (observed[:, None] & observed[None, :])
    sight = measurement.sight
    if sight is not None:
        sight = _move_sight(sight, transform.pose)
    return dataclasses.replace(
        measurement,
        frame_id=frame_id,
        positions=positions,
        covariances=covariances,
        shared_jacobians=None if shared is None else jacobians,
        shared_covariance=shared,
        sight=sight,
        points=_move_flat(measurement.points, transform),
        legs=_move_flat(measurement.legs, transform),
        scores=None if measurement.scores is None else _move_scores(measurement.scores, transform),
    )


def _move_sight(sight: Sight, pose: Pose) -> Sight:
    """See Sight for the axes of planar sensors and of cameras, which are told apart by which way their z points."""
    rotation = pose.rotation
    origin = pose.apply(np.array([sight.position[0], sight.position[1], 0.0]))[:2]
    if abs(rotation[2, 2]) < OPTICAL_BELOW:
        return dataclasses.replace(sight, position=origin, yaw=math.atan2(rotation[1, 2], rotation[0, 2]))
    sense = 1 if rotation[2, 2] > 0 else -1  # a scanner on its head turns the other way
    return dataclasses.replace(
        sight,
        position=origin,
        yaw=float(pose.yaw) + sense * sight.yaw,
        angle_min=sense * sight.angle_min,
        angle_increment=sense * sight.angle_increment,
    )


def _move_scores(scores: HeadScores, transform: UncertainTransform) -> HeadScores:
    return dataclasses.replace(scores, pose=transform.pose, pose_covariance=transform.white_covariance)


def move_tracks(tracks: Tracks, transform: UncertainTransform, frame_id: str) -> Tracks:
    """Tracks in another frame with the whole error of the transform in their covariance.

    The rotation's error turns velocities as well as positions; both come from one error, so they become correlated.
    """
    size = tracks.means.shape[1]
    rotation = transform.pose.rotation
    velocities = np.zeros((len(tracks), 3))
    velocities[:, : size - 3] = tracks.means[:, 3:]
    moved = velocities @ rotation.T
    whole = np.zeros((6, 6))
    whole[:3, :3] = whole[3:, 3:] = rotation
    jacobians = np.zeros((len(tracks), 6, 6))
    none = np.zeros((len(tracks), 3, 3))
    positions, _, jacobians[:, :3] = transform.transform(tracks.means[:, :3], none)
    # d(exp([r]x) v)/dr = -[v]x
    jacobians[:, 3, 4], jacobians[:, 3, 5] = moved[:, 2], -moved[:, 1]
    jacobians[:, 4, 3], jacobians[:, 4, 5] = -moved[:, 2], moved[:, 0]
    jacobians[:, 5, 3], jacobians[:, 5, 4] = moved[:, 1], -moved[:, 0]
    error = transform.white_covariance + transform.shared_covariance
    turn, jacobians = whole[:size, :size], jacobians[:, :size]
    return dataclasses.replace(
        tracks,
        frame_id=frame_id,
        means=np.hstack([positions, moved[:, : size - 3]]),
        covariances=turn @ tracks.covariances @ turn.T + jacobians @ error @ jacobians.swapaxes(-1, -2),
    )


def move_legs(legs: Legs, transform: UncertainTransform, frame_id: str) -> Legs:
    """Legs in another frame with the whole error of the transform in their covariance."""
    positions, covariances = np.zeros((len(legs), 3)), np.zeros((len(legs), 3, 3))
    positions[:, :2], covariances[:, :2, :2] = legs.positions, legs.covariances
    positions, covariances, jacobians = transform.transform(positions, covariances)
    covariances = covariances + jacobians @ transform.shared_covariance @ jacobians.swapaxes(-1, -2)
    return dataclasses.replace(legs, frame_id=frame_id, positions=positions[:, :2], covariances=covariances[:, :2, :2])


def _move_flat(points: np.ndarray, transform: UncertainTransform) -> np.ndarray:
    """Points (N, 2) of the sensor's plane, seen from above in the other frame."""
    if len(points) == 0:
        return points
    return transform.pose.apply(np.column_stack([points, np.zeros(len(points))]))[:, :2]


def _with_shared_error(config: FusionConfig) -> FusionConfig:
    """The tracker's way with shared errors follows from the treatment of the localisation."""
    if not hasattr(config.tracker, "shared_error"):
        return config
    wanted = "consider" if config.localisation == "consider" else "add"
    tracker = dataclasses.replace(config.tracker, shared_error=wanted)  # type: ignore[type-var]
    return dataclasses.replace(config, tracker=tracker)
