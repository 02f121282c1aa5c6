"""Simulated depth cameras: how far it is to what a camera sees, as well as such a sensor can tell.

By triangulation (Kinect, Xtion, RealSense; Khoshelham & Elberink 2012) the disparity d = f b / z has the error, so that
of the depth grows with its square; it comes in steps, and what the projector at the camera's side does not light has
none. With time of flight the error is of the depth itself. Where little light comes back, nothing is measured: far
away, on dark things, and where the view only grazes them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.errors import ConfigError
from people_fusion.simulation.camera import (
    NOISE_MARGIN,
    CameraConfig,
    Cast,
    HeadBoxes,
    Picture,
    PinholeConfig,
    SimulatedCamera,
)
from people_fusion.simulation.plan import Plan
from people_fusion.simulation.world import History

FLICKER = 0.3  # standard deviation of the logarithm of what comes back


@dataclass(frozen=True)
class DepthCameraConfig:
    """A depth camera on the robot; the defaults are a Kinect's."""

    topic: str = parameter("/kinect/depth_registered/image_raw", "of its images, without the transport")
    frame: str = parameter("kinect_rgb_optical_frame", "its frame, with optical axes")
    at: Tuple[float, float, float] = parameter((0.05, 0.0, 1.35), "on base_link, metres")
    yaw: float = parameter(0.0, "on base_link, radians")
    pitch: float = parameter(0.0, "downwards, radians", low=-1.2, high=1.2)
    rate: float = parameter(10.0, "images a second", low=0.1, high=100.0)
    offset_s: float = parameter(0.0, "first image after the start, seconds", low=0.0)
    pinhole: PinholeConfig = section(PinholeConfig, "its lens, without distortion")
    encoding: str = parameter(
        "compressedDepth", "of the images; compressedDepth is PNG", choices=("compressedDepth", "16UC1", "32FC1")
    )
    colour: str = parameter("", "topic of its colour images, of the same pixels, as JPEG; empty: none")
    min_range: float = parameter(0.5, "nearest depth, metres", low=0.01)
    max_range: float = parameter(8.0, "farthest depth, metres", low=0.1)
    baseline: float = parameter(0.075, "from the camera to its projector; 0: time of flight, metres", low=0.0)
    disparity_std: float = parameter(0.06, "pixels", low=0.0)
    disparity_step: float = parameter(0.125, "pixels; 0: none", low=0.0)
    depth_std: float = parameter(0.002, "of what does not depend on the depth, metres", low=0.0)
    likeness: float = parameter(1.5, "standard deviation of the window in which errors are alike, pixels", low=0.0)
    edge_std: float = parameter(0.7, "of where edges are, pixels", low=0.0, high=5.0)
    least_signal: float = parameter(
        0.003, "brightness times cosine of incidence over squared depth that is needed, 1/m^2", low=0.0
    )

    def __post_init__(self) -> None:
        if self.pinhole.distortion:
            raise ConfigError(f"depth_cameras: {self.topic}: depth images are without distortion")
        if not self.min_range < self.max_range:
            raise ConfigError(f"depth_cameras: {self.topic}: min_range is not below max_range")

    @property
    def image_topic(self) -> str:
        """Where its images are."""
        return f"{self.topic}/compressedDepth" if self.encoding == "compressedDepth" else self.topic

    @property
    def beside(self) -> CameraConfig:
        """The colour camera that sees the same."""
        return CameraConfig(
            topic=self.colour or f"{self.topic}/colour",
            frame=self.frame,
            at=self.at,
            yaw=self.yaw,
            pitch=self.pitch,
            rate=self.rate,
            offset_s=self.offset_s,
            model="pinhole",
            pinhole=self.pinhole,
        )


@dataclass(frozen=True, eq=False)
class DepthPicture:
    """One image.

    Attributes:
        stamp_ns: of the exposure.
        config: of the camera.
        depths: (H, W) float32 metres along the optical axis, NaN without return.
        colour: what the colour camera beside it sees.
    """

    stamp_ns: int
    config: DepthCameraConfig
    depths: np.ndarray
    colour: Picture

    @property
    def heads(self) -> HeadBoxes:
        """The truth about the heads in it."""
        return self.colour.heads


