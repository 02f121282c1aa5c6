"""People in depth images: heads over shoulders on the ground grid, after Munaro and Menegatti (2014)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple, Optional, Tuple

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.special import expit, ndtr

from people_fusion.core.cameras import Camera
from people_fusion.core.config import component, parameter
from people_fusion.core.depth_images import DepthImage
from people_fusion.core.errors import ConfigError, DataError, TransformUnavailable
from people_fusion.core.measurements import XYZ_OBSERVED, Bodies, Measurement
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.cue import CUES, Cue, TransformRequest
from people_fusion.cues.heads.detector import DETECTORS
from people_fusion.cues.heads.detectors.fhog_head import FhogHeadConfig
from people_fusion.cues.periods import Periods
from people_fusion.cues.rgbd.colour import ColourHeads, colour_heads
from people_fusion.cues.rgbd.floor import Floor, fit_floor
from people_fusion.cues.rgbd.free_space import free_space
from people_fusion.cues.rgbd.ground import height_map, local_maxima
from people_fusion.cues.rgbd.sensors import SENSORS
from people_fusion.cues.rgbd.upper_bodies import UpperBodies, View, measure

UNKNOWN_PERIOD_S = 0.1
ROWS = 240  # of the image that the grid is made from; more rows are passed over
# As shares of the image's height: rows at its upper edge that a registered image may lack, and what is of the edge. A
# head whose top is there may go on beyond it.
BLANK_ROWS, EDGE_ROWS = 0.06, 0.015
CUT_STD = 0.05  # of how much of it is cut off, metres
MOST_CANDIDATES = 40
TABLES = 4  # of rays that are kept: cameras change their resolution, but not often
FLOOR_EVERY = 3  # of the points
BEYOND = 0.25  # metres over the highest head that the grid is made of: what is taller is no person
SITTING_HEIGHT, SITTING_SPREAD = 1.40, 0.06  # at which as many sit as stand, and how soon that changes, metres
# Of a head's middle about where it is taken to be: along the view, across, up; metres.
HEAD_STDS = (0.019, 0.015, 0.016)
NARROWEST = 1e-3  # radians, to the sides of an image of a single column
PIXEL_STD = 0.7  # of edges, pixels
WINDOW, HEAD_AREA = 9.0, 0.02  # pixels within which depths err alike, as they are matched so; m^2 of a face
# Confidence from the scores of upper_bodies.measure, see docs/rgbd_cue.md.
LEAST = np.array([0.6, 0.5, 0.6, 0.1, 0.45, 0.6])
LEAST_OF_HEADS = np.array([0.6, 0.3, 0.6, 0.0, 0.45, 0.6])  # where the colour shows a head
PENALTIES = np.array([10.0, 8.0, 6.0, 4.0, 6.0, 6.0])  # of what is not as it should be
PERFECT = 4.5  # log odds
RARELY_BELOW, RARE_M, RARE = 1.1, 0.2, 2.5  # few heads are lower, but backs of chairs: metres, metres, log odds


@dataclass(frozen=True)
class RgbdCueConfig:
    """How people are found in a depth image."""

    sensor: str = parameter("kinect", "kind of the camera: its ranges and errors", choices=tuple(sorted(SENSORS)))
    max_range: float = parameter(6.0, "farthest people, along the floor, metres", low=0.5, high=20.0)
    head_heights: Tuple[float, float] = parameter(
        (0.9, 2.1), "of the tops of heads over the floor, sitting or standing, metres"
    )
    cell: float = parameter(0.05, "side of the ground grid's cells, metres", low=0.01, high=0.3)
    head_distance: float = parameter(0.3, "heads are at least this far apart, metres", low=0.1, high=1.0)
    head_width: Tuple[float, float] = parameter((0.08, 0.225), "of heads, as far as they are seen, metres")
    shoulder_width: Tuple[float, float] = parameter((0.14, 0.84), "of shoulders, as far as they are seen, metres")
    shoulder_over_head: float = parameter(0.025, "that shoulders are at least wider, metres", low=0.0, high=0.5)
    neck_under_head: float = parameter(0.05, "or that a neck is at least narrower, metres", low=0.0, high=0.5)
    colour: bool = parameter(False, "also look for heads in the colour image, where there is one")
    detector: object = component(DETECTORS, lambda: FhogHeadConfig(threshold=0.0), "of heads in the colour image")
    min_confidence: float = parameter(0.3, "finds that are less sure are not told", 0.0, 1.0)
    floor_height_std: float = parameter(0.05, "error of the camera's height by the transform, metres", 0.001, 1.0)
    floor_tilt_std: float = parameter(0.03, "error of the camera's tilt by the transform, radians", 0.001, 0.5)
    floor_points: int = parameter(300, "fewer points near the floor do not correct it", low=10)

    def __post_init__(self) -> None:
        for name in ("head_heights", "head_width", "shoulder_width"):
            low, high = getattr(self, name)
            if not 0.0 < low < high:
                raise ConfigError(f"{name}: expected two positive numbers, the lower first, got {[low, high]}")


class DepthLook(NamedTuple):
    """What was done with one depth image, for those who want to see it.

    Attributes:
        floor: as it was corrected, in level axes that look where the camera looks.
        level_from_camera: pose of the camera in those axes.
        candidates: all that was checked.
        confidences: (N,) of them.
        kept: indices of those that are people as far as the cue can tell.
    """

    floor: Floor
    level_from_camera: Pose
    candidates: UpperBodies
    confidences: np.ndarray
    kept: np.ndarray


class _Cloud(NamedTuple):
    """Points (N, 3) in level axes, their depths (N,), and the last row that is of the image's upper edge."""

    points: np.ndarray
    depths: np.ndarray
    edge_row: float


