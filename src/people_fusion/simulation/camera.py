"""Simulated cameras: pictures of the room and its people, with the boxes of all heads that are in them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import List, Sequence, Tuple

import numpy as np

from people_fusion.core.camera_models import Panorama, PanoramaConfig, Pinhole
from people_fusion.core.cameras import Camera
from people_fusion.core.config import parameter, section
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.core.image_topics import COMPRESSED
from people_fusion.core.poses import Pose
from people_fusion.simulation import planar
from people_fusion.simulation.plan import Plan
from people_fusion.simulation.rendering import Figure, Painter
from people_fusion.simulation.rendering_people import Look, draw_looks, stand
from people_fusion.simulation.rendering_room import Light, RoomPainter
from people_fusion.simulation.world import STEP_S, History

OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # level from optical axes, looking ahead
SPHERE = np.array(
    [
        [math.cos(a) * math.cos(e), math.sin(a) * math.cos(e), math.sin(e)]
        for a in np.arange(16) * (2.0 * math.pi / 16)
        for e in np.linspace(-0.5 * math.pi, 0.5 * math.pi, 9)
    ]
)
NOISE_MARGIN = 64  # pixels by which the noise of one image is moved to make that of the next


@dataclass(frozen=True)
class PinholeConfig:
    """A perspective camera."""

    width: int = parameter(640, "of the image, pixels", low=16)
    height: int = parameter(480, "of the image, pixels", low=16)
    field: float = parameter(1.05, "of view across, without distortion, radians", low=0.1, high=2.6)
    distortion: Tuple[float, ...] = parameter((), "k1 k2 p1 p2 [k3 [k4 k5 k6]], plumb_bob or rational_polynomial")

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3) K."""
        focal = 0.5 * self.width / math.tan(0.5 * self.field)
        return np.array([[focal, 0.0, 0.5 * (self.width - 1)], [0.0, focal, 0.5 * (self.height - 1)], [0.0, 0.0, 1.0]])


@dataclass(frozen=True)
class CameraConfig:
    """A camera on the robot; the defaults are a panorama on a SCITOS's mast (Poschmann 2018)."""

    topic: str = parameter("/panorama/image_raw", "of its images; compressed ones get /compressed")
    frame: str = parameter("panorama", "its frame; optical axes for a pinhole, z up and x ahead for a panorama")
    at: Tuple[float, float, float] = parameter((0.0, 0.0, 1.68), "on base_link, metres")
    yaw: float = parameter(0.0, "on base_link, radians")
    pitch: float = parameter(0.0, "downwards, radians", low=-1.2, high=1.2)
    rate: float = parameter(9.0, "images a second", low=0.1, high=100.0)
    offset_s: float = parameter(0.0, "first image after the start, seconds", low=0.0)
    model: str = parameter("panorama", "which of the two below it is", choices=("panorama", "pinhole"))
    panorama: PanoramaConfig = section(PanoramaConfig, "a cylinder")
    pinhole: PinholeConfig = section(PinholeConfig, "a perspective camera, with camera_info")
    encoding: str = parameter("jpeg", "of the images", choices=("jpeg", "bgr8", "mono8"))
    quality: int = parameter(90, "of jpeg, percent", low=1, high=100)
    exposure: float = parameter(1.0, "factor of brightness", low=0.05, high=10.0)
    blur: float = parameter(0.6, "of the lens, standard deviation, pixels", low=0.0, high=10.0)
    noise_std: float = parameter(3.0, "of the sensor, of 255", low=0.0, high=64.0)
    stitches: int = parameter(4, "cameras of which a panorama is stitched together", low=1, high=16)
    stitch_shift: float = parameter(1.0, "of one of them against level, standard deviation, rows", low=0.0)
    stitch_gain: float = parameter(0.04, "of their brightness, standard deviation", low=0.0, high=0.5)

    def __post_init__(self) -> None:
        self.camera()

    @property
    def image_topic(self) -> str:
        """Where its images are."""
        return self.topic + COMPRESSED if self.encoding == "jpeg" else self.topic

    @property
    def truth_topic(self) -> str:
        """Where the boxes of heads are."""
        return f"/ground_truth/heads/{self.frame}"

    @property
    def mount(self) -> np.ndarray:
        """(3,) base_from_camera in the plane."""
        return np.array([self.at[0], self.at[1], self.yaw])

    @property
    def base_from_camera(self) -> Pose:
        """With the axes of the model."""
        return Pose(Pose.from_xy_yaw(0.0, 0.0, self.yaw).rotation @ self.level_from_camera, np.array(self.at))

    @property
    def level_from_camera(self) -> np.ndarray:
        """(3, 3) into axes ahead, left, up."""
        cos, sin = math.cos(self.pitch), math.sin(self.pitch)
        tilt = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
        return tilt if self.model == "panorama" else tilt @ OPTICAL

    def camera(self) -> Camera:
        """The model.

        Raises:
            ConfigError: no lens has that distortion.
        """
        if self.model == "panorama":
            return Panorama(self.panorama)
        pinhole = self.pinhole
        try:
            return Pinhole(pinhole.width, pinhole.height, pinhole.matrix, pinhole.distortion)
        except DataError as error:
            raise ConfigError(f"cameras: {self.topic}: {error}") from error


