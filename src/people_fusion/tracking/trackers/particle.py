"""A particle filter per person, weighed by a model of each modality (Poschmann 2018, chapter 7: T2)."""

from __future__ import annotations

import dataclasses
from collections import Counter
from dataclasses import dataclass
from typing import Any, Dict, Mapping, Optional, Tuple

import numpy as np

from people_fusion.core.config import component, components, parameter, section
from people_fusion.core.head_scores import FEATURES, NO_SCORES, SCORES
from people_fusion.core.measurements import Measurement
from people_fusion.core.tracks import Particles, Tracks
from people_fusion.filtering import kalman
from people_fusion.filtering.motion import MOTION_MODELS
from people_fusion.filtering.motion_models.near_constant_velocity import NearConstantVelocityConfig
from people_fusion.filtering.particles import draw, predict, resampled, summary, weighed
from people_fusion.filtering.walking import Walking, WalkingConfig
from people_fusion.tracking.identities import Identities
from people_fusion.tracking.lifecycle import LIFECYCLES, Evidence
from people_fusion.tracking.lifecycles.second_look import SecondLookConfig
from people_fusion.tracking.models.gaussian import GaussianModelConfig
from people_fusion.tracking.plausible import plausible
from people_fusion.tracking.proximity import ProximityConfig, log_proximity
from people_fusion.tracking.slow_errors import slow_errors
from people_fusion.tracking.table import SHARED, TrackTable
from people_fusion.tracking.tracker import TRACKERS, Tracker
from people_fusion.tracking.weighing import MEASUREMENT_MODELS, Belief, Births, MeasurementModel, Pairing


@dataclass(frozen=True)
class ParticleConfig:
    """Parts and thresholds of the particle tracker."""

    particles: int = parameter(500, "of each track", low=2, high=100000)
    seed: int = parameter(0, "of the random generator: the same recording and seed give the same tracks", low=0)
    resample_below: float = parameter(
        0.5, "effective share of a track's particles below which they are drawn anew; 1: always", low=0.0, high=1.0
    )
    roughening: float = parameter(
        0.5, "of particles drawn anew: noise as a share of their own standard deviation", low=0.0, high=1.0
    )
    motion: object = component(MOTION_MODELS, NearConstantVelocityConfig, "motion model")
    walking: WalkingConfig = section(WalkingConfig, "stopping and starting, mixed with the motion model")
    models: Dict[str, object] = components(MEASUREMENT_MODELS, "measurement models by modality; others: `gaussian`")
    proximity: ProximityConfig = section(ProximityConfig, "how near two people come to each other")
    lifecycle: object = component(LIFECYCLES, SecondLookConfig, "when a track is a person and when it ends")
    head_height: float = parameter(1.5, "height of a new track whose height is not observed, metres")
    head_heights: Tuple[float, float] = parameter(
        (0.9, 2.1), "of heads over the floor, sitting or standing; particles elsewhere weigh nothing, metres"
    )
    offset_stds: Dict[str, float] = parameter(
        {}, "by modality: how far a body may be from where its detections are on average, by axis, metres", low=0.0
    )


@dataclass(frozen=True, eq=False)
class _State:
    """All that changes from measurement to measurement. The table's means and covariances are the particles'."""

    stamp_ns: Optional[int]
    table: TrackTable
    states: np.ndarray
    weights: np.ndarray
    walks: np.ndarray
    memories: Mapping[str, np.ndarray]
    generator: Mapping[str, Any]

    def select(self, rows: np.ndarray) -> _State:
        """Some of the tracks."""
        return dataclasses.replace(
            self,
            table=self.table.select(rows),
            states=self.states[rows],
            weights=self.weights[rows],
            walks=self.walks[rows],
            memories={name: memory[rows] for name, memory in self.memories.items()},
        )


