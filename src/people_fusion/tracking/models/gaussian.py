"""Particles weighed by position estimates: each by the density of its track's Gaussian (Poschmann 2018, 7.2.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.association.method import ASSIGNMENT_METHODS
from people_fusion.association.methods.greedy import GreedyConfig
from people_fusion.core.config import component, parameter
from people_fusion.core.gaussians import mahalanobis_squared
from people_fusion.core.measurements import Measurement
from people_fusion.tracking.slow_errors import shared_errors
from people_fusion.tracking.weighing import (
    MEASUREMENT_MODELS,
    Belief,
    Births,
    MeasurementModel,
    Pairing,
)


@dataclass(frozen=True)
class GaussianModelConfig:
    """How detections are taken as they are."""

    assignment: object = component(ASSIGNMENT_METHODS, GreedyConfig, "assignment method")
    gate: float = parameter(11.345, "largest squared Mahalanobis distance of a pair", low=0.0)
    starts: bool = parameter(True, "detections start tracks and confirm them")


@MEASUREMENT_MODELS.register("gaussian", GaussianModelConfig)
class GaussianModel(MeasurementModel):
    """See the module. Tracks without a detection keep their weights."""

    def __init__(self, config: GaussianModelConfig) -> None:
        self.config = config
        self.starts = self.confirms = config.starts
        self._assignment = ASSIGNMENT_METHODS.build(config.assignment)

    def associate(self, belief: Belief, measurement: Measurement) -> Pairing:
        """By the Mahalanobis distance of the track's Gaussian and the detection's."""
        pairing = Pairing.nothing(len(belief), len(measurement))
        if len(belief) == 0 or len(measurement) == 0:
            return pairing
        innovations, spreads = innovations_of(belief, measurement)
        distances = mahalanobis_squared(innovations, spreads)
        tracks, rows = np.nonzero(distances <= self.config.gate)
        costs = distances[tracks, rows] - self.config.gate
        chosen = self._assignment.assign(tracks, rows, costs, (len(belief), len(measurement)))
        tracks, rows = tracks[chosen], rows[chosen]
        pairing.rows[tracks], pairing.used[rows] = rows, True
        pairing.log_likelihoods[tracks] = pair_likelihoods(innovations[tracks, rows], spreads[tracks, rows])
        return pairing

    def weigh(
        self,
        belief: Belief,
        measurement: Measurement,
        pairing: Pairing,
        rng: np.random.Generator,  # noqa: ARG002
    ) -> np.ndarray:
        """Log density of the assigned Gaussian at each particle."""
        axes = np.flatnonzero(measurement.observed)
        rows = pairing.rows[pairing.detected]
        logs = np.zeros(belief.weights.shape)
        logs[pairing.detected] = log_densities(
            belief.states[pairing.detected][..., axes],
            measurement.positions[rows][:, axes],
            _noises(measurement, axes)[rows],
        )
        return logs

    def visible(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> np.ndarray:  # noqa: ARG002
        """Who is detected; by a cue that starts nobody, who was confirmed already."""
        return pairing.detected & (self.starts | belief.confirmed)

    def initiate(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> Births:  # noqa: ARG002
        """Whatever was assigned to nobody."""
        rows = np.flatnonzero(~pairing.used)
        return Births(measurement.positions[rows], measurement.covariances[rows], rows)


def innovations_of(belief: Belief, measurement: Measurement) -> Tuple[np.ndarray, np.ndarray]:
    """Of every track and detection the innovation (T, M, m) and its covariance (T, M, m, m), on observed axes."""
    axes = np.flatnonzero(measurement.observed)
    noises = _noises(measurement, axes)
    if measurement.shared_covariance is not None:
        noises = noises + shared_errors(measurement)[:, axes[:, None], axes]
    innovations = measurement.positions[None][..., axes] - belief.means[:, None, axes]
    return innovations, belief.covariances[:, axes[:, None], axes][:, None] + noises[None]


def pair_likelihoods(innovations: np.ndarray, spreads: np.ndarray) -> np.ndarray:
    """(P,) log density of innovations (P, m), by area on the ground as false detections are counted."""
    areas = np.linalg.det(spreads[:, :2, :2])
    return -0.5 * (mahalanobis_squared(innovations, spreads) + np.log(areas) + 2.0 * math.log(2.0 * math.pi))


def log_densities(points: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(T, N) log N(x; mean, C) of points (T, N, m), up to a constant of each track's."""
    whitening = np.linalg.inv(np.linalg.cholesky(covariances))
    offsets = (points - means[:, None]) @ whitening.swapaxes(-1, -2)
    return np.asarray(-0.5 * np.square(offsets).sum(axis=2))


def _noises(measurement: Measurement, axes: np.ndarray) -> np.ndarray:
    return measurement.covariances[:, axes[:, None], axes]

