"""A Kalman filter per person, all of them as arrays; motion, assignment, duplicates and lifecycle are parts.

With its parts chosen by config/poschmann_t1.yaml it is the tracker of Poschmann 2018, 3.2; by config/volkhardt.yaml
that of Volkhardt 2013, III-C.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from dataclasses import dataclass
from typing import Dict, Optional, Tuple

import numpy as np
from scipy.special import ndtr

from people_fusion.association.gates import coarse_pairs
from people_fusion.association.method import ASSIGNMENT_METHODS
from people_fusion.association.methods.optimal import OptimalConfig
from people_fusion.core.config import component, parameter
from people_fusion.core.gaussians import mahalanobis_squared
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Measurement
from people_fusion.core.tracks import Tracks
from people_fusion.filtering.kalman import (
    consider_fading,
    consider_innovation_covariances,
    consider_update,
    predict,
    update,
)
from people_fusion.filtering.motion import MOTION_MODELS
from people_fusion.filtering.motion_models.near_constant_velocity import NearConstantVelocityConfig
from people_fusion.tracking.duplicates import fuse_duplicates
from people_fusion.tracking.identities import Identities
from people_fusion.tracking.lifecycle import LIFECYCLES, Evidence
from people_fusion.tracking.lifecycles.bayes import BayesConfig
from people_fusion.tracking.plausible import plausible
from people_fusion.tracking.slow_errors import shared_errors, slow_errors
from people_fusion.tracking.table import SHARED, TrackTable
from people_fusion.tracking.tracker import TRACKERS, Tracker

SITTING_HEAD, SITTING_SPREAD = 1.28, 0.06  # height of the heads of which half sit, and how soon that changes, metres
SHAPELY = 0.5  # confidence from which a cue that sees whole people says that something is none but a person
SURE_STDS = 2.0  # by which a head may be higher than it is believed to be


@dataclass(frozen=True)
class KalmanConfig:
    """Parts and thresholds of the Kalman tracker."""

    motion: object = component(MOTION_MODELS, NearConstantVelocityConfig, "motion model")
    assignment: object = component(ASSIGNMENT_METHODS, OptimalConfig, "assignment method")
    lifecycle: object = component(LIFECYCLES, BayesConfig, "when a track is a person and when it ends")
    gate: float = parameter(11.345, "largest squared Mahalanobis distance of a pair", low=0.0)
    cost: str = parameter(
        "likelihood",
        "of a pair: its squared Mahalanobis `distance`, or its `likelihood`, that is log |S| more",
        choices=("distance", "likelihood"),
    )
    unlikely_cost: float = parameter(
        6.0, "`likelihood` cost from which track and detection rather have nothing to do with each other"
    )
    sequential: bool = parameter(False, "detections one by one, so that a track may take several (Volkhardt)")
    head_height: float = parameter(1.5, "height of a new track whose height is not observed, metres")
    duplicates_gate: float = parameter(0.0, "squared distance of detections of one cue that are fused; 0: off", low=0.0)
    birth_distance: float = parameter(0.0, "no new track so close to a matched one, metres", low=0.0)
    merge_distance: float = parameter(0.0, "tracks so close, moving alike, become one; 0: off, metres", low=0.0)
    merge_speed: float = parameter(0.5, "moving alike: difference of velocities below this, m/s", low=0.0)
    prune_by_map: bool = parameter(False, "drop detections and tracks in the map's occupied cells")
    body_half_width: float = parameter(0.2, "of what a sensor could see of a person, metres", low=0.01)
    rest_distance: float = parameter(0.4, "who stays within this distance of a place rests there, metres", low=0.0)
    still_std: float = parameter(0.02, "of what is known to stand still after a second, metres", low=0.0)
    offset_stds: Dict[str, float] = parameter(
        {},
        "by modality: how far a body may be from where its detections are on average, by axis; slow, so that no filter"
        " may average it away: it is added to the output, metres",
        low=0.0,
    )
    sitting_stds: Dict[str, float] = parameter(
        {}, "by modality, the same between detections and the head of who sits; a miss of theirs says little", low=0.0
    )
    gait_s: float = parameter(
        0.0, "the same along the way of who walks: by how many seconds a body is ahead of its legs or behind", low=0.0
    )
    shared_error: str = parameter(
        "add",
        "slow pose error that detections share: `add` it to the output as it is at the last detection, or `consider` it"
        " as a Schmidt-Kalman state",
        choices=("add", "consider"),
    )
    shared_error_time_s: float = parameter(20.0, "correlation time of the considered error, seconds", low=1e-3)


@dataclass(frozen=True, eq=False)
class _State:
    """All that changes from measurement to measurement."""

    stamp_ns: Optional[int]
    table: TrackTable
    shared_covariance: np.ndarray


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Assigned pairs: rows of tracks (M,) and detections (M,), innovations (M, m), their covariances (M, m, m)."""

    tracks: np.ndarray
    detections: np.ndarray
    innovations: np.ndarray
    covariances: np.ndarray
    distances: np.ndarray


