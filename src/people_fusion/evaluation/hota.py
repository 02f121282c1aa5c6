"""Higher order tracking accuracy (Luiten et al. 2021), which weighs detection and association alike.

Similarity of a person and a track falls linearly from 1 at distance 0 to 0 at `zero_distance`, as in TrackEval's
euclidean similarity. TrackEval's own zero distance, 2 m for MOT15-3D, is twice the 1 m that counts as a match there;
here it is likewise twice the matching threshold, so that CLEAR-MOT's matches are those with a similarity of one half.
In an image similarity is the overlap of boxes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Optional

import numpy as np
from scipy.optimize import linear_sum_assignment

from people_fusion.evaluation.clear_mot import THRESHOLD_M
from people_fusion.evaluation.distances import Distance
from people_fusion.evaluation.pairs import Pairs
from people_fusion.evaluation.truth import Estimates, Truth

ALPHAS = np.arange(1, 20) * 0.05  # similarities that make a match: 0.05, 0.10 ... 0.95
ZERO_DISTANCE_M = 2.0 * THRESHOLD_M


def _zeros() -> np.ndarray:
    return np.zeros(len(ALPHAS))


@dataclass(frozen=True, eq=False)
class Hota:
    """Sums of one run, or of several added, for each of `ALPHAS`; a score is None where there is nothing to score.

    Attributes:
        true_positives: (A,) matched annotations.
        false_negatives: (A,) other annotations.
        false_positives: (A,) other estimates.
        association_sum: (A,) over true positives, the share of frames that person and track have in common.
        similarity_sum: (A,) over true positives.
    """

    true_positives: np.ndarray = field(default_factory=_zeros)
    false_negatives: np.ndarray = field(default_factory=_zeros)
    false_positives: np.ndarray = field(default_factory=_zeros)
    association_sum: np.ndarray = field(default_factory=_zeros)
    similarity_sum: np.ndarray = field(default_factory=_zeros)

    def __add__(self, other: Hota) -> Hota:
        """Sums of both, as TrackEval combines sequences: association is averaged over all true positives."""
        return Hota(
            self.true_positives + other.true_positives,
            self.false_negatives + other.false_negatives,
            self.false_positives + other.false_positives,
            self.association_sum + other.association_sum,
            self.similarity_sum + other.similarity_sum,
        )

    @property
    def hota(self) -> Optional[float]:
        """Mean over alphas of the geometric mean of detection and association accuracy."""
        return self._mean(np.sqrt(self._detection() * self._association()))

    @property
    def detection_accuracy(self) -> Optional[float]:
        """DetA."""
        return self._mean(self._detection())

    @property
    def association_accuracy(self) -> Optional[float]:
        """AssA."""
        return self._mean(self._association())

    @property
    def localisation_accuracy(self) -> Optional[float]:
        """LocA: mean similarity of true positives; 1 at an alpha without any, as TrackEval has it."""
        none = self.true_positives == 0
        return self._mean(np.where(none, 1.0, self.similarity_sum / np.maximum(1.0, self.true_positives)))

    def _detection(self) -> np.ndarray:
        everything = self.true_positives + self.false_negatives + self.false_positives
        return self.true_positives / np.maximum(1.0, everything)

    def _association(self) -> np.ndarray:
        return self.association_sum / np.maximum(1.0, self.true_positives)

    def _mean(self, scores: np.ndarray) -> Optional[float]:
        nothing = self.true_positives[0] + self.false_negatives[0] + self.false_positives[0] == 0
        return None if nothing else float(scores.mean())


def hota_scores(
    truth: Truth, estimates: Estimates, zero_distance: float = ZERO_DISTANCE_M, distance: Optional[Distance] = None
) -> Hota:
    """HOTA's sums of one run.

    Args:
        truth: annotated people.
        estimates: tracker output at the same frames.
        zero_distance: where similarity reaches 0.
        distance: of rows of truth and estimates; None: metres on the floor.
    """
    pairs = Pairs.within(truth, estimates, zero_distance, distance)
    similarities = 1.0 - pairs.distances / zero_distance
    rows = _assign(pairs, truth, similarities * _alignment(pairs, similarities)[pairs.persons, pairs.tracks])
    similarities, persons, tracks = similarities[rows], pairs.persons[rows], pairs.tracks[rows]

    shape = (len(ALPHAS), pairs.person_count, pairs.track_count)
    matches = similarities >= ALPHAS[:, None] - np.finfo(float).eps  # (A, P)
    alphas, columns = np.nonzero(matches)
    together = np.zeros(shape)
    np.add.at(together, (alphas, persons[columns], tracks[columns]), 1.0)
    either = pairs.person_frames[:, None] + pairs.track_frames - together
    true_positives = matches.sum(axis=1).astype(float)
    return Hota(
        true_positives,
        len(truth.ids) - true_positives,
        len(estimates.ids) - true_positives,
        (together * together / np.maximum(1.0, either)).sum(axis=(1, 2)),
        (similarities * matches).sum(axis=1),
    )


def _alignment(pairs: Pairs, similarities: np.ndarray) -> np.ndarray:
    """(persons, tracks) Jaccard index of whole trajectories, weighted by similarity, before any matching."""
    by_person = np.bincount(pairs.truth_rows, similarities)[pairs.truth_rows]
    by_track = np.bincount(pairs.estimate_rows, similarities)[pairs.estimate_rows]
    union = by_person + by_track - similarities
    shares = np.divide(similarities, union, out=np.zeros_like(union), where=union > np.finfo(float).eps)
    common = np.zeros((pairs.person_count, pairs.track_count))
    np.add.at(common, (pairs.persons, pairs.tracks), shares)
    return common / (pairs.person_frames[:, None] + pairs.track_frames - common)


def _assign(pairs: Pairs, truth: Truth, scores: np.ndarray) -> np.ndarray:
    """Rows of the pairs that are matched: in each frame the assignment with the greatest sum of scores."""
    frames = truth.frames[pairs.truth_rows]
    bounds = np.searchsorted(frames, np.arange(truth.frame_count + 1)).tolist()
    chosen = []
    for start, stop in zip(bounds[:-1], bounds[1:]):
        if start == stop:
            continue
        truth_rows, estimate_rows = pairs.truth_rows[start:stop], pairs.estimate_rows[start:stop]
        people, tracks = truth_rows - truth_rows.min(), estimate_rows - estimate_rows.min()
        shape = (people.max() + 1, tracks.max() + 1)
        table = np.zeros(shape)
        table[people, tracks] = scores[start:stop]
        pair_of = np.full(shape, -1)
        pair_of[people, tracks] = np.arange(start, stop)
        chosen.append(pair_of[linear_sum_assignment(-table)])
    rows = np.concatenate([np.zeros(0, dtype=int), *chosen])
    return np.sort(rows[rows >= 0])
