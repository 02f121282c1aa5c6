"""Particles weighed by legs, which are assigned to tracks and not to each other (Poschmann 2018, 7.2.2; L2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.measurements import Measurement
from people_fusion.tracking.models.gaussian import log_densities
from people_fusion.tracking.weighing import (
    MEASUREMENT_MODELS,
    NONE,
    Belief,
    Births,
    MeasurementModel,
    Pairing,
)


@dataclass(frozen=True)
class LegModelConfig:
    """Which legs are whose."""

    reach: float = parameter(0.5, "largest distance of a track and its leg on the ground, metres", low=0.01)
    starts: bool = parameter(False, "legs of nobody, in pairs as the cue makes them, start tracks")
    confirms: bool = parameter(True, "legs confirm tracks, where they start them")


@MEASUREMENT_MODELS.register("legs", LegModelConfig)
class LegModel(MeasurementModel):
    """A person is at the middle between his legs, or at the only one, as uncertain as the cue says of these legs."""

    def __init__(self, config: LegModelConfig) -> None:
        self.config, self.starts = config, config.starts
        self.confirms = config.starts and config.confirms

    def associate(self, belief: Belief, measurement: Measurement) -> Pairing:
        """Nearest first: each leg to one track at most, two legs to a track at most."""
        pairing, (legs, owners) = Pairing.nothing(len(belief), len(measurement)), _legs(measurement)
        apart = np.hypot(*(belief.means[:, None, :2] - legs[None]).transpose(2, 0, 1))
        tracks, parts = np.nonzero(apart <= self.config.reach)
        owns = np.full((len(belief), 2), NONE)
        free = np.ones(len(legs), dtype=bool)
        for pair in np.argsort(apart[tracks, parts], kind="stable").tolist():
            track, leg = int(tracks[pair]), int(parts[pair])
            if free[leg] and owns[track, 1] == NONE:
                owns[track, 0 if owns[track, 0] == NONE else 1] = leg
                free[leg] = False
        for track in np.flatnonzero(owns[:, 0] != NONE).tolist():
            mine = owns[track][owns[track] != NONE]
            pairing.rows[track] = owners[mine[0]]
            pairing.used[owners[mine]] = True
            # A single one that the cue has no second to: where the cue sees the person.
            is_lone = len(mine) == 1 and np.count_nonzero(owners == owners[mine[0]]) == 1
            pairing.points[track] = measurement.positions[owners[mine[0]], :2] if is_lone else legs[mine].mean(axis=0)
        return pairing

    def weigh(
        self,
        belief: Belief,
        measurement: Measurement,
        pairing: Pairing,
        rng: np.random.Generator,  # noqa: ARG002
    ) -> np.ndarray:
        """Log density of a Gaussian at the middle of the legs."""
        logs, hit = np.zeros(belief.weights.shape), pairing.detected
        covariances = measurement.covariances[pairing.rows[hit], :2, :2]
        logs[hit] = log_densities(belief.states[hit][..., :2], pairing.points[hit], covariances)
        return logs

    def visible(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> np.ndarray:  # noqa: ARG002
        """Who has a leg; where legs start nobody, who was confirmed already."""
        return pairing.detected & (self.starts | belief.confirmed)

    def testimony(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> np.ndarray:  # noqa: ARG002
        """None: what looks like legs may be a chair's."""
        return np.zeros(len(belief))

    def initiate(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> Births:  # noqa: ARG002
        """People of the cue none of whose legs belongs to a track."""
        rows = np.flatnonzero(~pairing.used)
        return Births(measurement.positions[rows], measurement.covariances[rows], rows)


def _legs(measurement: Measurement) -> Tuple[np.ndarray, np.ndarray]:
    """(L, 2) legs and (L,) whose they are; a person whose legs the cue does not tell has one where he is."""
    (legless,) = np.nonzero(~np.isin(np.arange(len(measurement)), measurement.leg_owners))
    legs = np.concatenate([measurement.legs, measurement.positions[legless, :2]])
    return legs, np.concatenate([measurement.leg_owners, legless])
