"""Persons and tracks that are near one another in a frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from people_fusion.evaluation.distances import Distance, on_the_floor
from people_fusion.evaluation.truth import Estimates, Truth

_BLOCK = 50_000  # rows of truth that are paired at once, to bound memory


@dataclass(frozen=True, eq=False)
class Pairs:
    """All P pairs of a person and a track within a distance in the same frame, in order of frames.

    Attributes:
        truth_rows: (P,) row in `Truth`.
        estimate_rows: (P,) row in `Estimates`.
        distances: (P,) metres, or as measured.
        persons: (P,) person, numbered from 0 without gaps.
        tracks: (P,) track, numbered from 0 without gaps.
        person_frames: (person_count,) frames in which each person is annotated.
        track_frames: (track_count,) frames in which each track is reported.
    """

    truth_rows: np.ndarray
    estimate_rows: np.ndarray
    distances: np.ndarray
    persons: np.ndarray
    tracks: np.ndarray
    person_frames: np.ndarray
    track_frames: np.ndarray

    @staticmethod
    def within(truth: Truth, estimates: Estimates, reach: float, distance: Optional[Distance] = None) -> Pairs:
        """All pairs that are at most `reach` apart; in metres on the floor, unless a distance is given."""
        distance = distance or on_the_floor(truth, estimates)
        estimate_bounds = estimates.bounds(truth.frame_count)
        blocks = [
            _near(truth, estimate_bounds, np.arange(start, min(start + _BLOCK, len(truth.ids))), reach, distance)
            for start in range(0, max(1, len(truth.ids)), _BLOCK)
        ]
        truth_rows, estimate_rows, distances = (np.concatenate(column) for column in zip(*blocks))
        persons, person_frames = _number(truth.ids)
        numbered_tracks, track_frames = _number(estimates.ids)
        return Pairs(
            truth_rows,
            estimate_rows,
            distances,
            persons[truth_rows],
            numbered_tracks[estimate_rows],
            person_frames,
            track_frames,
        )

    @property
    def person_count(self) -> int:
        return len(self.person_frames)

    @property
    def track_count(self) -> int:
        return len(self.track_frames)


def _near(
    truth: Truth, estimate_bounds: np.ndarray, rows: np.ndarray, reach: float, distance: Distance
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of truth and of estimates and distances of the pairs that some rows of truth are part of."""
    frames = truth.frames[rows]
    partners = np.diff(estimate_bounds)[frames]  # each row meets all estimates of its frame
    truth_rows = np.repeat(rows, partners)
    first = np.repeat(estimate_bounds[frames] - np.cumsum(partners) + partners, partners)
    estimate_rows = first + np.arange(len(truth_rows))
    distances = distance(truth_rows, estimate_rows)
    near = distances <= reach
    return truth_rows[near], estimate_rows[near], distances[near]


def _number(ids: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Identities as numbers from 0, and how often each occurs."""
    _, numbers, counts = np.unique(ids, return_inverse=True, return_counts=True)
    return numbers, counts