@TRACKERS.register("kalman", KalmanConfig)
class KalmanTracker(Tracker):
    """See the module."""

    def __init__(self, config: KalmanConfig) -> None:
        self.config = config
        self._motion = MOTION_MODELS.build(config.motion)
        self._assignment = ASSIGNMENT_METHODS.build(config.assignment)
        self._lifecycle = LIFECYCLES.build(config.lifecycle)
        self._still_noise = np.zeros((self._motion.dimension, self._motion.dimension))
        self._still_noise[[0, 1], [0, 1]] = config.still_std**2
        self._considers = config.shared_error == "consider"
        self._state = self._initial_state()
        self._identities = Identities()
        self._grid: Optional[OccupancyGrid] = None
        self._counts: Counter = Counter()

    @property
    def stamp_ns(self) -> Optional[int]:
        """See Tracker."""
        return self._state.stamp_ns

    def process(self, measurement: Measurement) -> None:
        """See Tracker. The steps are those of Volkhardt's figure 2."""
        measurement = self._drop_mapped(self._drop_implausible(measurement))
        if self.config.duplicates_gate > 0:
            measurement = fuse_duplicates(measurement, self.config.duplicates_gate)
        duration_s, age_s = self._predict(measurement)
        if self.config.sequential and len(measurement) > 1:
            matched, new, confidences, likelihoods = self._update_one_by_one(measurement, age_s)
        else:
            matched, new, confidences, likelihoods = self._update(measurement, age_s)
        self._judge(Evidence(
            measurement, self._now, duration_s, matched, new, confidences, likelihoods, self._visible(measurement)
        ))  # fmt: skip
        self._merge()
        self._prune_mapped()

    def tracks(self, stamp_ns: Optional[int] = None) -> Tracks:
        """See Tracker."""
        table, now = self._state.table, self._state.stamp_ns
        if now is None:
            now = stamp_ns or 0
        duration_s = 0.0
        if stamp_ns is not None and stamp_ns > now:
            duration_s, now = (stamp_ns - now) / 1e9, stamp_ns
        means, covariances = self._moved(table, *self._motion.transition(duration_s), duration_s)
        if len(table):
            covariances[:, :3, :3] += table.shared_floor
            steps = self.config.gait_s * means[:, 3:5]
            covariances[:, :2, :2] += steps[:, :, None] * steps[:, None, :]
        return Tracks(
            stamp_ns=now,
            frame_id="",
            ids=table.ids.copy(),
            means=means,
            covariances=covariances,
            existence=table.existence.copy(),
            confirmed=table.confirmed.copy(),
            matched=table.matched.copy(),
            occluded=table.occluded.copy(),
            ages_s=(now - table.born_ns) / 1e9,
        )

    def snapshot(self) -> object:
        """See Tracker."""
        return self._state

    def restore(self, snapshot: object) -> None:
        """See Tracker."""
        assert isinstance(snapshot, _State)
        self._state = snapshot

    def reset(self) -> None:
        """See Tracker."""
        self._state = self._initial_state()
        self._identities.reset()

    def set_map(self, grid: Optional[OccupancyGrid]) -> None:
        """See Tracker."""
        self._grid = grid

    def counters(self) -> Dict[str, int]:
        """See Tracker."""
        return dict(self._counts)

    # Steps of `process`, in its order

    def _drop_implausible(self, measurement: Measurement) -> Measurement:
        kept = plausible(measurement)
        if len(kept) < len(measurement):
            self._counts["detections without place or covariance"] += len(measurement) - len(kept)
        return kept

    def _drop_mapped(self, measurement: Measurement) -> Measurement:
        if not self.config.prune_by_map or self._grid is None or len(measurement) == 0:
            return measurement
        free = ~self._grid.occupied_at(measurement.positions[:, :2])
        if free.all():
            return measurement
        self._counts["detections in occupied cells"] += int(np.sum(~free))
        return measurement.select(free)

    def _predict(self, measurement: Measurement) -> Tuple[float, float]:
        """All tracks to the measurement's stamp. Returns the step and by how much the measurement is late, seconds."""
        state = self._state
        if state.stamp_ns is None:
            self._state = dataclasses.replace(state, stamp_ns=measurement.stamp_ns)
            return 0.0, 0.0
        duration_s = (measurement.stamp_ns - state.stamp_ns) / 1e9
        if duration_s < 0:
            self._counts["measurements predicted forward"] += 1
            return 0.0, -duration_s
        table = state.table
        if len(table) and duration_s > 0:
            transition, noise = self._motion.transition(duration_s)
            means, covariances = self._moved(table, transition, noise, duration_s)
            table = dataclasses.replace(table, means=means, covariances=covariances)
            if self._considers:
                fading = math.exp(-duration_s / self.config.shared_error_time_s)
                table = dataclasses.replace(table, shared_cross=fading * (transition @ table.shared_cross))
        self._state = _State(measurement.stamp_ns, table, state.shared_covariance)
        return duration_s, 0.0

    def _update(self, measurement: Measurement, age_s: float) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Assign, update and start tracks. Returns Evidence's matched, new, confidences and log_likelihoods."""
        self._take_shared_covariance(measurement)
        axes = np.flatnonzero(measurement.observed)
        observation, lag_noise = self._observation(axes, age_s)
        pairs = self._assign(measurement, axes, observation, lag_noise)
        table = self._updated(measurement, axes, observation, pairs)

        count = len(table)
        matched, confidences, likelihoods = np.zeros(count, dtype=bool), np.zeros(count), np.zeros(count)
        matched[pairs.tracks] = True
        confidences[pairs.tracks] = measurement.confidences[pairs.detections]
        likelihoods[pairs.tracks] = -0.5 * (pairs.distances + _log_area(pairs.covariances) + 2 * math.log(2 * math.pi))

        born = self._born(measurement, table, pairs, age_s)
        self._state = dataclasses.replace(self._state, table=table.append(born) if len(born) else table)
        extra = np.zeros(len(born))
        return (
            np.concatenate([matched, extra == 0]),
            np.concatenate([matched & False, extra == 0]),
            np.concatenate([confidences, extra]),
            np.concatenate([likelihoods, extra]),
        )

    def _update_one_by_one(
        self, measurement: Measurement, age_s: float
    ) -> Tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        before = len(self._state.table)
        matched = np.zeros(before, dtype=bool)
        confidences = likelihoods = np.zeros(before)
        for row in range(len(measurement)):
            single = measurement.select(np.array([row]))
            single = dataclasses.replace(single, sequence=measurement.sequence * 1000 + row)
            hit, _, confidence, likelihood = self._update(single, age_s)
            grown = len(hit) - len(matched)
            matched = np.pad(matched, (0, grown)) | hit
            confidences = np.maximum(np.pad(confidences, (0, grown)), confidence)
            likelihoods = np.where(hit, likelihood, np.pad(likelihoods, (0, grown)))
        return matched, np.arange(len(matched)) >= before, confidences, likelihoods

    def _judge(self, evidence: Evidence) -> None:
        table = self._state.table
        moved = evidence.matched & (np.hypot(*(table.means[:, :2] - table.resting_place).T) > self.config.rest_distance)
        if evidence.measurement.bodies is not None:  # who has a person's shape does not rest as furniture does
            moved |= evidence.matched & ~evidence.new & (evidence.confidences > SHAPELY)
        if moved.any():
            table = dataclasses.replace(
                table,
                resting_place=np.where(moved[:, None], table.means[:, :2], table.resting_place),
                resting_since_ns=np.where(moved, self._now, table.resting_since_ns),
            )
        verdict = self._lifecycle.judge(table, evidence)
        stopped = verdict.still & ~table.still
        if stopped.any():
            table = self._stop(table, stopped)
        started = table.still & ~verdict.still
        if started.any():
            # It moves after all, nobody knows how fast.
            anew = np.where(started[:, None, None], self._motion.initial_covariance, 0.0)
            anew[:, :3] = 0.0
            table = dataclasses.replace(table, covariances=table.covariances + anew)
        table = dataclasses.replace(
            table,
            still=verdict.still,
            existence=verdict.existence,
            memory=verdict.memory,
            confirmed=verdict.confirmed,
            matched=evidence.matched,
            occluded=evidence.visible < 0.5,
        )
        if not verdict.alive.all():
            table = table.select(verdict.alive)
        self._state = dataclasses.replace(self._state, table=table)

    def _stop(self, table: TrackTable, rows: np.ndarray) -> TrackTable:
        """Tracks that stand still have no velocity to be uncertain of."""
        means, covariances, cross = table.means.copy(), table.covariances.copy(), table.shared_cross.copy()
        means[rows, 3:] = 0.0
        covariances[rows, 3:, :] = covariances[rows, :, 3:] = 0.0
        cross[rows, 3:] = 0.0
        return dataclasses.replace(table, means=means, covariances=covariances, shared_cross=cross)

    def _merge(self) -> None:
        """Volkhardt III-C 5: of two tracks at one place that move alike the less believed goes."""
        table = self._state.table
        if self.config.merge_distance <= 0 or len(table) < 2:
            return
        apart = np.hypot(*(table.means[:, None, :2] - table.means[None, :, :2]).transpose(2, 0, 1))
        relative = np.hypot(*(table.means[:, None, 3:5] - table.means[None, :, 3:5]).transpose(2, 0, 1))
        alike = (apart < self.config.merge_distance) & (relative < self.config.merge_speed)
        if np.count_nonzero(alike) == len(table):
            return
        keep = np.ones(len(table), dtype=bool)
        # Believed first, then older: the survivor is the one that users know already.
        for row in np.lexsort((table.ids, table.born_ns, -table.existence, ~table.confirmed)).tolist():
            if keep[row]:
                weaker = alike[row].copy()
                weaker[row] = False
                self._counts["merged tracks"] += int(np.count_nonzero(keep & weaker))
                keep &= ~weaker
        self._state = dataclasses.replace(self._state, table=table.select(keep))

    def _prune_mapped(self) -> None:
        table = self._state.table
        if not self.config.prune_by_map or self._grid is None or len(table) == 0:
            return
        free = ~self._grid.occupied_at(table.means[:, :2])
        if not free.all():
            self._counts["tracks in occupied cells"] += int(np.sum(~free))
            self._state = dataclasses.replace(self._state, table=table.select(free))

    # Parts of the steps

    def _moved(
        self, table: TrackTable, transition: np.ndarray, noise: np.ndarray, duration_s: float
    ) -> Tuple[np.ndarray, np.ndarray]:
        """New means and covariances after a step: people move by the motion model, furniture stays."""
        means, covariances = predict(table.means, table.covariances, transition, noise)
        if table.still.any():
            means[table.still] = table.means[table.still]
            covariances[table.still] = table.covariances[table.still] + duration_s * self._still_noise
        return means, covariances

    @property
    def _now(self) -> int:
        assert self._state.stamp_ns is not None
        return self._state.stamp_ns

    def _initial_state(self) -> _State:
        empty = TrackTable.empty(self._motion.dimension, self._lifecycle.memory)
        return _State(None, empty, np.zeros((SHARED, SHARED)))

    def _observation(self, axes: np.ndarray, age_s: float) -> Tuple[np.ndarray, np.ndarray]:
        """H (m, D) and the noise (m, m) of a measurement that is `age_s` old.

        Volkhardt III-C 3 predicts a late observation forward with the track's filter: its position moves by the
        velocity, z + v age = x + noise, which is z = x - v age + noise. What the motion adds meanwhile is noise.
        """
        observation = np.zeros((len(axes), self._motion.dimension))
        observation[np.arange(len(axes)), axes] = 1.0
        noise = np.zeros((len(axes), len(axes)))
        if age_s > 0:
            transition, process_noise = self._motion.transition(age_s)
            observation = 2 * observation - observation @ transition
            noise = process_noise[np.ix_(axes, axes)]
        return observation, noise

    def _take_shared_covariance(self, measurement: Measurement) -> None:
        """The considered error becomes the measurement's; where it is smaller, all that depends on it shrinks along."""
        before, now = self._state.shared_covariance, measurement.shared_covariance
        if not self._considers or now is None or np.array_equal(before, now):
            return
        table = self._state.table
        table = dataclasses.replace(table, shared_cross=table.shared_cross @ consider_fading(before, now).T)
        self._state = _State(self._state.stamp_ns, table, now)

    def _assign(
        self, measurement: Measurement, axes: np.ndarray, observation: np.ndarray, lag_noise: np.ndarray
    ) -> _Pairs:
        table = self._state.table
        size = len(axes)
        if len(table) == 0 or len(measurement) == 0:
            none = np.zeros(0, dtype=int)
            return _Pairs(none, none, np.zeros((0, size)), np.zeros((0, size, size)), np.zeros(0))
        predicted = table.means @ observation.T
        leaning = np.array(measurement.observed)[axes] * self._sitting_variances(measurement)[:, None]
        detected = measurement.positions[:, axes]
        noises = measurement.covariances[:, axes[:, None], axes] + lag_noise
        spreads = observation @ table.covariances @ observation.T
        shared = self._shared_spreads(measurement, axes)
        # |2 cov(a, b)| <= var(a) + var(b) bounds the considered error's cross terms.
        factor = 2.0 if self._considers else 1.0
        bound = noises if shared is None else noises + factor * shared
        tracks, detections = coarse_pairs(
            predicted, factor * _diagonals(spreads) + leaning, detected, _diagonals(bound), self.config.gate
        )
        innovations = detected[detections] - predicted[tracks]
        if self._considers:
            covariances = consider_innovation_covariances(
                table.covariances[tracks],
                table.shared_cross[tracks],
                observation,
                self._jacobians(measurement, axes)[detections],
                self._state.shared_covariance,
                noises[detections],
            )
        else:
            covariances = spreads[tracks] + bound[detections]
        covariances = covariances + leaning[tracks, :, None] * np.eye(size)
        distances = mahalanobis_squared(innovations, covariances)
        inside = np.flatnonzero(distances <= self.config.gate)
        if self.config.cost == "likelihood":
            # A track that hardly exists makes a detection no likelier: -2 log of N(innovation; 0, S) times existence.
            existence = np.maximum(table.existence[tracks[inside]], 1e-3)
            costs = distances[inside] + _log_area(covariances[inside]) - 2 * np.log(existence)
            costs = costs - self.config.unlikely_cost
        else:
            costs = distances[inside] - self.config.gate
        chosen = inside[
            self._assignment.assign(tracks[inside], detections[inside], costs, (len(table), len(measurement)))
        ]
        return _Pairs(tracks[chosen], detections[chosen], innovations[chosen], covariances[chosen], distances[chosen])

    def _updated(
        self, measurement: Measurement, axes: np.ndarray, observation: np.ndarray, pairs: _Pairs
    ) -> TrackTable:
        table = self._state.table
        rows = pairs.tracks
        if len(rows) == 0:
            return table
        cross = table.shared_cross
        if self._considers:
            means, covariances, crosses = consider_update(
                table.means[rows],
                table.covariances[rows],
                table.shared_cross[rows],
                pairs.innovations,
                observation,
                self._jacobians(measurement, axes)[pairs.detections],
                self._state.shared_covariance,
                pairs.covariances,
            )
            cross = _with_rows(cross, rows, crosses)
        else:
            shared = self._shared_spreads(measurement, axes)
            own = pairs.covariances if shared is None else pairs.covariances - shared[pairs.detections]
            means, covariances = update(table.means[rows], table.covariances[rows], pairs.innovations, observation, own)
        floor = _with_rows(table.shared_floor, rows, self._slow_errors(measurement)[pairs.detections])
        seen_ns = np.maximum(table.seen_ns[rows], measurement.stamp_ns)
        return dataclasses.replace(
            table,
            means=_with_rows(table.means, rows, means),
            covariances=_with_rows(table.covariances, rows, covariances),
            shared_cross=cross,
            shared_floor=floor,
            seen_ns=_with_rows(table.seen_ns, rows, seen_ns),
        )

    def _born(self, measurement: Measurement, table: TrackTable, pairs: _Pairs, age_s: float) -> TrackTable:
        """Tracks started by the detections that no track took."""
        free = np.ones(len(measurement), dtype=bool)
        free[pairs.detections] = False
        if self.config.birth_distance > 0 and len(pairs.tracks) and free.any():
            to_matched = measurement.positions[:, None, :2] - table.means[None, pairs.tracks, :2]
            free &= np.hypot(to_matched[..., 0], to_matched[..., 1]).min(axis=1) >= self.config.birth_distance
        rows = np.flatnonzero(free)
        if len(rows) == 0:
            return TrackTable.empty(self._motion.dimension, self._lifecycle.memory)
        count, dimension = len(rows), self._motion.dimension
        observed = np.array(measurement.observed)
        means = np.zeros((count, dimension))
        means[:, :3] = np.where(observed, measurement.positions[rows], self.config.head_height)
        covariances = np.repeat(self._motion.initial_covariance[None], count, axis=0)
        axes = np.flatnonzero(observed)
        covariances[:, axes, :] = 0.0
        covariances[:, :, axes] = 0.0
        covariances[:, axes[:, None], axes] = measurement.covariances[rows[:, None, None], axes[:, None], axes]
        cross = np.zeros((count, dimension, SHARED))
        floor = self._slow_errors(measurement)[rows]
        shared = self._shared_spreads(measurement, axes)
        if shared is not None and self._considers:
            covariances[:, axes[:, None], axes] += shared[rows]
            # Truth minus estimate, as everywhere here: a detection that the bias has moved one way errs the other way.
            cross[:, axes] = -self._jacobians(measurement, axes)[rows] @ self._state.shared_covariance
        if age_s > 0:
            transition, noise = self._motion.transition(age_s)
            means, covariances = predict(means, covariances, transition, noise)
        stamps = np.full(count, measurement.stamp_ns, dtype=np.int64)
        return TrackTable(
            ids=np.array([self._identities.of(measurement, row, table.ids) for row in rows.tolist()], dtype=np.int64),
            means=means,
            covariances=covariances,
            shared_cross=cross,
            shared_floor=floor,
            existence=np.zeros(count),
            memory=np.zeros((count, *self._lifecycle.memory)),
            confirmed=np.zeros(count, dtype=bool),
            matched=np.ones(count, dtype=bool),
            occluded=np.zeros(count, dtype=bool),
            still=np.zeros(count, dtype=bool),
            born_ns=stamps,
            seen_ns=stamps,
            resting_place=means[:, :2].copy(),
            resting_since_ns=stamps,
        )

    def _visible(self, measurement: Measurement) -> np.ndarray:
        table = self._state.table
        seen = np.ones(len(table))
        if measurement.sight is not None:
            seen = measurement.sight.visible(table.means[:, :2], self.config.body_half_width)
        if measurement.modality in self.config.sitting_stds:
            seen = seen * (1.0 - _sitting(table))
        return seen

    def _sitting_variances(self, measurement: Measurement) -> np.ndarray:
        """(T,) of the way from a detection to the head of who sits, by axis."""
        table = self._state.table
        std = self.config.sitting_stds.get(measurement.modality, 0.0)
        return std**2 * _sitting(table) if std > 0.0 else np.zeros(len(table))

    def _jacobians(self, measurement: Measurement, axes: np.ndarray) -> np.ndarray:
        """(N, m, 6) with respect to the shared error, zero where the measurement has no part in it."""
        if measurement.shared_jacobians is None:
            return np.zeros((len(measurement), len(axes), SHARED))
        return measurement.shared_jacobians[:, axes]

    def _shared_spreads(self, measurement: Measurement, axes: np.ndarray) -> Optional[np.ndarray]:
        """(N, m, m) J B J' on the observed axes, or None where nothing is shared."""
        if measurement.shared_jacobians is None or measurement.shared_covariance is None:
            return None
        return shared_errors(measurement)[:, axes[:, None], axes]

    def _slow_errors(self, measurement: Measurement) -> np.ndarray:
        """(N, 3, 3) what each detection adds to the output."""
        offset = self.config.offset_stds.get(measurement.modality, 0.0)
        return slow_errors(measurement, offset, not self._considers)


def _sitting(table: TrackTable) -> np.ndarray:
    """(T,) probability that their heads are surely as low as those of who sits; 0 where nobody has seen a head."""
    highest = table.means[:, 2] + SURE_STDS * np.sqrt(table.covariances[:, 2, 2])
    return np.asarray(ndtr((SITTING_HEAD - highest) / SITTING_SPREAD))


def _diagonals(matrices: np.ndarray) -> np.ndarray:
    return np.diagonal(matrices, axis1=-2, axis2=-1)


def _with_rows(array: np.ndarray, rows: np.ndarray, values: np.ndarray) -> np.ndarray:
    array = array.copy()
    array[rows] = values
    return array


def _log_area(covariances: np.ndarray) -> np.ndarray:
    """(...) log |S| on the ground: false detections are counted by area, so no height makes one likelier or not."""
    return np.log(np.linalg.det(covariances[..., :2, :2]))