@TRACKERS.register("particle", ParticleConfig)
class ParticleTracker(Tracker):
    """See the module."""

    def __init__(self, config: ParticleConfig) -> None:
        self.config = config
        self._motion = MOTION_MODELS.build(config.motion)
        self._walking = Walking(config.walking)
        self._lifecycle = LIFECYCLES.build(config.lifecycle)
        self._models = {name: MEASUREMENT_MODELS.build(model) for name, model in config.models.items()}
        self._other: MeasurementModel = MEASUREMENT_MODELS.build(GaussianModelConfig())
        wanted = {getattr(model, "scores", NO_SCORES) for model in self._models.values()}
        self.scores = next((each for each in (FEATURES, SCORES) if each in wanted), NO_SCORES)
        self._rng = np.random.Generator(np.random.PCG64(config.seed))
        self._beginning = self._rng.bit_generator.state
        self._identities = Identities()
        self._counts: Counter = Counter()
        self._state = self._initial_state()

    @property
    def stamp_ns(self) -> Optional[int]:
        """See Tracker."""
        return self._state.stamp_ns

    def process(self, measurement: Measurement) -> None:
        """See Tracker. The steps are those of Poschmann's figure 7.1."""
        measurement = self._drop_implausible(measurement)
        self._rng.bit_generator.state = self._state.generator
        duration_s, age_s = self._predict(measurement.stamp_ns)
        model = self._models.get(measurement.modality, self._other)
        pairing = self._weigh(model, measurement, age_s)
        belief = self._belief(measurement.modality, age_s)
        if model.after_weighing:
            pairing = model.associate(belief, measurement)
        seen = model.visible(belief, measurement, pairing)
        self._see(measurement, model, pairing, seen, belief)
        born = self._possible(measurement, model.initiate(belief, measurement, pairing)) if model.starts else None
        count = len(born.rows) if born is not None else 0
        if born is not None and count:
            self._begin(measurement, born, age_s)
        testimony = model.testimony(belief, measurement, pairing) if model.confirms else np.zeros(len(belief))
        self._judge(model, measurement, pairing, seen, testimony, count, duration_s)
        self._state = dataclasses.replace(self._state, generator=self._rng.bit_generator.state)

    def tracks(self, stamp_ns: Optional[int] = None) -> Tracks:
        """See Tracker."""
        table, now = self._state.table, self._state.stamp_ns
        if now is None:
            now = stamp_ns or 0
        duration_s = 0.0
        if stamp_ns is not None and stamp_ns > now:
            duration_s, now = (stamp_ns - now) / 1e9, stamp_ns
        means, covariances = kalman.predict(table.means, table.covariances, *self._motion.transition(duration_s))
        covariances[:, :3, :3] += table.shared_floor
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

    def particles(self) -> Particles:
        """See Tracker."""
        state, table = self._state, self._state.table
        positions, velocities = state.states[..., :3], state.states[..., 3:5]
        return Particles(
            state.stamp_ns or 0, "", table.ids.copy(), table.confirmed.copy(), positions, velocities, state.weights
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

    def counters(self) -> Dict[str, int]:
        """See Tracker."""
        return dict(self._counts)

    # Steps of `process`, in its order

    def _drop_implausible(self, measurement: Measurement) -> Measurement:
        kept = plausible(measurement)
        if len(kept) < len(measurement):
            self._counts["detections without place or covariance"] += len(measurement) - len(kept)
        return kept

    def _predict(self, stamp_ns: int) -> Tuple[float, float]:
        """All particles to the measurement's stamp. Returns the step and by how much it is late, seconds."""
        state = self._state
        if state.stamp_ns is None:
            self._state = dataclasses.replace(state, stamp_ns=stamp_ns)
            return 0.0, 0.0
        duration_s = (stamp_ns - state.stamp_ns) / 1e9
        if duration_s < 0:
            self._counts["measurements predicted forward"] += 1
            return 0.0, -duration_s
        states, walks = state.states, state.walks
        if len(states) and duration_s > 0:
            walks, states = self._walking.change(walks, states, duration_s, self._rng)
            walked = predict(states, *self._motion.transition(duration_s), self._rng)
            states = self._walking.mixed(walks, states, walked, duration_s, self._rng)
        self._state = dataclasses.replace(state, stamp_ns=stamp_ns, states=states, walks=walks)
        return duration_s, 0.0

    def _weigh(self, model: MeasurementModel, measurement: Measurement, age_s: float) -> Pairing:
        """Weigh all particles, draw anew where few are left, and say again what the tracks are."""
        self._summarise()
        belief = self._belief(measurement.modality, age_s)
        pairing = model.associate(belief, measurement)
        state = self._state
        if len(belief):
            logs = model.weigh(belief, measurement, pairing, self._rng)
            logs = logs + log_proximity(state.states, state.table.means, state.table.confirmed, self.config.proximity)
            low, high = self.config.head_heights
            heights = state.states[..., 2]
            logs = np.where((heights >= low) & (heights <= high), logs, logs.min() - IMPOSSIBLE)
            weights = weighed(state.weights, logs)
            states, weights, chosen = resampled(
                state.states, weights, self._rng, self.config.resample_below, self.config.roughening
            )
            walks = np.take_along_axis(state.walks, chosen, axis=1)
            self._state = dataclasses.replace(state, states=states, weights=weights, walks=walks)
            self._summarise()
        return pairing

    def _see(
        self, measurement: Measurement, model: MeasurementModel, pairing: Pairing, seen: np.ndarray, belief: Belief
    ) -> None:
        """Note who was seen, what their detections' slow errors are, and what the model learns of them."""
        state, table = self._state, self._state.table
        hit, rows = pairing.detected, pairing.rows[pairing.detected]
        floor = table.shared_floor.copy()
        offset_std = self.config.offset_stds.get(measurement.modality, 0.0)
        floor[hit] = slow_errors(measurement, offset_std, with_shared=True)[rows]
        seen_ns = np.where(seen, np.maximum(table.seen_ns, measurement.stamp_ns), table.seen_ns)
        memories = {**state.memories, measurement.modality: model.learn(belief, measurement, seen, self._rng)}
        table = dataclasses.replace(table, shared_floor=floor, seen_ns=seen_ns)
        self._state = dataclasses.replace(state, table=table, memories=memories)

    def _possible(self, measurement: Measurement, born: Births) -> Births:
        """Those whose heads may be at a height where heads are: no particle of the others would weigh anything."""
        low, high = self.config.head_heights
        heights, reaches = born.positions[:, 2], HEIGHT_STDS * np.sqrt(born.covariances[:, 2, 2])
        rows = (heights + reaches >= low) & (heights - reaches <= high) | (not measurement.observed[2])
        return Births(born.positions[rows], born.covariances[rows], born.rows[rows])

    def _begin(self, measurement: Measurement, born: Births, age_s: float) -> None:
        """New tracks, their particles drawn from the detections."""
        state, count = self._state, len(born.rows)
        observed = np.array(measurement.observed)
        means = np.zeros((count, self._motion.dimension))
        means[:, :3] = np.where(observed, born.positions, self.config.head_height)
        covariances = np.repeat(self._motion.initial_covariance[None], count, axis=0)
        axes = np.flatnonzero(observed)
        covariances[:, axes[:, None], axes] = born.covariances[:, axes[:, None], axes]
        if age_s > 0:
            means, covariances = kalman.predict(means, covariances, *self._motion.transition(age_s))
        states = draw(means, covariances, self.config.particles, self._rng)
        stamps = np.full(count, measurement.stamp_ns, dtype=np.int64)
        used = state.table.ids
        empty = TrackTable.empty(self._motion.dimension, self._lifecycle.memory)
        table = dataclasses.replace(
            empty,
            ids=np.array([self._identities.of(measurement, row, used) for row in born.rows.tolist()], dtype=np.int64),
            means=means,
            covariances=covariances,
            shared_cross=np.zeros((count, self._motion.dimension, SHARED)),
            shared_floor=slow_errors(
                measurement, self.config.offset_stds.get(measurement.modality, 0.0), with_shared=True
            )[born.rows],
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
        memories = {
            name: np.concatenate([memory, np.zeros((count, memory.shape[1]), dtype=memory.dtype)])
            for name, memory in state.memories.items()
        }
        self._state = dataclasses.replace(
            state,
            table=state.table.append(table),
            states=np.concatenate([state.states, states]),
            weights=np.concatenate([state.weights, np.full((count, states.shape[1]), 1.0 / states.shape[1])]),
            walks=np.concatenate([state.walks, self._walking.begin(states.shape[:2], self._rng)]),
            memories=memories,
        )
        self._summarise()

    def _judge(
        self,
        model: MeasurementModel,
        measurement: Measurement,
        pairing: Pairing,
        seen: np.ndarray,
        testimony: np.ndarray,
        count: int,
        duration_s: float,
    ) -> None:
        """Who is a person, and who has gone; `count` tracks are new."""
        table = self._state.table
        new = np.arange(len(table)) >= len(table) - count
        confidences = np.zeros(len(seen))
        confidences[pairing.detected] = measurement.confidences[pairing.rows[pairing.detected]]
        matched = np.pad(seen, (0, count), constant_values=True)
        in_sight = np.ones(len(table))
        if measurement.sight is not None:
            in_sight = measurement.sight.visible(table.means[:, :2], BODY_HALF_WIDTH)
        verdict = self._lifecycle.judge(
            table,
            Evidence(
                measurement,
                self._state.stamp_ns or 0,
                duration_s,
                matched,
                new,
                np.pad(confidences, (0, count)),
                np.pad(pairing.log_likelihoods, (0, count)),
                in_sight,
                np.pad(pairing.detected, (0, count), constant_values=True) & model.confirms,
                np.pad(testimony, (0, count)),
            ),
        )
        table = dataclasses.replace(
            table,
            existence=verdict.existence,
            memory=verdict.memory,
            confirmed=verdict.confirmed,
            matched=matched,
            occluded=in_sight < 0.5,
        )
        state = dataclasses.replace(self._state, table=table)
        self._state = state if verdict.alive.all() else state.select(verdict.alive)

    # Parts of the steps

    def _belief(self, modality: str, age_s: float) -> Belief:
        """The tracks as they were when a late measurement was made, by each particle's velocity."""
        state, table = self._state, self._state.table
        memory = state.memories.get(modality, np.zeros((len(table), 0), dtype=np.float32))
        states, means = state.states, table.means
        if age_s > 0:
            states, means = states.copy(), means.copy()
            states[..., :2] -= age_s * states[..., 3:5]
            means[:, :2] -= age_s * means[:, 3:5]
        return Belief(states, state.weights, means, table.covariances, table.confirmed, memory)

    def _summarise(self) -> None:
        """The table says what the particles are."""
        state = self._state
        means, covariances = summary(state.states, state.weights)
        table = dataclasses.replace(state.table, means=means, covariances=covariances)
        self._state = dataclasses.replace(state, table=table)

    def _initial_state(self) -> _State:
        size, dimension = self.config.particles, self._motion.dimension
        return _State(
            stamp_ns=None,
            table=TrackTable.empty(dimension, self._lifecycle.memory),
            states=np.zeros((0, size, dimension)),
            weights=np.zeros((0, size)),
            walks=np.zeros((0, size), dtype=bool),
            memories={},
            generator=self._beginning,
        )


HEIGHT_STDS = 3.0  # by which a head may be measured too low or too high
IMPOSSIBLE = 50.0  # natural logarithm by which what cannot be weighs less
BODY_HALF_WIDTH = 0.2  # of what a sensor could see of a person, metres