@CUES.register("rgbd", RgbdCueConfig)
class RgbdCue(Cue):
    """One depth camera's images.

    Attributes:
        look: what was done with the last image, or None.
    """

    takes: type = DepthImage
    modality = "rgbd"

    def __init__(self, config: RgbdCueConfig, name: str, frames: FramesConfig) -> None:
        self.config, self.name, self.frames = config, name, frames
        self.look: Optional[DepthLook] = None
        self._sensor = SENSORS[config.sensor]
        self._detector = DETECTORS.build(config.detector) if config.colour else None
        if self._detector is not None and self._detector.part != "head":
            raise ConfigError(f"rgbd_cues: {name}: the detector finds a {self._detector.part}, not a head")
        self._tables: dict = {}
        self._periods = Periods()
        self._sequence = 0

    def reset(self) -> None:
        """See Cue."""
        self._periods.reset()
        self.look = None

    def transforms_needed(self, data: DepthImage) -> Tuple[TransformRequest, ...]:
        """See Cue."""
        return (TransformRequest(self.frames.odom or self.frames.world, data.frame_id, data.stamp_ns),)

    def measure(self, data: DepthImage, transforms: Optional[TransformSource]) -> Measurement:
        """See Cue; without transforms nobody knows which way is up."""
        if transforms is None:
            raise TransformUnavailable(f"{self.name}: a camera's place on the robot comes from tf", may_arrive=False)
        depths, camera = data.depths, data.camera
        if depths.ndim != 2 or depths.shape != (camera.height, camera.width):
            raise DataError("depth image of another size than its camera's", f"{depths.shape}")
        level_from_camera = _facing(transforms.lookup(*self.transforms_needed(data)[0]))
        cloud = self._cloud(data, level_from_camera)
        floor = self._floor(cloud)
        heights = floor.heights(cloud.points)
        view = View(data, self._sensor, level_from_camera)
        tops = self._tops(cloud, heights)
        shown = self._shown(data, level_from_camera)
        tops = np.concatenate([tops, shown.tops])
        found = measure(view, tops, tops[:, 2] - floor.heights(tops))
        confidences = self._confidences(found, floor, shown.confidences)
        kept = self._distinct(found, confidences)
        self.look = DepthLook(floor, level_from_camera, found, confidences, kept)
        found = found.take(kept)
        lost_std = CUT_STD * (view.pixels(found.tops)[:, 1] < cloud.edge_row)
        positions, covariances = self._heads(found, floor, data.camera, level_from_camera, lost_std)
        self._sequence += 1
        return Measurement(
            stamp_ns=data.stamp_ns,
            cue=self.name,
            modality=self.modality,
            frame_id=data.frame_id,
            positions=positions,
            covariances=covariances,
            confidences=confidences[kept],
            observed=XYZ_OBSERVED,
            period_s=self._periods.note(data.stamp_ns) or UNKNOWN_PERIOD_S,
            sequence=self._sequence,
            bodies=self._bodies(found, floor, lost_std),
            sight=free_space(cloud.points, heights, _half_angle(camera), self.config.max_range),
        )

    def _cloud(self, image: DepthImage, level_from_camera: Pose) -> _Cloud:
        """The points of every other row and column, or so."""
        stride, table = self._table(image.camera)
        depths = image.depths[::stride, ::stride]
        valid = (depths > self._sensor.min_range) & (depths < self._sensor.max_range)  # false for NaN
        begins = min(int(valid.any(axis=1).argmax()), BLANK_ROWS * len(depths))
        taken = np.flatnonzero(valid)
        rays = table[taken] @ level_from_camera.rotation.T.astype(np.float32)
        seen = depths.ravel()[taken]
        points = rays * seen[:, None]
        points += level_from_camera.translation.astype(np.float32)
        return _Cloud(points, seen, stride * (begins + EDGE_ROWS * len(depths)))

    def _table(self, camera: Camera) -> Tuple[int, np.ndarray]:
        """Which rows and columns are looked at, and the points (N, 3) at depth 1 that these pixels see."""
        key = id(camera)
        if key not in self._tables:
            stride = max(round(camera.height / ROWS), 1)
            rows, columns = np.mgrid[0 : camera.height : stride, 0 : camera.width : stride]
            rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
            table = (rays / rays[:, 2:]).astype(np.float32)
            if len(self._tables) >= TABLES:
                self._tables.clear()
            self._tables[key] = camera, stride, table  # with the camera, so that its id stays its own
        return self._tables[key][1:]

    def _floor(self, cloud: _Cloud) -> Floor:
        config = self.config
        some = slice(None, None, FLOOR_EVERY)
        points = cloud.points[some]
        stds = self._sensor.stds(cloud.depths[some])
        return fit_floor(points, stds, config.floor_height_std, config.floor_tilt_std, config.floor_points)

    def _tops(self, cloud: _Cloud, heights: np.ndarray) -> np.ndarray:
        """(N, 3) tops of what may be people."""
        config = self.config
        low, high = config.head_heights
        rows = np.flatnonzero((heights > low - BEYOND) & (heights < high + 2.0 * BEYOND))
        if len(rows) == 0:
            return np.zeros((0, 3))
        points = cloud.points[rows]
        highest, owners = height_map(points, heights[rows], config.cell, config.max_range)
        # What is taller than people is no top, nor is what the noise tears off it.
        endless = highest > high
        highest[binary_dilation(endless, np.ones((3, 3), dtype=bool))] = 0.0
        radius = max(round(0.5 * config.head_distance / config.cell), 1)
        found = owners[local_maxima(highest, low, radius)]
        found = found[np.argsort(np.hypot(points[found, 0], points[found, 1]))][:MOST_CANDIDATES]
        return points[found].astype(float)

    def _shown(self, image: DepthImage, level_from_camera: Pose) -> ColourHeads:
        """Heads in the colour image."""
        if self._detector is None or image.colour is None:
            return ColourHeads(np.zeros((0, 3)), np.zeros(0))
        return colour_heads(self._detector, image, self._sensor, level_from_camera)

    def _confidences(self, found: UpperBodies, floor: Floor, shown: np.ndarray) -> np.ndarray:
        """(N,) that they are people; the last ones are heads in the colour image, `shown` (K,) how surely."""
        config = self.config
        heights = floor.heights(found.tops)
        heads, necks, shoulders = found.widths.T
        fits = (found.scores >= LEAST).all(axis=1)
        at_height = (heights >= config.head_heights[0]) & (heights <= config.head_heights[1])
        fits &= at_height
        fits &= (heads >= config.head_width[0]) & (heads <= config.head_width[1])
        fits &= (shoulders >= config.shoulder_width[0]) & (shoulders <= config.shoulder_width[1])
        # From the side shoulders may be no wider than the head, but then there is a neck; a post has neither.
        fits &= (shoulders >= heads + config.shoulder_over_head) | (necks <= heads - config.neck_under_head)
        lowness = np.clip((RARELY_BELOW - heights) / RARE_M, 0.0, 1.0)
        by_depth = np.where(fits, expit(PERFECT - (1.0 - found.scores) @ PENALTIES - RARE * lowness), 0.0)
        by_colour = np.zeros(len(by_depth))
        by_colour[len(by_depth) - len(shown) :] = shown
        by_colour[(found.scores < LEAST_OF_HEADS).any(axis=1) | ~at_height] = 0.0
        return np.asarray(np.maximum(by_depth, by_colour))

    def _distinct(self, found: UpperBodies, confidences: np.ndarray) -> np.ndarray:
        """Indices of the surest finds that are as far apart as heads are."""
        kept: list = []
        for row in np.argsort(-confidences, kind="stable"):
            if confidences[row] < max(self.config.min_confidence, 1e-9):
                break
            offsets = found.middles[kept] - found.middles[row]
            if not (np.hypot(offsets[:, 0], offsets[:, 1]) < self.config.head_distance).any():
                kept.append(row)
        return np.array(kept, dtype=int)

    def _bodies(self, found: UpperBodies, floor: Floor, lost_std: np.ndarray) -> Bodies:
        """How high they are, and whether they sit, as far as that tells: a child that stands is no higher."""
        heights = floor.heights(found.tops)
        stds = np.sqrt(HEAD_STDS[2] ** 2 + floor.variances(found.tops) + lost_std**2)
        return Bodies(heights, stds, ndtr((SITTING_HEIGHT - heights) / np.hypot(SITTING_SPREAD, stds)))

    def _heads(
        self, found: UpperBodies, floor: Floor, camera: Camera, level_from_camera: Pose, lost_std: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray]:
        """Positions (N, 3) and covariances (N, 3, 3) in the camera's frame; `lost_std` (N,) of what the image's edge
        cuts off, metres."""
        rotation = level_from_camera.rotation
        arms = found.middles - level_from_camera.translation
        distances = np.linalg.norm(arms, axis=1)
        along = arms / distances[:, None]
        across = np.column_stack([-along[:, 1], along[:, 0], np.zeros(len(arms))])
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-9)[:, None]
        up = np.cross(along, across)
        centre = np.array([[0.5 * (camera.width - 1), 0.5 * (camera.height - 1)]])
        pixel = np.linalg.norm(camera.ray_jacobians(centre)[0], axis=0).mean()  # radians
        edge_std = PIXEL_STD * pixel * distances
        depths = arms @ rotation[:, 2]
        focal = 1.0 / pixel
        looks = np.maximum(HEAD_AREA * (focal / depths / WINDOW) ** 2, 1.0)
        depth_std = self._sensor.stds(depths) / np.sqrt(looks)
        # The floor's error moves the height at which people may be, not where they are seen; its correction tells how
        # wrong the transform is that will place them.
        lifts = found.middles[:, 2] - floor.heights(found.middles)
        variances = np.column_stack(
            [
                depth_std**2 + HEAD_STDS[0] ** 2,
                edge_std**2 + HEAD_STDS[1] ** 2,
                edge_std**2 + HEAD_STDS[2] ** 2 + lifts**2 + lost_std**2,
            ]
        )
        axes = np.stack([along, across, up], axis=1) @ rotation
        covariances = np.einsum("nki,nk,nkj->nij", axes, variances, axes)
        return arms @ rotation, 0.5 * (covariances + np.swapaxes(covariances, 1, 2))


def _facing(frame_from_camera: Pose) -> Pose:
    """Pose of the camera in level axes beneath it that look where it looks."""
    ahead = frame_from_camera.rotation[:2, 2]
    heading = math.atan2(ahead[1], ahead[0])
    turn = Pose.from_xy_yaw(0.0, 0.0, -heading).rotation
    height = np.array([0.0, 0.0, frame_from_camera.translation[2]])
    return Pose(turn @ frame_from_camera.rotation, height)


def _half_angle(camera: Camera) -> float:
    """To the side of the image, at the height of its middle, radians."""
    middle = 0.5 * (camera.height - 1)
    rays = camera.rays(np.array([[0.0, middle], [camera.width - 1.0, middle]]))
    return max(float(np.abs(np.arctan2(rays[:, 0], rays[:, 2])).max()), NARROWEST)