@dataclass(frozen=True)
class LooksConfig:
    """What cameras see of people and rooms beyond where they are."""

    glance_std: float = parameter(0.35, "of the head's yaw on the body, radians", low=0.0, high=1.5)
    glance_s: float = parameter(2.0, "mean time from one glance to the next, seconds", low=0.1)
    glance_speed: float = parameter(3.0, "of the head's turn, rad/s", low=0.1)
    light_gradient: float = parameter(0.04, "of brightness over the floor, a metre", low=0.0, high=0.5)


@dataclass(frozen=True, eq=False)
class HeadBoxes:
    """The truth about the heads in one image.

    Attributes:
        stamp_ns, frame_id: of the image.
        ids: (N,) of the people, from 1.
        positions: (N, 3) middles of the heads in the camera's frame, metres.
        corners: (N, 4) left, top, right, bottom, pixels, as a detector's: from the chin to the crown without hair.
        visibility: (N,) share of the head that is in the image with nothing before it.
        yaws: (N,) how far the face is turned from the camera, radians, to the left of the camera positive.
    """

    stamp_ns: int
    frame_id: str
    ids: np.ndarray
    positions: np.ndarray
    corners: np.ndarray
    visibility: np.ndarray
    yaws: np.ndarray


@dataclass(frozen=True, eq=False)
class Picture:
    """One image.

    Attributes:
        stamp_ns: of the exposure.
        config: of the camera.
        pixels: (H, W, 3) blue, green, red, or (H, W) grey; uint8.
        heads: that are in it.
    """

    stamp_ns: int
    config: CameraConfig
    pixels: np.ndarray
    heads: HeadBoxes


@dataclass(frozen=True, eq=False)
class Calibration:
    """What is said of a camera beside each image."""

    stamp_ns: int
    config: CameraConfig


class Cast:
    """The people as all cameras see them.

    Attributes:
        looks: of the N people.
        gazes: (T, N) where their heads point, radians, not wrapped.
        light: of the room.
    """

    def __init__(self, history: History, config: LooksConfig, rng: np.random.Generator) -> None:
        steps, count = history.headings.shape
        self.light = Light(config.light_gradient, rng)
        self.looks: Sequence[Look] = draw_looks(count, rng)
        self.gazes = history.headings + _glances(steps, count, config, rng)

    def gaze_at(self, time_s: float) -> np.ndarray:
        """(N,) radians, at the next step before."""
        return np.asarray(self.gazes[min(int(time_s / STEP_S), len(self.gazes) - 1)])


