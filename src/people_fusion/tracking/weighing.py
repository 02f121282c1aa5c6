"""The contract of all measurement models: how particles are weighed by what a cue measured (Poschmann 2018, 7.2)."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from people_fusion.core.measurements import Measurement
from people_fusion.core.registry import Registry

NONE = -1  # no detection


@dataclass(frozen=True, eq=False)
class Belief:
    """The tracks at a measurement's stamp: T tracks of N particles.

    Attributes:
        states: (T, N, D) x y z vx vy of the head, metres and metres a second, in the measurement's frame.
        weights: (T, N), of each track they sum to 1.
        means: (T, D) and covariances (T, D, D) of the particles.
        confirmed: (T,) bool, whether the track is reported as a person.
        memory: (T, K) what this model remembers of each track: zeros when a track begins, K = 0 before it has learnt.
    """

    states: np.ndarray
    weights: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    confirmed: np.ndarray
    memory: np.ndarray

    def __len__(self) -> int:
        return len(self.means)


@dataclass(frozen=True, eq=False)
class Pairing:
    """Which detections belong to which tracks.

    Attributes:
        rows: (T,) index of the detection, NONE where there is none.
        log_likelihoods: (T,) log density of what was assigned, 1/m^2 on the ground; 0 where nothing was.
        points: (T, 2) where on the ground the model itself sees the person, metres; NaN where it does not.
        used: (N,) bool, detections that have a part in anybody.
    """

    rows: np.ndarray
    log_likelihoods: np.ndarray
    points: np.ndarray
    used: np.ndarray

    @staticmethod
    def nothing(tracks: int, detections: int) -> Pairing:
        """No detection belongs to any track, yet."""
        points = np.full((tracks, 2), np.nan)
        return Pairing(np.full(tracks, NONE), np.zeros(tracks), points, np.zeros(detections, dtype=bool))

    @property
    def detected(self) -> np.ndarray:
        """(T,) bool, whether anything was assigned."""
        return np.asarray(self.rows != NONE)


@dataclass(frozen=True, eq=False)
class Births:
    """Gaussians (B,) from which the particles of new tracks are drawn.

    Attributes:
        positions: (B, 3) metres. An axis that is not observed holds anything.
        covariances: (B, 3, 3).
        rows: (B,) the detection that each begins with, which makes its identity.
    """

    positions: np.ndarray
    covariances: np.ndarray
    rows: np.ndarray


class MeasurementModel(abc.ABC):
    """Weighs particles by the measurements of one modality. Stateless: what it remembers is in Belief.memory.

    For each measurement the tracker asks, in this order: `associate`, `weigh`; then, of the tracks as they are after
    weighing: `associate` again if `after_weighing`, `visible`, `learn`, and `initiate` if the model `starts` tracks.

    Attributes:
        after_weighing: whether detections are assigned to the tracks as they are after weighing, too.
        starts: whether its detections start tracks.
        confirms: whether they make a person of a track.
    """

    after_weighing: ClassVar[bool] = False
    starts: bool
    confirms: bool

    @abc.abstractmethod
    def associate(self, belief: Belief, measurement: Measurement) -> Pairing:
        """Detections to tracks."""

    @abc.abstractmethod
    def weigh(
        self, belief: Belief, measurement: Measurement, pairing: Pairing, rng: np.random.Generator
    ) -> np.ndarray:
        """(T, N) log p(z | x) of each particle up to a constant of each track; 0 of tracks of which nothing is said."""

    @abc.abstractmethod
    def visible(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> np.ndarray:
        """(T,) bool, whether the measurement shows that the person is still there (7.3)."""

    def testimony(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> np.ndarray:  # noqa: ARG002
        """(T,) log odds that a model which can tell people adds to a person being there, from -1 to 1; 0: nothing."""
        return np.asarray(pairing.detected.astype(float))

    def initiate(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> Births:  # noqa: ARG002
        """New tracks of what was assigned to none."""
        return Births(np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0, dtype=int))

    def learn(
        self,
        belief: Belief,
        measurement: Measurement,  # noqa: ARG002
        visible: np.ndarray,  # noqa: ARG002
        rng: np.random.Generator,  # noqa: ARG002
    ) -> np.ndarray:
        """(T, K) what is remembered from now on, e.g. how a person looks."""
        return belief.memory


MEASUREMENT_MODELS: Registry[MeasurementModel] = Registry("measurement model", "people_fusion.tracking.models")
