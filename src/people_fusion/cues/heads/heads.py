"""People in images: a detector's boxes as heads in space, each with an honest covariance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, Optional, Tuple

import numpy as np

from people_fusion.core.config import component, parameter, section
from people_fusion.core.errors import ConfigError, NotLooked, TransformUnavailable
from people_fusion.core.images import Image
from people_fusion.core.measurements import XYZ_OBSERVED, Measurement
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import NANOSECONDS
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.cue import CUES, Cue, TransformRequest
from people_fusion.cues.heads.boxes import Boxes
from people_fusion.cues.heads.detector import DETECTORS, Search
from people_fusion.cues.heads.detectors.fhog_head import FhogHeadConfig
from people_fusion.cues.heads.people import SLACK, Heads, ground_search, heads_of_boxes, search_around
from people_fusion.cues.heads.ranges import Ranges, RangesConfig
from people_fusion.cues.periods import Periods

UNKNOWN_PERIOD_S = 0.1
EARLY = 0.9  # of its period an image may come, and be taken
AT_REST_M, AT_REST_RAD = 2e-3, 2e-3  # between two images
ACCELERATION_STD = 1.0  # of people, m/s^2, until the image


@dataclass(frozen=True)
class HeadCueConfig:
    """How people are found in an image."""

    detector: object = component(DETECTORS, FhogHeadConfig, "what looks for people, or parts of them")
    min_confidence: float = parameter(0.3, "finds that are less sure are not told", 0.0, 1.0)
    min_range: float = parameter(0.6, "nearest people, along the floor, metres", low=0.1)
    max_range: float = parameter(8.0, "farthest people, along the floor, metres", low=0.2)
    head_heights: Tuple[float, float] = parameter(
        (0.9, 2.1), "of heads over the floor, sitting or standing; what is elsewhere is no person, metres"
    )
    by_ground: bool = parameter(True, "look only where people on the floor may be seen, in their size")
    full_every: int = parameter(
        1, "of so many images one is searched whole, the others only around tracks; 0: only around tracks", low=0
    )

    max_rate: float = parameter(0.0, "images a second that are looked at, others are passed over; 0: all", low=0.0)
    ranges: RangesConfig = section(RangesConfig, "distances by other sensors than the camera")

    def __post_init__(self) -> None:
        if self.max_range <= self.min_range:
            raise ConfigError(f"max_range: {self.max_range} is not beyond min_range, {self.min_range}")
        if self.head_heights[0] >= self.head_heights[1]:
            raise ConfigError(f"head_heights: expected two heights, the lower first, got {list(self.head_heights)}")


class Look(NamedTuple):
    """What was done with one image, for those who want to see it.

    Attributes:
        search: where was looked.
        boxes: all finds.
        heads: those of the boxes, in level axes from the camera.
        kept: (N,) which of the boxes are people as far as the cue can tell.
    """

    search: Search
    boxes: Boxes
    heads: Heads
    kept: np.ndarray


@CUES.register("heads", HeadCueConfig)
class HeadCue(Cue):
    """One detector on one camera's images.

    Attributes:
        look: what was done with the last image, or None.
    """

    takes: type = Image

    def __init__(self, config: HeadCueConfig, name: str, frames: FramesConfig) -> None:
        self.config, self.name, self.frames = config, name, frames
        self.look: Optional[Look] = None
        self._detector = DETECTORS.build(config.detector)
        self.modality = self._detector.part
        self._ranges = Ranges(config.ranges)
        self.notes = (Scan,) if config.ranges.scans else ()
        self._periods = Periods()
        self._tracks: Optional[Tracks] = None
        self._last_pose: Optional[Pose] = None
        self._since_full = 0
        self._taken_ns: Optional[int] = None
        self._sequence = 0

    def wants(self, stamp_ns: int) -> bool:
        """See Cue."""
        rate = self.config.max_rate
        if rate and self._taken_ns is not None and 0 <= stamp_ns - self._taken_ns < EARLY * NANOSECONDS / rate:
            return False
        self._taken_ns = stamp_ns
        return True

    def set_tracks(self, tracks: Tracks) -> None:
        """See Cue."""
        self._tracks = tracks

    def note(self, data: Scan) -> None:
        """See Cue."""
        self._ranges.note(data)

    def set_scores(self, wanted: str) -> None:
        """See Cue; of a detector that has no scores there are none."""
        self._detector.wanted_scores = wanted

    def reset(self) -> None:
        """See Cue."""
        self._periods.reset()
        self._ranges.reset()
        self._detector.reset()
        self._tracks = self._last_pose = self._taken_ns = self.look = None
        self._since_full = 0

    def transforms_needed(self, data: Image) -> Tuple[TransformRequest, ...]:
        """See Cue."""
        return (TransformRequest(self.frames.odom or self.frames.world, data.frame_id, data.stamp_ns),)

    def measure(self, data: Image, transforms: Optional[TransformSource]) -> Measurement:
        """See Cue; without transforms nobody knows which way is up."""
        if transforms is None:
            raise TransformUnavailable(f"{self.name}: a camera's place on the robot comes from tf", may_arrive=False)
        (request,) = self.transforms_needed(data)
        level_from_camera = transforms.lookup(*request)
        rotation, height = level_from_camera.rotation, float(level_from_camera.translation[2])
        moves = self._detector.needs_rest and not self._rests(level_from_camera)
        if moves:
            self._detector.reset()
        search = self._search(data, transforms, rotation, height)
        boxes = self._detector.detect(data, search)
        if moves:
            self.look = None
            raise NotLooked(f"{self.name}: the camera moves")
        heads = heads_of_boxes(boxes.corners, data.camera, rotation, self._detector.box, boxes.confidences)
        kept = self._plausible(boxes, heads, height)
        if self.notes:
            fixed, stamp_ns = request.target_frame, data.stamp_ns
            heads = self._ranges.refined(heads, kept, level_from_camera, fixed, stamp_ns, transforms)
        self.look = Look(search, boxes, heads, kept)
        self._sequence += 1
        return Measurement(
            stamp_ns=data.stamp_ns,
            cue=self.name,
            modality=self.modality,
            frame_id=data.frame_id,
            positions=heads.positions[kept] @ rotation,
            covariances=rotation.T @ heads.covariances[kept] @ rotation,
            confidences=boxes.confidences[kept],
            observed=XYZ_OBSERVED,
            period_s=self._periods.note(data.stamp_ns) or UNKNOWN_PERIOD_S,
            sequence=self._sequence,
            scores=self._detector.scores(data, boxes.take(kept)),
        )

    def _search(self, image: Image, transforms: TransformSource, rotation: np.ndarray, height: float) -> Search:
        """Where to look: around the tracks, or wherever people on the floor can be seen, or everywhere."""
        config, box = self.config, self._detector.box
        only_tracks = config.full_every == 0 or self._since_full + 1 < config.full_every
        around = self._around_tracks(image, transforms) if only_tracks else None
        if around is not None:
            self._since_full += 1
            return around
        self._since_full = 0
        ranges = (config.min_range, config.max_range)
        if not config.by_ground:
            rows = image.camera.height
            return Search.everywhere(image, max(box.height / config.max_range * _rows_per_radian(image), 1.0), rows)
        return ground_search(image.camera, rotation, height, box, config.head_heights, ranges)

    def _around_tracks(self, image: Image, transforms: TransformSource) -> Optional[Search]:
        """Where the people are that the tracker believes in; None where that cannot be told."""
        tracks = self._tracks
        if tracks is None:
            return None
        try:
            level = transforms.lookup(tracks.frame_id, image.frame_id, image.stamp_ns)
        except TransformUnavailable:
            return None
        elapsed_s = (image.stamp_ns - tracks.stamp_ns) / 1e9
        heads = tracks.means[:, :3].copy()
        heads[:, :2] += elapsed_s * tracks.means[:, 3:5]
        covariances = tracks.covariances[:, :3, :3] + elapsed_s**2 * np.diag([1.0, 1.0, 0.0]) * ACCELERATION_STD**2
        rotation = level.rotation
        return search_around(heads - level.translation, covariances, image.camera, rotation, self._detector.box)

    def _plausible(self, boxes: Boxes, heads: Heads, camera_height: float) -> np.ndarray:
        """(N,) heads at a height and a distance at which people have theirs."""
        config = self.config
        low, high = config.head_heights
        over_floor = heads.positions[:, 2] + camera_height
        distances = np.hypot(heads.positions[:, 0], heads.positions[:, 1])
        with np.errstate(invalid="ignore"):
            slack = SLACK * np.sqrt(heads.covariances[:, 2, 2])
            relative = 1.0 + SLACK * self._detector.box.height_std / self._detector.box.height
            fits = (over_floor + slack >= low) & (over_floor - slack <= high)
            fits &= (distances * relative >= config.min_range) & (distances <= config.max_range * relative)
        return np.asarray(fits & (boxes.confidences >= config.min_confidence))

    def _rests(self, pose: Pose) -> bool:
        """Whether the camera stands where it stood for the last image."""
        last, self._last_pose = self._last_pose, pose
        if last is None:
            return False
        moved = last.inverse() @ pose
        turned = np.arccos(np.clip(0.5 * (np.trace(moved.rotation) - 1.0), -1.0, 1.0))
        return bool(np.linalg.norm(moved.translation) < AT_REST_M and turned < AT_REST_RAD)


def _rows_per_radian(image: Image) -> float:
    """At the middle of the image."""
    middle = np.array([[0.5 * (image.camera.width - 1), 0.5 * (image.camera.height - 1)]])
    return float(1.0 / np.linalg.norm(image.camera.ray_jacobians(middle)[0, :, 1]))