class SimulatedDepthCamera:
    """Images of one depth camera; arguments as of SimulatedCamera."""

    def __init__(
        self,
        config: DepthCameraConfig,
        plan: Plan,
        cast: Cast,
        base_height: float,
        leg_height: float,
        room_rng: np.random.Generator,
        rng: np.random.Generator,
    ) -> None:
        self.config = config
        self.beside = SimulatedCamera(config.beside, plan, cast, base_height, leg_height, room_rng, rng)
        camera = self.beside.camera
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
        self._rays = rays.reshape(camera.height, camera.width, 3)
        self._sensor = DepthSensing(config, self._rays, rng)

    def picture(self, history: History, time_s: float, stamp_ns: int) -> DepthPicture:
        """What the camera measures at a time since the start."""
        colour, ranges = self.beside.shot(history, time_s, stamp_ns)
        depths = self._sensor.measured(ranges * self._rays[..., 2], colour.pixels.mean(axis=2) / 255.0)
        return DepthPicture(stamp_ns, self.config, depths, colour)


class DepthSensing:
    """What a sensor makes of depths.

    Args:
        config: of the sensor.
        rays: (H, W, 3) unit vectors of its pixels.
        rng: of its errors.
    """

    def __init__(self, config: DepthCameraConfig, rays: np.ndarray, rng: np.random.Generator) -> None:
        self.config, self._rays, self._rng = config, rays, rng
        self._points = rays / rays[..., 2:]
        size = (rays.shape[0] + NOISE_MARGIN, rays.shape[1] + NOISE_MARGIN)
        self._alike = _alike(rng.standard_normal(size), config.likeness)
        self._fresh = rng.standard_normal(size).astype(np.float32)

    def measured(self, depths: np.ndarray, brightness: np.ndarray) -> np.ndarray:
        """(H, W) float32 metres, NaN without return.

        Args:
            depths: (H, W) true ones along the optical axis, metres.
            brightness: (H, W) of what is seen, of 1.
        """
        config = self.config
        depths = self._at_jagged_edges(depths)
        signal = brightness * self._cosines(depths) / depths**2 * np.exp(FLICKER * self._noise(self._fresh))
        lost = signal < config.least_signal
        found = depths.astype(np.float64)
        if config.baseline > 0.0:
            strength = config.baseline * config.pinhole.matrix[0, 0]
            disparities = strength / depths
            lost |= in_shadow(disparities)
            disparities = disparities + config.disparity_std * self._noise(self._alike)
            if config.disparity_step > 0.0:
                disparities = np.round(disparities / config.disparity_step) * config.disparity_step
            found = strength / np.maximum(disparities, 1e-9)
        found = found + config.depth_std * self._noise(self._alike)
        lost |= (found < config.min_range) | (found > config.max_range)
        return np.where(lost, np.nan, found).astype(np.float32)

    def _at_jagged_edges(self, depths: np.ndarray) -> np.ndarray:
        """Each pixel is measured some pixels aside."""
        if self.config.edge_std == 0.0:
            return depths
        height, width = depths.shape
        aside = [np.round(self.config.edge_std * self._noise(self._fresh)).astype(int) for _ in range(2)]
        rows = np.clip(np.arange(height)[:, None] + aside[0], 0, height - 1)
        columns = np.clip(np.arange(width)[None, :] + aside[1], 0, width - 1)
        return np.asarray(depths[rows, columns])

    def _cosines(self, depths: np.ndarray) -> np.ndarray:
        """(H, W) of incidence, from how the depths of neighbours differ."""
        points = self._points * depths[..., None]
        across = np.gradient(points, axis=1)
        down = np.gradient(points, axis=0)
        normals = np.cross(across, down)
        lengths = np.maximum(np.linalg.norm(normals, axis=2), 1e-12)
        return np.asarray(np.abs((normals * self._rays).sum(axis=2)) / lengths)

    def _noise(self, field: np.ndarray) -> np.ndarray:
        """(H, W) of some place of a field of noise."""
        top, left = self._rng.integers(NOISE_MARGIN, size=2)
        height, width = self._rays.shape[:2]
        return field[top : top + height, left : left + width]


def in_shadow(disparities: np.ndarray) -> np.ndarray:
    """(H, W) what a projector to the right of the camera does not light: its light ends at something nearer.

    Args:
        disparities: (H, W) pixels; the projector sees column u at u - d.
    """
    lit = np.arange(disparities.shape[1]) - disparities
    right = np.minimum.accumulate(lit[:, ::-1], axis=1)[:, ::-1]
    return np.asarray(lit > right)


def _alike(noise: np.ndarray, likeness: float) -> np.ndarray:
    """White noise made alike in a window, its standard deviation 1 as before."""
    if likeness > 0.0:
        import cv2  # 100 MB: not for those who simulate no images

        noise = cv2.GaussianBlur(noise, (0, 0), likeness)
    return (noise / noise.std()).astype(np.float32)
