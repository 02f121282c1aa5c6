"""Planar laser scanners like a SICK S300, beam by beam while robot and people move."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError
from people_fusion.core.scans import Scan
from people_fusion.simulation import planar, rays
from people_fusion.simulation.plan import Plan
from people_fusion.simulation.world import History

LOST = {"inf": np.inf, "zero": 0.0, "nan": np.nan}


@dataclass(frozen=True)
class SectorConfig:
    """A part of the robot that stands in the beams' way."""

    start: float = parameter(0.0, "first angle in the scanner, radians")
    end: float = parameter(0.0, "last angle in the scanner, radians")
    range: float = parameter(0.0, "what the scanner reports there, metres; 0: masked by the driver as NaN", low=0.0)


@dataclass(frozen=True)
class ScannerConfig:
    """One scanner and where it is mounted; the defaults are a SICK S300 in front."""

    topic: str = parameter("/scan_front", "of its scans")
    frame: str = parameter("base_laser_link", "its frame")
    at: Tuple[float, float, float] = parameter((0.109, 0.0, 0.385), "on base_link, metres")
    yaw: float = parameter(0.0, "on base_link, radians")
    beams: int = parameter(541, "in a scan", low=2)
    angle_min: float = parameter(-2.35619449, "of the first beam, radians")
    angle_increment: float = parameter(0.00872664626, "from beam to beam, radians")
    rate: float = parameter(12.0, "scans a second", low=0.1, high=100.0)
    offset_s: float = parameter(0.0, "first scan after the start, seconds", low=0.0)
    time_increment: float = parameter(5.55e-5, "from beam to beam, seconds: 40 ms a turn of 720 half degrees", low=0.0)
    range_min: float = parameter(0.05, "metres", low=0.0)
    range_max: float = parameter(30.0, "metres", low=0.1)
    noise_std: float = parameter(0.015, "of a range, metres", low=0.0)
    quantisation: float = parameter(0.01, "step of the ranges, metres", low=0.0)
    mixed_probability: float = parameter(0.3, "of a range between both surfaces at an edge", low=0.0, high=1.0)
    mixed_reach: float = parameter(0.5, "largest jump at which ranges mix, metres", low=0.0)
    dropout: float = parameter(0.001, "share of the beams that return nothing for no reason", low=0.0, high=1.0)
    reference_range: float = parameter(
        2.0,
        "a beam that hits dark trousers squarely at this range is lost with probability `darkness`, metres",
        low=0.1,
    )
    lost_as: str = parameter("inf", "what a beam that returns nothing is reported as", choices=("inf", "zero", "nan"))
    sectors: Tuple[SectorConfig, ...] = parameter((), "parts of the robot in the way")

    def __post_init__(self) -> None:
        if (self.beams - 1) * self.time_increment > 1.0 / self.rate:
            raise ConfigError(f"scanners: a sweep of {self.topic} takes longer than 1 / rate")

    @property
    def angles(self) -> np.ndarray:
        """(B,) radians."""
        return self.angle_min + self.angle_increment * np.arange(self.beams)

    @property
    def sweep_s(self) -> float:
        """From the first beam to the last, seconds."""
        return (self.beams - 1) * self.time_increment

    @property
    def mount(self) -> np.ndarray:
        """(3,) base_from_scanner in the plane."""
        return np.array([self.at[0], self.at[1], self.yaw])


