"""People as pairs of legs that are near each other and move alike (Arras et al. 2012, 3.3)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import permutations
from typing import Callable, Dict, List, NamedTuple, Optional, Set, Tuple

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.stamps import from_seconds
from people_fusion.filtering.kalman import predict
from people_fusion.filtering.motion_models.damped_velocity import DampedVelocity, DampedVelocityConfig
from people_fusion.tracking.leg_hypotheses import APPROVED, BESIDE, FREE, LegTracks

PLANE = (0, 1, 3, 4)  # of x y z vx vy
Pair = Tuple[int, int]  # identities of two legs, the lower first


@dataclass(frozen=True)
class PeopleConfig:
    """When two legs are a person."""

    leg_distance: float = parameter(0.75, "theta_d: legs farther apart are not one person's, metres", low=0.0)
    window: int = parameter(20, "L: scans over which legs are compared, and for which a person outlives a leg", low=1)
    agreement: float = parameter(
        4.0, "theta_a: sum over the window of the cosine between both legs' ways from which they are a person"
    )
    least_way: float = parameter(0.25, "a leg that moved less over the window has no direction, metres", low=0.0)
    stale_s: float = parameter(
        0.4, "a leg that was not seen for longer makes way for a free one that is, seconds", low=0.0
    )
    hidden_s: float = parameter(
        5.0, "legs of a person of whom nothing was seen for longer are no longer approved, and so end, seconds", low=0.0
    )
    half_step_std: float = parameter(0.15, "of a leg about the middle of the body, by axis, metres", low=1e-3)
    half_swing_std: float = parameter(0.6, "of a leg's velocity about the body's, by axis, m/s", low=1e-3)
    together_s: float = parameter(
        0.3, "after which a leg that is not seen may be anywhere within a step of the one that is, seconds", low=1e-3
    )
    body_std: float = parameter(0.05, "of the body's middle about the middle of its legs, by axis, metres", low=0.0)
    hidden_motion: DampedVelocityConfig = section(DampedVelocityConfig, "of legs of people that are not seen")


class Person(NamedTuple):
    """One person.

    Attributes:
        id: never given twice.
        legs: identities of one or two legs.
        amiss: scans for which a leg was missing or the legs too far apart.
        born_ns: when it was validated.
        seen_ns: when a leg of it was last seen.
    """

    id: int
    legs: Tuple[int, ...]
    amiss: int
    born_ns: int
    seen_ns: int


class People(NamedTuple):
    """All people, and what the last scans told of legs.

    Attributes:
        persons: who is there.
        trails: positions of each leg over the window.
        agreement: of each pair that is near: cosines between both legs' ways, over the window.
    """

    persons: Tuple[Person, ...]
    trails: Dict[int, Tuple[Tuple[float, float], ...]]
    agreement: Dict[Pair, Tuple[float, ...]]

    @staticmethod
    def nobody() -> People:
        """Before the first scan."""
        return People((), {}, {})

    def kinds(self, legs: LegTracks, stamp_ns: int, config: PeopleConfig) -> np.ndarray:
        """(T,) whether tracks are legs of people, beside these, or neither.

        The paper approves them for ever; but then scan-back decides for «occluded» before «deleted» can win. And with
        its probabilities a person of three legs is likelier than one of two, as the third, which is free, is detected
        with 0.3 and not 0.2, while 0.79 is all that the one costs that is then not seen. But what hides legs there
        hides the free one, too.
        """
        since_ns = stamp_ns - from_seconds(config.hidden_s)
        approved = np.isin(
            legs.ids, [leg for person in self.persons if person.seen_ns >= since_ns for leg in person.legs]
        )
        apart = np.linalg.norm(legs.means[:, None, :2] - legs.means[None, approved, :2], axis=2)
        beside = apart.min(axis=1, initial=np.inf) < config.leg_distance
        return np.where(approved, APPROVED, np.where(beside, BESIDE, FREE))


def recognise(
    people: People, legs: LegTracks, stamp_ns: int, config: PeopleConfig, identity: Callable[[Tuple[int, ...]], int]
) -> People:
    """People after a scan.

    Beyond the paper, where a person ends with either leg, the one that is left is kept for the window's length, and a
    free leg that appears beside it takes the place of one that is gone or not seen any more. And a leg's direction is
    that of its way over the window, not of its velocity: of two legs that walk, one stands.

    Args:
        people: before the scan.
        legs: tracks of the best hypothesis.
        stamp_ns: of the scan.
        config: thresholds.
        identity: of a person who is first seen with these legs.
    """
    row = {leg: place for place, leg in enumerate(legs.ids.tolist())}
    apart = np.hypot(*(legs.means[:, None, :2] - legs.means[None, :, :2]).transpose(2, 0, 1))
    near = apart < config.leg_distance
    trails = {
        leg: (*people.trails.get(leg, ()), (x, y))[-config.window - 1 :]
        for leg, (x, y) in zip(legs.ids.tolist(), legs.means[:, :2].tolist())
    }
    agreement = _agreement(people.agreement, legs, trails, near, config)
    persons: List[Person] = []
    fresh = {
        leg
        for leg, seen_ns in zip(legs.ids.tolist(), legs.seen_ns.tolist())
        if stamp_ns - seen_ns <= from_seconds(config.stale_s)
    }
    taken: Set[int] = {leg for person in people.persons for leg in person.legs}
    for person in people.persons:
        left = tuple(leg for leg in person.legs if leg in row)
        seen_now = tuple(leg for leg in left if leg in fresh)
        if left and len(seen_now) < 2:
            # A leg that is not seen any more may be the one that has just appeared.
            kept = (seen_now or left)[0]
            other = _free_leg(row[kept], legs, apart, near, fresh - taken)
            if other is not None:
                taken.add(other)
                persons.append(person._replace(legs=(kept, other), amiss=0))
                continue
        if len(left) == 2 and near[row[left[0]], row[left[1]]]:
            persons.append(person._replace(legs=left, amiss=0))
        elif left and person.amiss < config.window:
            persons.append(person._replace(legs=left, amiss=person.amiss + 1))
    taken = {leg for person in persons for leg in person.legs}
    for pair in sorted(agreement, key=lambda entry: (-sum(agreement[entry]), entry)):
        if sum(agreement[pair]) <= config.agreement:
            break
        if not taken.intersection(pair):
            taken.update(pair)
            name = identity(pair)
            if any(person.id == name for person in persons):  # who began with these legs has others by now
                name = identity((*pair, stamp_ns))
            persons.append(Person(name, pair, 0, stamp_ns, stamp_ns))
    seen = dict(zip(legs.ids.tolist(), legs.seen_ns.tolist()))
    persons = [person._replace(seen_ns=max(seen[leg] for leg in person.legs)) for person in persons]
    return People(tuple(persons), trails, agreement)


def accompany(
    before: LegTracks,
    ahead: LegTracks,
    best: Tuple[int, ...],
    people: People,
    stamp_ns: int,
    duration_s: float,
    config: PeopleConfig,
) -> LegTracks:
    """Legs of people that the last scan did not show, predicted with the person (beyond the paper).

    By itself a track that is not seen is soon anywhere, with the noise of a leg that swings, and what it becomes again
    is a new one. But legs are at c + h and c - h with the half step h ~ N(0, H). So a leg x beside one that is seen, a,
    is an Ornstein-Uhlenbeck process about it, x - a -> N(0, 4 H), which neither sharpens with each scan nor spreads
    without bounds, and tells nothing of a. Two that are not seen go with their mean velocity. Both move as a body
    does, whose velocity is not forgotten as soon as a leg's.

    Args:
        before: tracks at the last scan.
        ahead: the same tracks, predicted.
        best: rows of the best hypothesis.
        people: after the last scan.
        stamp_ns: of the last scan.
        duration_s: that tracks were predicted by.
        config: see PeopleConfig.
    """
    row = {int(before.ids[place]): place for place in best}
    means, covariances = ahead.means.copy(), ahead.covariances.copy()
    transition, noise = (
        matrix[np.ix_(PLANE, PLANE)] for matrix in DampedVelocity(config.hidden_motion).transition(duration_s)
    )
    kept, step = float(np.exp(-duration_s / config.together_s)), 4.0 * _half_step(config)
    for person in people.persons:
        for leg, other in permutations(person.legs, 2):
            beside = row[other]
            for place in np.flatnonzero((before.ids == leg) & (before.seen_ns < stamp_ns)).tolist():
                mean, covariance = before.means[place].copy(), before.covariances[place]
                if before.seen_ns[beside] < stamp_ns:
                    mean[2:] = 0.5 * (mean[2:] + before.means[beside, 2:])
                mean, covariance = predict(mean, covariance, transition, noise)
                if before.seen_ns[beside] == stamp_ns:
                    mean = ahead.means[beside] + kept * (mean - ahead.means[beside])
                    covariance = kept**2 * covariance + (1.0 - kept**2) * (ahead.covariances[beside] + step)
                means[place], covariances[place] = mean, covariance
    return ahead._replace(means=means, covariances=covariances)


def bodies(people: People, legs: LegTracks, config: PeopleConfig) -> Tuple[np.ndarray, np.ndarray]:
    """Means (P, 4) and covariances (P, 4, 4) of the people, whose legs are all in `legs`.

    The paper takes the weighted mean of both legs; but that lies nearer to the leg that is known better, which is not
    where the body is. Legs are at c + h + e_a and c - h + e_b, with the half step h ~ N(0, H): the best linear estimate
    of c is their middle where both are known alike, and one leg with the covariance P + H where it is alone.
    """
    row = {leg: place for place, leg in enumerate(legs.ids.tolist())}
    H = _half_step(config)
    means, covariances = np.zeros((len(people.persons), 4)), np.zeros((len(people.persons), 4, 4))
    for place, person in enumerate(people.persons):
        rows = [row[leg] for leg in person.legs]
        mean, covariance = legs.means[rows[0]], legs.covariances[rows[0]] + H
        if len(rows) == 2:
            P, R = legs.covariances[rows]
            a, b = legs.means[rows]
            middle, half = 0.5 * (a + b), 0.5 * (a - b)
            gain = 0.25 * (P - R) @ np.linalg.inv(H + 0.25 * (P + R))
            mean, covariance = middle - gain @ half, 0.25 * (P + R) - gain @ (0.25 * (P - R))
        means[place] = mean
        covariances[place] = 0.5 * (covariance + covariance.T)
        covariances[place, [0, 1], [0, 1]] += config.body_std**2
    return means, covariances


def _half_step(config: PeopleConfig) -> np.ndarray:
    """(4, 4) covariance of a leg about the middle of the body."""
    return np.diag([config.half_step_std**2] * 2 + [config.half_swing_std**2] * 2)


def _agreement(
    before: Dict[Pair, Tuple[float, ...]],
    legs: LegTracks,
    trails: Dict[int, Tuple[Tuple[float, float], ...]],
    near: np.ndarray,
    config: PeopleConfig,
) -> Dict[Pair, Tuple[float, ...]]:
    """Cosines of the angle between both legs' ways, by pair that is near, over the window."""
    starts = np.array([trails[leg][0] for leg in legs.ids.tolist()]).reshape(-1, 2)
    ways = legs.means[:, :2] - starts
    lengths = np.hypot(ways[:, 0], ways[:, 1])
    directions = np.where((lengths > config.least_way)[:, None], ways / np.maximum(lengths, 1e-9)[:, None], 0.0)
    cosines = directions @ directions.T
    now: Dict[Pair, Tuple[float, ...]] = {}
    for i, j in zip(*(rows.tolist() for rows in np.nonzero(np.triu(near, 1)))):
        pair = (min(legs.ids[i], legs.ids[j]), max(legs.ids[i], legs.ids[j]))
        key = (int(pair[0]), int(pair[1]))
        now[key] = (*before.get(key, ()), float(cosines[i, j]))[-config.window :]
    return now


def _free_leg(place: int, legs: LegTracks, apart: np.ndarray, near: np.ndarray, free: Set[int]) -> Optional[int]:
    """The nearest free leg beside this one."""
    beside = [other for other in np.flatnonzero(near[place]).tolist() if int(legs.ids[other]) in free]
    if not beside:
        return None
    return int(legs.ids[min(beside, key=lambda other: (float(apart[place, other]), other))])
