"""A robot with two driven wheels that stands, drives along waypoints or follows a person."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError
from people_fusion.simulation import planar
from people_fusion.simulation.plan import Point


@dataclass(frozen=True)
class RobotConfig:
    """What the robot does."""

    do: str = parameter(
        "stand", "`stand`, `drive` along `way` or `follow` a person", choices=("stand", "drive", "follow")
    )
    start: Tuple[float, float, float] = parameter((0.0, 0.0, 0.0), "x, y, yaw in the room, metres and radians")
    way: Tuple[Point, ...] = parameter((), "waypoints, driven again and again, metres")
    person: int = parameter(0, "whom it follows, counted from 0", low=0)
    distance: float = parameter(1.2, "kept to the one it follows, metres", low=0.5)
    speed: float = parameter(0.8, "fastest, m/s", low=0.05, high=2.0)
    turn_rate: float = parameter(1.0, "fastest, rad/s", low=0.1, high=3.0)
    acceleration: float = parameter(0.6, "fastest change of speed, m/s^2", low=0.1)
    turn_acceleration: float = parameter(2.0, "fastest change of the turn rate, rad/s^2", low=0.1)
    radius: float = parameter(0.35, "of its body, metres", low=0.1)
    stop_distance: float = parameter(0.75, "it waits for people who are nearer than this ahead of it, metres", low=0.0)

    def __post_init__(self) -> None:
        if self.do == "drive" and not self.way:
            raise ConfigError("robot/way: needed to `drive`")


class Robot:
    """The true pose, moved on step by step.

    Attributes:
        pose: (3,) x, y, yaw in the room; the yaw is not wrapped.
    """

    def __init__(self, config: RobotConfig) -> None:
        self.config = config
        self.pose = np.array(config.start)
        self._speed, self._turn = 0.0, 0.0
        self._next = 0

    def step(self, dt: float, people: np.ndarray) -> None:
        """Drive on by `dt`; `people` (N, 2)."""
        config = self.config
        if config.do == "stand":
            return
        speed, turn = self._wanted(people)
        ahead = planar.apply(planar.inverse(self.pose), people)
        blocked = (ahead[:, 0] > 0.0) & (np.abs(ahead[:, 1]) < config.radius + 0.15)
        if np.any(blocked & (np.linalg.norm(ahead, axis=1) < config.stop_distance)):
            speed = 0.0
        self._speed += float(np.clip(speed - self._speed, -config.acceleration * dt, config.acceleration * dt))
        self._turn += float(np.clip(turn - self._turn, -config.turn_acceleration * dt, config.turn_acceleration * dt))
        self.pose = planar.compose(self.pose, np.array([self._speed * dt, 0.0, self._turn * dt]))

    def _wanted(self, people: np.ndarray) -> Tuple[float, float]:
        """Speed and turn rate towards the goal."""
        config = self.config
        if config.do == "follow":
            goal, keep = people[config.person], config.distance
        else:
            goal, keep = np.array(config.way[self._next]), 0.0
            if np.linalg.norm(goal - self.pose[:2]) < 0.3:
                self._next = (self._next + 1) % len(config.way)
        offset = goal - self.pose[:2]
        distance = float(np.linalg.norm(offset))
        error = float(planar.wrap(np.arctan2(offset[1], offset[0]) - self.pose[2]))
        turn = float(np.clip(2.0 * error, -config.turn_rate, config.turn_rate))
        gain = 1.0 if config.do == "follow" else 2.0
        speed = float(np.clip(gain * (distance - keep), 0.0, config.speed))
        return speed * max(np.cos(error), 0.0) ** 2, turn