class SimulatedCamera:
    """Pictures of one camera.

    Args:
        config: of the camera.
        plan: what stands in the room.
        cast: the looks of the people.
        base_height: of base_link over the floor, metres.
        leg_height: at which History.legs are, metres.
        room_rng: of the room's looks, the same for all cameras.
        rng: of the sensor.
    """

    def __init__(
        self,
        config: CameraConfig,
        plan: Plan,
        cast: Cast,
        base_height: float,
        leg_height: float,
        room_rng: np.random.Generator,
        rng: np.random.Generator,
    ) -> None:
        self.config, self.camera = config, config.camera()
        self._cast, self._rng, self._leg_height = cast, rng, leg_height
        self._height = base_height + config.at[2]
        level = config.level_from_camera
        self._room = RoomPainter(plan, self.camera, level, self._height, cast.light, room_rng)
        self._painter = Painter(self.camera, level)
        parts = config.stitches if config.model == "panorama" else 1
        self._shifts = config.stitch_shift * rng.standard_normal(parts) * (parts > 1)
        self._gains = 1.0 + config.stitch_gain * rng.standard_normal(parts) * (parts > 1)
        size = (self.camera.height + NOISE_MARGIN, self.camera.width + NOISE_MARGIN, 3)
        self._noise = np.float32(config.noise_std) * rng.standard_normal(size, dtype=np.float32)

    def picture(self, history: History, time_s: float, stamp_ns: int) -> Picture:
        """What the camera sees at a time since the start."""
        return self.shot(history, time_s, stamp_ns)[0]

    def shot(self, history: History, time_s: float, stamp_ns: int) -> Tuple[Picture, np.ndarray]:
        """The same, and how far it is to what is seen, (H, W) along the ray of each pixel, metres."""
        at = np.array([time_s])
        pose = planar.compose(history.at("robot", at)[0], self.config.mount)
        level = Pose.from_xy_yaw(float(pose[0]), float(pose[1]), float(pose[2]), self._height)
        camera_from_world = (level @ Pose(self.config.level_from_camera, np.zeros(3))).inverse()
        heads, headings = history.at("heads", at)[0], history.at("headings", at)[0]
        legs = history.at("legs", at)[0]
        gazes = self._cast.gaze_at(time_s)
        figures = []
        for number, look in enumerate(self._cast.looks):
            cut = np.column_stack([legs[number], np.full(2, self._leg_height)])
            solids = stand(heads[number], float(headings[number]), float(gazes[number]), cut, look)
            x, y, z = map(float, heads[number])
            head = Pose.from_xy_yaw(x, y, float(gazes[number]), z)
            body = Pose.from_xy_yaw(x, y, float(headings[number])).rotation
            light = float(self._cast.light.at(*heads[number, :2]))
            figures.append(Figure(solids, look, head.inverse(), body, light))
        painting = self._painter.paint(self._room.paint(pose), figures, camera_from_world)
        truth = self._truth(stamp_ns, figures, gazes, heads, camera_from_world, painting.shares)
        return Picture(stamp_ns, self.config, self._exposed(painting.colours), truth), painting.ranges

    def _exposed(self, picture: np.ndarray) -> np.ndarray:
        """Lens, stitching and sensor."""
        import cv2  # 100 MB: not for those who simulate no images

        config = self.config
        if config.blur > 0.0:
            picture = cv2.GaussianBlur(picture, (0, 0), config.blur)
        edges = np.round(np.linspace(0, self.camera.width, len(self._gains) + 1)).astype(int)
        for left, right, shift, gain in zip(edges[:-1], edges[1:], self._shifts, self._gains * config.exposure):
            piece = picture[:, left:right]
            if shift:
                move = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, shift]])
                piece = cv2.warpAffine(piece, move, piece.shape[1::-1], None, cv2.INTER_LINEAR, cv2.BORDER_REPLICATE)
            picture[:, left:right] = np.float32(gain) * piece
        if config.noise_std > 0.0:
            down, right = self._rng.integers(NOISE_MARGIN, size=2)
            picture += self._noise[down : down + self.camera.height, right : right + self.camera.width]
        pixels = np.clip(picture, 0.0, 255.0, out=picture).astype(np.uint8)
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)) if config.encoding == "mono8" else pixels

    def _truth(
        self,
        stamp_ns: int,
        figures: List[Figure],
        gazes: np.ndarray,
        heads: np.ndarray,
        camera_from_world: Pose,
        shares: np.ndarray,
    ) -> HeadBoxes:
        camera = self.camera
        positions = camera_from_world.apply(heads)
        corners = np.full((len(figures), 4), np.nan)
        for number, figure in enumerate(figures):
            solids = figure.solids
            shapes, centres = solids.shapes[solids.is_skull], solids.centres[solids.is_skull]
            surface = centres[:, None] + SPHERE @ np.swapaxes(np.linalg.inv(shapes), 1, 2)
            pixels = camera.project(camera_from_world.apply(surface.reshape(-1, 3)))
            if camera.wraps:
                middle = camera.project(positions[number : number + 1])[0, 0]
                pixels[:, 0] -= np.round((pixels[:, 0] - middle) / camera.width) * camera.width
            corners[number] = np.concatenate([pixels.min(axis=0), pixels.max(axis=0)]) + 0.5
        low, high = np.maximum(corners[:, :2], 0.0), np.minimum(corners[:, 2:], [camera.width, camera.height])
        if camera.wraps:
            low[:, 0], high[:, 0] = corners[:, 0], corners[:, 2]
        with np.errstate(invalid="ignore"):
            inside = np.clip(high - low, 0.0, None).prod(axis=1) / (corners[:, 2:] - corners[:, :2]).prod(axis=1)
            is_in = inside > 0.0
        world = camera_from_world.inverse().translation
        to_camera = world[:2] - heads[:, :2]
        yaws = planar.wrap(gazes - np.arctan2(to_camera[:, 1], to_camera[:, 0]))
        visibility = np.nan_to_num(inside * shares)
        columns = (np.arange(1, len(figures) + 1), positions, corners, visibility, yaws)
        return HeadBoxes(stamp_ns, self.config.frame, *(column[is_in] for column in columns))


def _glances(steps: int, count: int, config: LooksConfig, rng: np.random.Generator) -> np.ndarray:
    """(T, N) yaw of the heads on the bodies: held, then turned to the next."""
    changes = rng.random((steps, count)) < STEP_S / config.glance_s
    changes[0] = True
    targets = config.glance_std * rng.standard_normal((steps, count))
    yaws = np.empty((steps, count))
    now = target = targets[0].clip(-1.2, 1.2)
    most = config.glance_speed * STEP_S
    for step in range(steps):
        target = np.where(changes[step], targets[step].clip(-1.2, 1.2), target)
        now = now + np.clip(target - now, -most, most)
        yaws[step] = now
    return yaws
