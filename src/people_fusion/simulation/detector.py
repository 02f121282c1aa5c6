"""Emulated camera cues: detections are drawn from the truth. There is no image and no detector behind them.

They are as late as real ones, which is what buffers are tried on: an image is read out and arrives, the cue announces
it, works on it and delivers. While it works, one image waits, the newest; the others are skipped.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Iterator, NamedTuple, Optional, Sequence, Tuple, Union

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.measurements import XYZ_OBSERVED, Announcement, Measurement, Sight
from people_fusion.core.stamps import from_seconds
from people_fusion.simulation import planar, rays
from people_fusion.simulation.plan import Plan
from people_fusion.simulation.world import History

HEAD_RADIUS_M = 0.12
CLUTTER_HEIGHTS_M = (1.1, 1.9)  # over the floor
# A camera that finds nobody has not seen that nobody is there: one beam without information.
NO_SIGHT = Sight(np.zeros(2), 0.0, 0.0, 1.0, np.full(1, np.nan), 0.0)


@dataclass(frozen=True)
class DetectorConfig:
    """An emulated camera cue. Cues with the same `frame` share the images of one camera."""

    name: str = parameter("emulated_heads", "of the cue")
    modality: str = parameter("head", "kind of the cue")
    frame: str = parameter("camera_link", "of the camera; x points ahead, z up")
    at: Tuple[float, float, float] = parameter((0.0, 0.0, 1.35), "of the camera on base_link, metres")
    yaw: float = parameter(0.0, "of the camera on base_link, radians")
    rate: float = parameter(9.0, "images a second", low=0.1, high=100.0)
    offset_s: float = parameter(0.0, "first image after the start, seconds", low=0.0)
    every: int = parameter(1, "takes every n-th image of its camera", low=1)
    first: int = parameter(0, "number of the first image that it takes", low=0)
    readout_s: float = parameter(0.009, "from the exposure, which is the stamp, to the cue, seconds", low=0.0)
    readout_std_s: float = parameter(0.001, "of that", low=0.0)
    processing_s: float = parameter(0.069, "from the cue's beginning to its measurement, seconds", low=0.0)
    processing_std_s: float = parameter(0.004, "of that", low=0.0)
    field_of_view: float = parameter(6.2832, "about straight ahead, radians", low=0.01, high=6.2832)
    facing: float = parameter(3.1416, "how far a person may be turned away from the camera, radians", low=0.0)
    reach: float = parameter(5.0, "heads are not found farther away, metres", low=0.1)
    detection_probability: float = parameter(0.8, "of a head in plain view", low=0.0, high=1.0)
    lost_by_yaw: float = parameter(
        0.0, "share of that lost of who is turned away as far as `facing`; less with the square of the angle", 0.0, 1.0
    )
    lost_by_distance: float = parameter(
        0.0, "share of that lost as far away as `reach`; less with the square of the distance", 0.0, 1.0
    )
    clutter: float = parameter(0.02, "mean number of false detections in an image", low=0.0)
    along_share: float = parameter(
        0.1, "standard deviation along the ray as a share of the distance, which is told by the size of a box", low=1e-3
    )
    across_rad: float = parameter(0.015, "standard deviation across the ray, radians", low=1e-4)
    confidence: float = parameter(0.8, "of each detection, true or false", low=0.0, high=1.0)


@dataclass(frozen=True, eq=False)
class Told:
    """An announcement with the frame of its image."""

    announcement: Announcement
    frame_id: str


class Job(NamedTuple):
    """What becomes of a message: worked on from `begin_ns` to `end_ns`, or skipped at `end_ns`."""

    begin_ns: Optional[int]
    end_ns: int


def work(arrivals_ns: Sequence[int], durations_ns: Sequence[int]) -> Iterator[Job]:
    """Jobs of a cue that works on one message at a time, and then on the newest that came meanwhile; in their order.

    Args:
        arrivals_ns: not decreasing.
        durations_ns: what the work on each would take.
    """
    free_ns = 0
    for index, arrival_ns in enumerate(arrivals_ns):
        begin_ns = max(arrival_ns, free_ns)
        newer_ns = arrivals_ns[index + 1] if index + 1 < len(arrivals_ns) else begin_ns
        if newer_ns < begin_ns:
            yield Job(None, newer_ns)
            continue
        free_ns = begin_ns + durations_ns[index]
        yield Job(begin_ns, free_ns)


class Detector:
    """Measurements of one emulated cue."""

    def __init__(self, config: DetectorConfig, plan: Plan, rng: np.random.Generator) -> None:
        self.config = config
        self._plan, self._rng = plan, rng

    @property
    def mount(self) -> np.ndarray:
        """(3,) base_from_camera in the plane."""
        return np.array([self.config.at[0], self.config.at[1], self.config.yaw])

    def events(
        self, history: History, base_height: float, times_s: np.ndarray, stamps_ns: Sequence[int], delays_s: np.ndarray
    ) -> Iterator[Tuple[int, Union[Told, Measurement]]]:
        """(arrival, item) of announcements, measurements and withdrawals, sorted by arrival.

        Args:
            history: the truth.
            base_height: of base_link over the floor, metres.
            times_s: (K,) of the exposures since the start.
            stamps_ns: the same as stamps.
            delays_s: (K,) from the exposures to the cue.
        """
        config = self.config
        arrivals_ns = [stamp_ns + from_seconds(float(delay_s)) for stamp_ns, delay_s in zip(stamps_ns, delays_s)]
        spread = config.processing_std_s * self._rng.standard_normal(len(times_s))
        durations_ns = [from_seconds(float(duration_s)) for duration_s in np.maximum(config.processing_s + spread, 0.0)]
        events: list = []
        for index, job in enumerate(work(arrivals_ns, durations_ns)):
            announcement = Announcement(stamps_ns[index], config.name, index + 1)
            measurement = self.measure(history, base_height, float(times_s[index]), announcement)
            events.append((arrivals_ns[index], Told(announcement, config.frame)))
            skipped = Told(announcement._replace(withdrawn=True), config.frame)
            events.append((job.end_ns, skipped if job.begin_ns is None else measurement))
        return iter(sorted(events, key=lambda event: event[0]))

    def measure(
        self, history: History, base_height: float, time_s: float, announcement: Announcement
    ) -> Measurement:
        """What the cue makes of the image that is exposed at `time_s`; detections stand in random order."""
        config, rng = self.config, self._rng
        seen = self.sees(history, time_s) & (rng.random(len(history.leg_radii)) < self.probabilities(history, time_s))
        exact = self._from_camera(history, base_height, time_s)[seen]
        true = exact + np.einsum("nij,nj->ni", self._roots(exact), rng.standard_normal((len(exact), 3)))
        found = rng.permutation(np.concatenate([true, self._clutter(base_height)]))
        roots = self._roots(found)
        return Measurement(
            announcement.stamp_ns,
            config.name,
            config.modality,
            config.frame,
            found,
            roots @ roots,
            np.full(len(found), config.confidence),
            XYZ_OBSERVED,
            config.every / config.rate,
            announcement.sequence,
            sight=NO_SIGHT,
        )

    def sees(self, history: History, time_s: float) -> np.ndarray:
        """(N,) whose head is in plain view; walls, pillars and other heads hide it."""
        config = self.config
        camera, heads, distances, directions, turned = self._geometry(history, time_s)
        circles = np.concatenate([self._plan.centres, heads])
        radii = np.concatenate([self._plan.radii, np.full(len(heads), HEAD_RADIUS_M)])
        centres = np.broadcast_to(circles, (len(heads), *circles.shape))
        origins = np.broadcast_to(camera[:2], heads.shape)
        _, hits, _ = rays.cast(origins, directions, self._plan.segments, centres, radii)
        first = len(self._plan.segments) + len(self._plan.radii)
        bearings = np.arctan2(directions[:, 1], directions[:, 0])
        ahead = np.abs(planar.wrap(bearings - camera[2])) <= config.field_of_view / 2.0
        plain: np.ndarray = hits == first + np.arange(len(heads))
        return plain & ahead & (turned <= config.facing) & (distances <= config.reach)

    def probabilities(self, history: History, time_s: float) -> np.ndarray:
        """(N,) that each person is found who is in plain view."""
        config = self.config
        _, _, distances, _, turned = self._geometry(history, time_s)
        away = np.minimum(turned / max(config.facing, 1e-9), 1.0)
        far = np.minimum(distances / config.reach, 1.0)
        kept = (1.0 - config.lost_by_yaw * away**2) * (1.0 - config.lost_by_distance * far**2)
        return np.asarray(config.detection_probability * kept)

    def _geometry(
        self, history: History, time_s: float
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Pose (3,) of the camera, and of each person's head: place (N, 2), distance (N,), direction (N, 2), and how
        far the body is turned away (N,), radians."""
        at = np.array([time_s])
        camera = planar.compose(history.at("robot", at)[0], self.mount)
        heads = history.at("heads", at)[0, :, :2]
        to_head = heads - camera[:2]
        distances = np.linalg.norm(to_head, axis=1)
        directions = to_head / np.maximum(distances, 1e-9)[:, None]
        bearings = np.arctan2(directions[:, 1], directions[:, 0])
        turned = np.abs(planar.wrap(history.at("headings", at)[0] - bearings + math.pi))
        return camera, heads, distances, directions, turned

    def _from_camera(self, history: History, base_height: float, time_s: float) -> np.ndarray:
        """(N, 3) heads in the camera's frame."""
        at = np.array([time_s])
        heads = history.at("heads", at)[0]
        camera = planar.compose(history.at("robot", at)[0], self.mount)
        flat = planar.apply(planar.inverse(camera), heads[:, :2])
        return np.column_stack([flat, heads[:, 2] - base_height - self.config.at[2]])

    def _roots(self, points: np.ndarray) -> np.ndarray:
        """(N, 3, 3) square roots, symmetric, of the covariances of detections at points (N, 3) of the camera."""
        distances = np.maximum(np.linalg.norm(points, axis=1), 1e-9)[:, None, None]
        ways = points[:, :, None] / distances
        outer = ways @ ways.swapaxes(1, 2)
        return distances * (self.config.along_share * outer + self.config.across_rad * (np.eye(3) - outer))

    def _clutter(self, base_height: float) -> np.ndarray:
        """(K, 3) false heads, uniform over the floor in view."""
        config, rng = self.config, self._rng
        count = int(rng.poisson(config.clutter))
        distances = config.reach * np.sqrt(rng.random(count))
        bearings = config.field_of_view * (rng.random(count) - 0.5)
        heights = rng.uniform(*CLUTTER_HEIGHTS_M, count) - base_height - config.at[2]
        return np.column_stack([distances[:, None] * planar.direction(bearings), heights])
