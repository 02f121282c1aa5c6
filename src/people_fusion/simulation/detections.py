"""Detections made from the truth, to test a tracker without any cue: people who cross before a robot that drives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.measurements import XY_OBSERVED, Measurement, Sight
from people_fusion.core.stamps import from_seconds
from people_fusion.simulation import planar
from people_fusion.simulation.gait import GaitConfig
from people_fusion.simulation.people import ActivityConfig, BehaviourConfig, PersonConfig
from people_fusion.simulation.plan import Plan, RoomConfig, WallConfig
from people_fusion.simulation.robot import RobotConfig
from people_fusion.simulation.simulator import MAP, START_NS
from people_fusion.simulation.world import live

SIGHT_BEAMS = 541


@dataclass(frozen=True)
class DetectionsConfig:
    """People who walk to and fro in a square hall, and a sensor on a robot that drives round in it."""

    people: int = parameter(5, "how many", low=0)
    duration_s: float = parameter(60.0, "seconds", low=0.1)
    rate: float = parameter(10.0, "measurements a second", low=0.1, high=50.0)
    hall: float = parameter(14.0, "edge, metres", low=4.0)
    std: float = parameter(0.05, "of a detection in x and in y, metres", low=1e-4)
    detection_probability: float = parameter(0.9, "of a person in view", low=0.0, high=1.0)
    clutter: float = parameter(1.0, "mean number of false detections in a measurement", low=0.0)
    field_of_view: float = parameter(
        6.2832, "about straight ahead: the full circle, as two scanners have it, or less, radians", low=0.1, high=6.29
    )
    reach: float = parameter(8.0, "of the sensor, metres", low=0.5)
    confidence: float = parameter(0.9, "of each detection, true or false", low=0.0, high=1.0)
    height: float = parameter(1.5, "nominal, of heads, metres")
    cue: str = parameter("detections", "name of the cue")


Truth = Tuple[int, np.ndarray, np.ndarray]  # stamp, (N,) ids, (N, 2) positions of the people in view


def detections(config: DetectionsConfig, seed: int) -> Tuple[List[Measurement], List[Truth]]:
    """Measurements in map and the people who were in view at each of their stamps.

    Detections stand in random order. Clutter is uniform in the field of view.
    """
    walking, seeing = (np.random.default_rng([seed, config.people, purpose]) for purpose in (0, 1))
    half, lap = config.hall / 2.0, config.hall / 5.0
    square = ((-half, -half), (half, -half), (half, half), (-half, half))
    plan = Plan(RoomConfig(walls=(WallConfig(square, closed=True),)))
    wanderers = (
        (PersonConfig(config.people, activities=(ActivityConfig("wander"),), repeat=True),) if config.people else ()
    )
    way = ((lap, -lap), (lap, lap), (-lap, lap), (-lap, -lap))
    robot = RobotConfig("drive", (-lap, -lap, 0.0), way, speed=0.6)
    history = live(config.duration_s, plan, wanderers, (), BehaviourConfig(), GaitConfig(), robot, walking)

    measurements, truths = [], []
    period_s = 1.0 / config.rate
    for sequence, time in enumerate(np.arange(0.0, config.duration_s, period_s)):
        stamp_ns = START_NS + from_seconds(float(time))
        at = np.array([time])
        heads, pose = history.at("heads", at)[0, :, :2], history.at("robot", at)[0]
        offset = planar.apply(planar.inverse(pose), heads)
        bearing = np.abs(np.arctan2(offset[:, 1], offset[:, 0]))
        in_view = (np.linalg.norm(offset, axis=1) < config.reach) & (bearing < config.field_of_view / 2.0)
        truths.append((stamp_ns, np.flatnonzero(in_view) + 1, heads[in_view]))

        seen = in_view & (seeing.random(len(heads)) < config.detection_probability)
        found = heads[seen] + config.std * seeing.standard_normal((int(seen.sum()), 2))
        points = np.concatenate([found, _clutter(config, pose, seeing)])
        measurements.append(_measurement(config, stamp_ns, sequence, seeing.permutation(points), pose))
    return measurements, truths


def _clutter(config: DetectionsConfig, pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(K, 2) points uniform in the field of view."""
    count = int(rng.poisson(config.clutter))
    distance = config.reach * np.sqrt(rng.random(count))
    bearing = config.field_of_view * (rng.random(count) - 0.5)
    return planar.apply(pose, distance[:, None] * planar.direction(bearing))


def _measurement(
    config: DetectionsConfig, stamp_ns: int, sequence: int, points: np.ndarray, pose: np.ndarray
) -> Measurement:
    count = len(points)
    sight = Sight(
        pose[:2],
        float(pose[2]),
        -config.field_of_view / 2.0,
        config.field_of_view / (SIGHT_BEAMS - 1),
        np.full(SIGHT_BEAMS, config.reach),
        config.reach,
    )
    return Measurement(
        stamp_ns,
        config.cue,
        "legs",
        MAP,
        np.concatenate([points, np.full((count, 1), config.height)], axis=1),
        np.tile(np.diag([config.std**2, config.std**2, 0.0]), (count, 1, 1)),
        np.full(count, config.confidence),
        XY_OBSERVED,
        1.0 / config.rate,
        sequence,
        sight=sight,
    )
