"""Legs by multiple hypotheses, people by a Kalman filter each, which every cue feeds.

The leg tracker (Arras et al. 2012) says which legs of a scan are whose; where the person is says the Kalman tracker
(Poschmann 2018), by the legs as they were measured. No filtered state is handed on, so that nothing counts twice.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Dict, NamedTuple, Optional

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Measurement
from people_fusion.core.tracks import NOBODY, Legs, Tracks
from people_fusion.tracking.tracker import TRACKERS, Tracker
from people_fusion.tracking.trackers.kalman import KalmanConfig, KalmanTracker
from people_fusion.tracking.trackers.leg_mht import LEGS, LegMht, LegMhtConfig


@dataclass(frozen=True)
class KalmanOverLegsConfig(KalmanConfig):
    """The Kalman tracker's options, the leg tracker's, and what is handed from one to the other."""

    legs: LegMhtConfig = section(LegMhtConfig, "which legs are whose")
    free_confidence: float = parameter(
        0.8, "share of its confidence that a detection keeps if no leg of it is a person's; 0: it is left out", 0.0, 1.0
    )


class _State(NamedTuple):
    people: object
    legs: object


@TRACKERS.register("kalman_over_legs", KalmanOverLegsConfig)
class KalmanOverLegs(Tracker):
    """See the module. Measurements without legs go to the Kalman tracker as they are."""

    def __init__(self, config: KalmanOverLegsConfig) -> None:
        self.config = config
        self._people, self._legs = KalmanTracker(config), LegMht(config.legs)

    @property
    def stamp_ns(self) -> Optional[int]:
        """See Tracker."""
        return self._people.stamp_ns

    def process(self, measurement: Measurement) -> None:
        """See Tracker."""
        if measurement.modality == LEGS:
            self._legs.process(measurement)
            measurement = regrouped(measurement, self._legs.owners, self.config)
        self._people.process(measurement)

    def tracks(self, stamp_ns: Optional[int] = None) -> Tracks:
        """See Tracker."""
        return self._people.tracks(stamp_ns)

    def legs(self) -> Legs:
        """See Tracker; a leg's owner is the track that is nearest to the person of the leg tracker."""
        legs, persons, tracks = self._legs.legs(), self._legs.tracks(), self._people.tracks()
        apart = np.hypot(*(persons.means[:, None, :2] - tracks.means[None, :, :2]).transpose(2, 0, 1))
        owners = {NOBODY: NOBODY}
        for person, distances in zip(persons.ids.tolist(), apart):
            near = distances.min(initial=np.inf) < self.config.legs.people.leg_distance
            owners[person] = int(tracks.ids[distances.argmin()]) if near else NOBODY
        renamed = np.array([owners[owner] for owner in legs.owners.tolist()], dtype=np.int64)
        return dataclasses.replace(legs, owners=renamed)

    def snapshot(self) -> object:
        """See Tracker."""
        return _State(self._people.snapshot(), self._legs.snapshot())

    def restore(self, snapshot: object) -> None:
        """See Tracker."""
        assert isinstance(snapshot, _State)
        self._people.restore(snapshot.people)
        self._legs.restore(snapshot.legs)

    def reset(self) -> None:
        """See Tracker."""
        self._people.reset()
        self._legs.reset()

    def set_map(self, grid: Optional[OccupancyGrid]) -> None:
        """See Tracker."""
        self._people.set_map(grid)

    def counters(self) -> Dict[str, int]:
        """See Tracker."""
        return {**self._people.counters(), **{f"legs: {name}": count for name, count in self._legs.counters().items()}}


def regrouped(measurement: Measurement, owners: np.ndarray, config: KalmanOverLegsConfig) -> Measurement:
    """The detections of a scan, one for each person with a leg in it and those no leg of which is a person's.

    A person is at the middle of its legs. The covariance follows from the cue's of the detections that they were part
    of, whatever errors these share: the middle of two positions is never known worse than these are on average, and
    who is seen by one leg of a pair is half a step away from it.

    Args:
        measurement: with the legs that its detections are made of.
        owners: (L,) person of each leg, or NOBODY.
        config: see KalmanOverLegsConfig.
    """
    if len(measurement) == 0 or len(measurement.leg_owners) != len(owners):
        return measurement
    detections = measurement.leg_owners
    sizes = np.bincount(detections, minlength=len(measurement))
    half_step = np.diag([config.legs.people.half_step_std**2] * 2 + [0.0])
    # Legs of a person are a group, and so are those of a detection that are nobody's.
    owners = _agreed(owners, measurement, config.legs.people.leg_distance)
    person = owners != NOBODY
    keys = np.where(person, owners, -1 - detections)  # identities are positive
    _, firsts, groups = np.unique(keys, return_index=True, return_inverse=True)
    rows, positions, covariances, shares = [], [], [], []
    for first in np.sort(firsts).tolist():  # in the scan's order: names are given in the order of arrival
        legs = np.flatnonzero(groups == groups[first])
        parts = detections[legs]
        position = measurement.positions[parts].mean(axis=0)
        position[:2] = measurement.legs[legs].mean(axis=0)
        covariance = measurement.covariances[parts].mean(axis=0)
        if len(legs) < sizes[parts].max():
            covariance = covariance + half_step
        rows.append(parts[np.argmax(measurement.confidences[parts])])
        positions.append(position)
        covariances.append(covariance)
        shares.append(1.0 if person[first] else config.free_confidence)
    found = measurement.select(np.array(rows, dtype=int))
    found = dataclasses.replace(
        found,
        positions=np.reshape(positions, (-1, 3)),
        covariances=np.reshape(covariances, (-1, 3, 3)),
        confidences=np.array(shares) * found.confidences,
    )
    return found if config.free_confidence else found.select(np.array(shares) > 0.0)


def _agreed(owners: np.ndarray, measurement: Measurement, leg_distance: float) -> np.ndarray:
    """Owners (L,) in which two legs too far apart are nobody's, as it is not known which one is not the person's, and
    a leg that is nobody's belongs to whom the cue paired it with, if that person shows no other leg."""
    owners, detections = owners.copy(), measurement.leg_owners
    for person in np.unique(owners[owners != NOBODY]).tolist():
        legs = np.flatnonzero(owners == person)
        if np.hypot(*np.ptp(measurement.legs[legs], axis=0)) > leg_distance:
            owners[legs] = NOBODY
    found = owners.copy()
    for leg in np.flatnonzero(owners == NOBODY).tolist():
        mates = owners[(detections == detections[leg]) & (owners != NOBODY)]
        if len(mates) and np.count_nonzero(owners == mates[0]) == 1:
            found[leg] = mates[0]
    return found
