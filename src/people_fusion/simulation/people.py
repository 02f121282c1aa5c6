"""People who walk, stand, talk and sit, and keep out of each other's way."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, Optional, Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError
from people_fusion.simulation import planar
from people_fusion.simulation.floor import Floor
from people_fusion.simulation.gait import Gait, GaitConfig
from people_fusion.simulation.plan import Plan, Point


@dataclass(frozen=True)
class SpotConfig:
    """A place where people like to stand."""

    at: Point = parameter((0.0, 0.0), "metres")
    facing: Point = parameter((0.0, 0.0), "what they look at: an exhibit, the robot, the middle of a talk; metres")


@dataclass(frozen=True)
class ActivityConfig:
    """What a person does for a while."""

    do: str = parameter(
        "stand",
        "`walk` along `to`; `stand` or `sit` for `for_s`, at `to` if given; `visit` a free spot of the scenario and "
        "stand there for about `for_s`; `wander` to a random place",
        choices=("walk", "stand", "sit", "visit", "wander"),
    )
    to: Tuple[Point, ...] = parameter((), "waypoints of `walk`, the place of `stand` or `sit`, metres")
    for_s: float = parameter(5.0, "seconds; `visit` draws between half and one and a half of it", low=0.0)
    facing: Optional[Point] = parameter(None, "what one who stands or sits looks at, metres")
    speed: Optional[float] = parameter(
        None, "of walking; the person's own where it is left out, m/s", low=0.1, high=2.5
    )
    spin: float = parameter(
        0.0, "of the body while it walks, about the standing leg, rad/s; 0: it looks ahead", low=-12.0, high=12.0
    )


@dataclass(frozen=True)
class PersonConfig:
    """One person, or several that do the same; what is left out is drawn at random."""

    count: int = parameter(1, "how many", low=1)
    start: Optional[Point] = parameter(None, "metres; drawn on the free floor, or on a free spot if they visit")
    facing: Optional[Point] = parameter(None, "what they look at in the beginning, metres")
    activities: Tuple[ActivityConfig, ...] = parameter((), "what they do, in order")
    repeat: bool = parameter(False, "whether they start again at the end; else they stay where they are")
    speed: Optional[float] = parameter(None, "of walking, m/s; N(1.1, 0.15)", low=0.1, high=2.5)
    height: Optional[float] = parameter(None, "of the body, metres; N(1.72, 0.09)", low=0.8, high=2.3)
    leg_radius: Optional[float] = parameter(None, "at the scanners' height, metres; 0.05 to 0.07", low=0.02, high=0.15)
    hip_width: Optional[float] = parameter(None, "between the legs' middles, metres; 0.17 to 0.24", low=0.05, high=0.5)
    lean: Optional[float] = parameter(None, "of the head before the hips, metres; 0.00 to 0.08", low=-0.3, high=0.5)
    darkness: float = parameter(0.0, "of the trousers, see scanners/reference_range", low=0.0, high=1.0)


@dataclass(frozen=True)
class BehaviourConfig:
    """How people move."""

    relaxation_s: float = parameter(0.4, "time in which one reaches the wanted velocity, seconds", low=0.05)
    turn_rate: float = parameter(2.5, "fastest turn of the body, rad/s", low=0.1)
    sway_std: float = parameter(0.015, "of a standing body about its place, metres", low=0.0)
    sway_time_s: float = parameter(3.0, "correlation time of the sway, seconds", low=0.1)
    weight_shift: float = parameter(0.05, "sideways when the weight goes to the other leg, metres", low=0.0)
    weight_shift_period_s: float = parameter(12.0, "mean time between such shifts, seconds", low=0.5)
    head_std: float = parameter(0.02, "of the head about its place before the hips, metres", low=0.0)
    head_time_s: float = parameter(2.0, "correlation time of that, seconds", low=0.1)
    body_radius: float = parameter(0.22, "of people, whose bodies do not overlap, metres", low=0.1)
    wall_clearance: float = parameter(0.13, "of a body's middle from any surface, metres", low=0.05)
    personal_space: float = parameter(0.25, "reach of the force between people, metres", low=0.05)
    personal_force: float = parameter(2.5, "force between people who touch, m/s^2", low=0.0)
    wall_reach: float = parameter(0.12, "reach of the force from surfaces, metres", low=0.02)
    wall_force: float = parameter(4.0, "force of a surface that is touched, m/s^2", low=0.0)


@dataclass
class _Agenda:
    """What one person is about."""

    config: PersonConfig
    number: int = -1
    until_s: float = 0.0
    way: Tuple[np.ndarray, ...] = ()
    speed: float = 1.0
    spin: float = 0.0
    place: np.ndarray = None  # type: ignore[assignment]
    facing: Optional[np.ndarray] = None
    sits: bool = False
    spot: int = -1
    stand_s: float = 0.0


class People:
    """Bodies, heads and feet of N people, moved on step by step.

    Attributes:
        centres, velocities: (N, 2) of the hips, metres and m/s.
        headings: (N,) where the bodies point, radians.
        leg_radii, darkness, heights: (N,).

    Args:
        floor: where they can walk.
        robot: (2,) where the robot stands at the start.
    """

    def __init__(
        self,
        persons: Tuple[PersonConfig, ...],
        spots: Tuple[SpotConfig, ...],
        behaviour: BehaviourConfig,
        gait: GaitConfig,
        plan: Plan,
        floor: Floor,
        robot: np.ndarray,
        rng: np.random.Generator,
    ) -> None:
        self._behaviour, self._plan, self._floor, self._rng = behaviour, plan, floor, rng
        self._spots = spots
        self._agendas = [_Agenda(person) for person in persons for _ in range(person.count)]
        count = len(self._agendas)
        self.centres = self._starts(robot)
        self.velocities = np.zeros((count, 2))
        self._speeds = self._draw("speed", rng.normal(1.1, 0.15, count).clip(0.6, 1.6))
        self.heights = self._draw("height", rng.normal(1.72, 0.09, count).clip(1.5, 2.0))
        self.leg_radii = self._draw("leg_radius", rng.uniform(0.05, 0.07, count))
        self._leans = self._draw("lean", rng.uniform(0.0, 0.08, count))
        self.darkness = np.array([agenda.config.darkness for agenda in self._agendas])
        hip_widths = self._draw("hip_width", rng.uniform(0.17, 0.24, count))
        self.headings = rng.uniform(-np.pi, np.pi, count)
        for person, agenda in enumerate(self._agendas):
            agenda.place = self.centres[person].copy()
            facing = self._spots[agenda.spot].facing if agenda.spot >= 0 else agenda.config.facing
            if facing is not None:
                agenda.facing = np.array(facing)
                self.headings[person] = np.arctan2(*(agenda.facing - agenda.place)[::-1])
        self._gait = Gait(gait, self.centres, self.headings, hip_widths)
        self._seated = np.zeros(count)
        self._sway = rng.normal(0.0, behaviour.sway_std, (count, 2))
        self._shift = np.zeros(count)
        self._head = rng.normal(0.0, behaviour.head_std, (count, 2))
        self._begin(0.0)
        self._seated = np.array([float(agenda.sits) for agenda in self._agendas])

    def __len__(self) -> int:
        return len(self._agendas)

    def place(self, person: int) -> np.ndarray:
        """(2,) centre of a person."""
        return self.centres[person]

    @property
    def legs(self) -> np.ndarray:
        """(N, 2, 2) middles of the left and right leg at the scanners' height."""
        legs = self._gait.legs(self.centres, self.headings, self._seated)
        flat = legs.reshape(-1, 2)
        return legs + self._plan.push_out(flat, np.repeat(self.leg_radii, 2)).reshape(legs.shape)

    @property
    def heads(self) -> np.ndarray:
        """(N, 3) middles of the heads."""
        level = self.centres + self._leans[:, None] * planar.direction(self.headings) + self._head
        height = (self.heights - 0.12) * (1.0 - 0.28 * self._seated)
        return np.concatenate([level, height[:, None]], axis=1)

    def step(self, now_s: float, dt: float, robot: np.ndarray, robot_radius: float) -> None:
        """Move on by `dt`; `robot` (2,) is kept clear of."""
        config = self._behaviour
        self._begin(now_s)
        self._fidget(dt)
        walking = np.array([bool(agenda.way) for agenda in self._agendas], dtype=bool)
        sitting = np.array([agenda.sits for agenda in self._agendas], dtype=bool)
        wanted = np.array([self._wanted(person) for person in range(len(self))]).reshape(-1, 2)
        force = self._forces(walking, robot, robot_radius)
        force[sitting] = 0.0
        self.velocities += dt * ((wanted - self.velocities) / config.relaxation_s + force)
        speed = np.linalg.norm(self.velocities, axis=1, keepdims=True)
        limit = 1.4 * np.array([agenda.speed for agenda in self._agendas])[:, None]
        self.velocities *= np.minimum(1.0, limit / np.maximum(speed, 1e-9))
        before = self.centres
        self.centres = before + dt * self.velocities
        self._separate(sitting, robot, robot_radius, dt)
        self._turn(walking, dt)
        self._seated = np.clip(self._seated + np.where(sitting, dt, -dt), 0.0, 1.0)
        self._gait.step(dt, self.centres, (self.centres - before) / dt, self.headings)

    def _draw(self, name: str, drawn: np.ndarray) -> np.ndarray:
        """(N,) the configured values where there are any, the drawn ones else."""
        given = [getattr(agenda.config, name) for agenda in self._agendas]
        return np.array([draw if value is None else value for value, draw in zip(given, drawn)])

    def _starts(self, robot: np.ndarray) -> np.ndarray:
        """(N, 2) configured or random places, at least 0.8 m from each other and from the robot."""
        taken: List[np.ndarray] = [np.asarray(robot)]
        taken += [np.array(agenda.config.start) for agenda in self._agendas if agenda.config.start is not None]
        starts = []
        for agenda in self._agendas:
            visits = bool(self._spots) and any(activity.do == "visit" for activity in agenda.config.activities)
            if agenda.config.start is not None:
                starts.append(np.array(agenda.config.start))
                continue
            if visits:
                agenda.spot = self._free_spot(-1)
                starts.append(np.array(self._spots[agenda.spot].at))
                continue
            for _ in range(1000):
                place = self._floor.random_place(self._rng)
                if all(np.linalg.norm(place - other) > 0.8 for other in taken):
                    break
            else:
                raise ConfigError(f"people: no room for {len(self._agendas)} people")
            taken.append(place)
            starts.append(place)
        return np.array(starts).reshape(-1, 2)

    def _begin(self, now_s: float) -> None:
        """Start the next activity of everyone who has done with the last."""
        for person, agenda in enumerate(self._agendas):
            if agenda.way or now_s < agenda.until_s:
                continue
            if agenda.stand_s > 0.0:  # arrived at a spot
                agenda.until_s, agenda.stand_s = now_s + agenda.stand_s, 0.0
                continue
            activities = agenda.config.activities
            agenda.number += 1
            if agenda.number >= len(activities):
                if not (agenda.config.repeat and activities):
                    agenda.until_s = np.inf
                    continue
                agenda.number = 0
            self._start(person, agenda, activities[agenda.number], now_s)

    def _start(self, person: int, agenda: _Agenda, activity: ActivityConfig, now_s: float) -> None:
        agenda.sits = activity.do == "sit"
        agenda.speed = self._speeds[person] if activity.speed is None else activity.speed
        agenda.until_s, agenda.spin = now_s, activity.spin
        if activity.facing is not None:
            agenda.facing = np.array(activity.facing)
        if activity.do == "walk":
            self._walk(agenda, np.array(activity.to).reshape(-1, 2))
        elif activity.do == "visit":
            agenda.spot = self._free_spot(agenda.spot)
            spot = self._spots[agenda.spot]
            self._walk(agenda, self._floor.route(self.centres[person], np.array(spot.at)))
            agenda.facing = np.array(spot.facing)
            agenda.stand_s = activity.for_s * self._rng.uniform(0.5, 1.5)
        elif activity.do == "wander":
            self._walk(agenda, self._floor.route(self.centres[person], self._floor.random_place(self._rng)))
        else:
            agenda.until_s = now_s + activity.for_s
            if activity.to:
                agenda.place = np.array(activity.to[-1])

    def _walk(self, agenda: _Agenda, way: np.ndarray) -> None:
        agenda.way, agenda.facing = tuple(way), None
        if len(way):
            agenda.place = way[-1]

    def _free_spot(self, current: int) -> int:
        if not self._spots:
            raise ConfigError("people: `visit` needs `spots`")
        taken = {agenda.spot for agenda in self._agendas}
        free = [spot for spot in range(len(self._spots)) if spot not in taken]
        return int(self._rng.choice(free)) if free else current

    def _wanted(self, person: int) -> np.ndarray:
        """(2,) velocity that a person would have alone."""
        agenda, centre = self._agendas[person], self.centres[person]
        if agenda.way:
            to_goal = agenda.way[0] - centre
            distance = float(np.linalg.norm(to_goal))
            last = len(agenda.way) == 1
            if distance < (0.15 if last else 0.4):
                agenda.way = agenda.way[1:]
            speed = min(agenda.speed, distance / 0.5 + 0.1) if last else agenda.speed
            ahead: np.ndarray = to_goal / max(distance, 1e-9) * speed
            return ahead
        sideways = self._shift[person] * planar.direction(self.headings[person] + np.pi / 2.0)
        to_place = agenda.place + self._sway[person] + sideways - centre
        pull: np.ndarray = to_place * min(1.0, 0.5 / max(float(np.linalg.norm(to_place)), 1e-9))
        return pull

    def _fidget(self, dt: float) -> None:
        """Sway of bodies and heads (Ornstein-Uhlenbeck), weight from one leg to the other."""
        config, rng, count = self._behaviour, self._rng, len(self)
        for state, std, time_s in (
            (self._sway, config.sway_std, config.sway_time_s),
            (self._head, config.head_std, config.head_time_s),
        ):
            keep = np.exp(-dt / time_s)
            state *= keep
            state += np.sqrt(1.0 - keep**2) * std * rng.standard_normal((count, 2))
        shifts = rng.random(count) < dt / config.weight_shift_period_s
        self._shift[shifts] = config.weight_shift * rng.uniform(-1.0, 1.0, count)[shifts]

    def _forces(self, walking: np.ndarray, robot: np.ndarray, robot_radius: float) -> np.ndarray:
        """(N, 2) social forces (Helbing and Molnar 1995): from people, the robot and surfaces."""
        config = self._behaviour
        force = np.zeros((len(self), 2))
        others = np.concatenate([self.centres, robot[None]])
        contact = np.full(len(others), 2.0 * config.body_radius)
        contact[-1] = config.body_radius + robot_radius
        away = self.centres[:, None] - others
        distance = np.linalg.norm(away, axis=2)
        np.fill_diagonal(distance, np.inf)
        unit = away / np.maximum(distance, 1e-9)[..., None]
        strength = config.personal_force * np.exp((contact - distance) / config.personal_space)
        ahead = -np.einsum("nki,ni->nk", unit, planar.direction(self.headings))
        strength *= 0.3 + 0.35 * (1.0 + ahead)
        by_walker = np.append(walking, False)
        strength *= np.where(walking[:, None], 1.0, np.where(by_walker, 0.3, 0.0))  # who stands yields to walkers only
        keep_right = unit + 0.4 * np.stack([unit[..., 1], -unit[..., 0]], axis=-1) * walking[:, None, None]
        force += np.einsum("nk,nki->ni", strength, keep_right)
        near_place = np.array([len(agenda.way) == 1 for agenda in self._agendas], dtype=bool)
        weight = np.where(walking, np.where(near_place, 0.3, 1.0), 0.0)
        return force + config.wall_force * weight[:, None] * self._plan.repulsion(self.centres, config.wall_reach)

    def _separate(self, sitting: np.ndarray, robot: np.ndarray, robot_radius: float, dt: float) -> None:
        """Push apart bodies that overlap, and out of surfaces; no faster than people move."""
        config = self._behaviour
        before = self.centres.copy()
        movable = ~sitting
        for _ in range(3):
            away = self.centres[:, None] - self.centres
            distance = np.linalg.norm(away, axis=2)
            np.fill_diagonal(distance, np.inf)
            depth = np.maximum(2.0 * config.body_radius - distance, 0.0)
            share = np.where(movable[None], 0.5, 1.0)  # of the way out: all of it beside one who sits
            shift = np.sum(away / np.maximum(distance, 1e-9)[..., None] * (share * depth)[..., None], axis=1)
            from_robot = self.centres - robot
            gap = np.maximum(np.linalg.norm(from_robot, axis=1, keepdims=True), 1e-9)
            shift += from_robot / gap * np.maximum(config.body_radius + robot_radius - gap, 0.0)
            shift += self._plan.push_out(self.centres, np.full(len(self), config.wall_clearance))
            self.centres = self.centres + shift * movable[:, None]
        shift = self.centres - before
        length = np.linalg.norm(shift, axis=1, keepdims=True)
        self.centres = before + shift * np.minimum(1.0, 1.5 * dt / np.maximum(length, 1e-9))

    def _turn(self, walking: np.ndarray, dt: float) -> None:
        """Bodies turn to where they go or to what they look at; or merely turn."""
        goal = self.headings.copy()
        for person, agenda in enumerate(self._agendas):
            velocity = self.velocities[person]
            if walking[person] and velocity @ velocity > 0.04:
                goal[person] = np.arctan2(velocity[1], velocity[0])
            elif agenda.facing is not None:
                goal[person] = np.arctan2(*(agenda.facing - self.centres[person])[::-1])
        rate = np.clip(4.0 * planar.wrap(goal - self.headings), -self._behaviour.turn_rate, self._behaviour.turn_rate)
        spin = np.array([agenda.spin for agenda in self._agendas])
        self.headings = self.headings + dt * np.where(walking & (spin != 0.0), spin, rate)