class Scanner:
    """Scans of a plan with people in it."""

    def __init__(self, config: ScannerConfig, plan: Plan, rng: np.random.Generator) -> None:
        self.config = config
        self._plan, self._rng = plan, rng
        self._angles = config.angles

    def scan(self, history: History, start_s: float, stamp_ns: int) -> Scan:
        """The scan whose first beam is measured at `start_s`."""
        config, rng = self.config, self._rng
        ranges, hits, cosines = self.exact(history, start_s)
        noise, chance = rng.standard_normal(config.beams), rng.random((4, config.beams))
        lost = self._lost(history.darkness, ranges, hits, cosines, chance[0]) | (chance[1] < config.dropout)
        ranges = self._mix(ranges, hits, chance[2], chance[3]) + config.noise_std * noise
        if config.quantisation > 0.0:
            ranges = np.round(ranges / config.quantisation) * config.quantisation
        ranges = np.where(ranges > config.range_max, np.inf, ranges)
        ranges = np.where(ranges < config.range_min, -np.inf, ranges)
        ranges[lost] = LOST[config.lost_as]
        for sector in config.sectors:
            ranges[_within(self._angles, sector)] = sector.range or np.nan
        return Scan(
            stamp_ns,
            config.frame,
            ranges,
            config.angle_min,
            config.angle_increment,
            config.range_min,
            config.range_max,
            config.time_increment,
            1.0 / config.rate,
        )

    def exact(self, history: History, start_s: float) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Ranges, hits and cosines of incidence of a scan without any error, see `rays.cast`."""
        config = self.config
        times = start_s + config.time_increment * np.arange(config.beams)
        poses = planar.compose(history.at("robot", times), config.mount)
        legs = history.at("legs", times).reshape(config.beams, -1, 2)
        return self._cast(history, poses[:, :2], planar.direction(poses[:, 2] + self._angles), legs)

    def sees(self, history: History, time_s: float) -> np.ndarray:
        """(N,) whether any part of a leg of each person is in plain view, dark trousers or not."""
        config = self.config
        pose = planar.compose(history.at("robot", np.array([time_s]))[0], config.mount)
        legs = history.at("legs", np.array([time_s]))[0].reshape(-1, 2)
        radii = np.repeat(history.leg_radii, 2)
        to_leg = legs - pose[:2]
        distance = np.linalg.norm(to_leg, axis=1)
        half = np.arcsin(np.clip(0.7 * radii / distance, 0.0, 1.0))
        aims = np.arctan2(to_leg[:, 1], to_leg[:, 0])[:, None] + half[:, None] * np.array([-1.0, 0.0, 1.0])
        count = aims.size
        moved = np.broadcast_to(legs, (count, *legs.shape))
        _, hits, _ = self._cast(history, np.broadcast_to(pose[:2], (count, 2)), planar.direction(aims.ravel()), moved)
        static = len(self._plan.segments) + len(self._plan.radii)
        hit = hits.reshape(aims.shape) == static + np.arange(len(legs))[:, None]
        bearings = planar.wrap(aims - pose[2])
        ends = np.sort(self._angles[[0, -1]])
        hit &= (bearings >= ends[0]) & (bearings <= ends[1])
        for sector in config.sectors:
            hit &= ~_within(bearings, sector)
        return hit.any(axis=1).reshape(-1, 2).any(axis=1)

    def _cast(
        self, history: History, origins: np.ndarray, directions: np.ndarray, legs: np.ndarray
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        plan = self._plan
        standing = np.broadcast_to(plan.centres, (len(origins), *plan.centres.shape))
        centres = np.concatenate([standing, legs], axis=1)
        radii = np.concatenate([plan.radii, np.repeat(history.leg_radii, 2)])
        return rays.cast(origins, directions, plan.segments, centres, radii)

    def _lost(
        self, darkness: np.ndarray, ranges: np.ndarray, hits: np.ndarray, cosines: np.ndarray, chance: np.ndarray
    ) -> np.ndarray:
        """(B,) whether dark trousers swallow the beam: the fainter the echo (far, grazing), the likelier."""
        leg = hits - len(self._plan.segments) - len(self._plan.radii)
        on_leg = leg >= 0
        dark = darkness[leg[on_leg] // 2]
        echo = self.config.reference_range * cosines[on_leg] / np.maximum(ranges[on_leg], 1e-3)
        lost = np.zeros(len(ranges), dtype=bool)
        lost[on_leg] = (chance[on_leg] < dark**echo) & (dark > 0.0)
        return lost

    def _mix(self, ranges: np.ndarray, hits: np.ndarray, chance: np.ndarray, share: np.ndarray) -> np.ndarray:
        """Ranges, some of those beside an edge moved between both surfaces, as the spot lies on both."""
        config = self.config
        edge = (hits[1:] != hits[:-1]) & (hits[1:] >= 0) & (hits[:-1] >= 0)
        jump = np.zeros(len(ranges))
        jump[:-1][edge] = ranges[1:][edge] - ranges[:-1][edge]
        mixes = (np.abs(jump) < config.mixed_reach) & (chance < config.mixed_probability)
        return ranges + np.where(mixes, share * jump, 0.0)


def _within(angles: np.ndarray, sector: SectorConfig) -> np.ndarray:
    return (angles >= sector.start) & (angles <= sector.end)
