"""The rows of a tracker: everything that is known of its tracks, as arrays of one length."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Tuple

import numpy as np

SHARED = 6  # size of the pose error that a measurement's detections share


@dataclass(frozen=True, eq=False)
class TrackTable:
    """Never altered in place, so that keeping it is a snapshot.

    Attributes:
        ids: (T,) int64.
        means: (T, D) and covariances (T, D, D) in the tracking frame.
        shared_cross: (T, D, 6) covariance of the state with the shared pose error that is considered.
        shared_floor: (T, 3, 3) covariance that the slow errors of the last detection add to the position.
        existence: (T,) in [0, 1].
        memory: (T, K) what the lifecycle remembers of each track.
        confirmed, matched, occluded: (T,) bool.
        still: (T,) bool, rests for so long that it is furniture, whose position is kept.
        born_ns, seen_ns: (T,) int64, first and last detection.
        resting_place: (T, 2) where the track began or last moved to, metres.
        resting_since_ns: (T,) int64, when.
    """

    ids: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    shared_cross: np.ndarray
    shared_floor: np.ndarray
    existence: np.ndarray
    memory: np.ndarray
    confirmed: np.ndarray
    matched: np.ndarray
    occluded: np.ndarray
    still: np.ndarray
    born_ns: np.ndarray
    seen_ns: np.ndarray
    resting_place: np.ndarray
    resting_since_ns: np.ndarray

    @staticmethod
    def empty(dimension: int, memory: Tuple[int, ...]) -> TrackTable:
        """A table without tracks for D states and a lifecycle's memory of the given shape per track."""
        return TrackTable(
            ids=np.zeros(0, dtype=np.int64),
            means=np.zeros((0, dimension)),
            covariances=np.zeros((0, dimension, dimension)),
            shared_cross=np.zeros((0, dimension, SHARED)),
            shared_floor=np.zeros((0, 3, 3)),
            existence=np.zeros(0),
            memory=np.zeros((0, *memory)),
            confirmed=np.zeros(0, dtype=bool),
            matched=np.zeros(0, dtype=bool),
            occluded=np.zeros(0, dtype=bool),
            still=np.zeros(0, dtype=bool),
            born_ns=np.zeros(0, dtype=np.int64),
            seen_ns=np.zeros(0, dtype=np.int64),
            resting_place=np.zeros((0, 2)),
            resting_since_ns=np.zeros(0, dtype=np.int64),
        )

    def __len__(self) -> int:
        return len(self.ids)

    def select(self, rows: np.ndarray) -> TrackTable:
        """The given rows, by mask or index."""
        return TrackTable(*(getattr(self, name)[rows] for name in _COLUMNS))

    def append(self, other: TrackTable) -> TrackTable:
        """These rows followed by those of `other`."""
        return TrackTable(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in _COLUMNS))


_COLUMNS = tuple(field.name for field in dataclasses.fields(TrackTable))
