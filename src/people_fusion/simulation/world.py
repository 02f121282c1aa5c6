"""What really happened: people and robot move together, and every sensor looks at the same history."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.simulation.floor import Floor
from people_fusion.simulation.gait import GaitConfig
from people_fusion.simulation.people import BehaviourConfig, People, PersonConfig, SpotConfig
from people_fusion.simulation.plan import Plan
from people_fusion.simulation.robot import Robot, RobotConfig

STEP_S = 0.02
MARGIN_S = 1.0  # of history after the end, for sweeps that begin just before it


@dataclass(frozen=True, eq=False)
class History:
    """The truth in steps of STEP_S from 0, in the room's frame (map).

    Attributes:
        robot: (T, 3) x, y, yaw (not wrapped) of the robot's base.
        heads: (T, N, 3) metres.
        velocities: (T, N, 2) of the hips, m/s.
        headings: (T, N) radians, not wrapped.
        legs: (T, N, 2, 2) middles of left and right leg at the scanners' height.
        leg_radii, darkness: (N,).
    """

    robot: np.ndarray
    heads: np.ndarray
    velocities: np.ndarray
    headings: np.ndarray
    legs: np.ndarray
    leg_radii: np.ndarray
    darkness: np.ndarray

    def at(self, name: str, times_s: np.ndarray) -> np.ndarray:
        """(K, ...) one of the arrays over time, interpolated at times (K,)."""
        values = getattr(self, name)
        place = np.clip(np.asarray(times_s) / STEP_S, 0.0, len(values) - 1.000001)
        before = place.astype(int)
        share = (place - before).reshape((-1,) + (1,) * (values.ndim - 1))
        result: np.ndarray = values[before] + share * (values[before + 1] - values[before])
        return result


def live(
    duration_s: float,
    plan: Plan,
    people: Tuple[PersonConfig, ...],
    spots: Tuple[SpotConfig, ...],
    behaviour: BehaviourConfig,
    gait: GaitConfig,
    robot: RobotConfig,
    rng: np.random.Generator,
) -> History:
    """Let people and robot move for `duration_s`.

    Raises:
        ConfigError: there is no room for them.
    """
    driver = Robot(robot)
    floor = Floor(plan, driver.pose[:2], clearance=0.35)
    crowd = People(people, spots, behaviour, gait, plan, floor, driver.pose[:2], rng)
    steps = int(np.ceil((duration_s + MARGIN_S) / STEP_S)) + 1
    poses = np.zeros((steps, 3))
    heads = np.zeros((steps, len(crowd), 3))
    velocities = np.zeros((steps, len(crowd), 2))
    headings = np.zeros((steps, len(crowd)))
    legs = np.zeros((steps, len(crowd), 2, 2))
    for step in range(steps):
        poses[step], heads[step], legs[step] = driver.pose, crowd.heads, crowd.legs
        velocities[step], headings[step] = crowd.velocities, crowd.headings
        driver.step(STEP_S, crowd.centres)
        crowd.step(step * STEP_S, STEP_S, driver.pose[:2], robot.radius)
    return History(poses, heads, velocities, headings, legs, crowd.leg_radii, crowd.darkness)
