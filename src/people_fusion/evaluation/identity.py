"""Identity scores of Ristani et al. 2016: one track for each person over the whole recording."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional

import numpy as np
from scipy.optimize import linear_sum_assignment

from people_fusion.evaluation.clear_mot import THRESHOLD_M, ratio
from people_fusion.evaluation.distances import Distance
from people_fusion.evaluation.pairs import Pairs
from people_fusion.evaluation.truth import Estimates, Truth


@dataclass(frozen=True)
class Identity:
    """Counts of one run, or of several added; a score is None where its denominator is zero.

    Attributes:
        true_positives: annotations within the threshold of the one track that is best for the person.
        false_negatives: all other annotations.
        false_positives: all other estimates.
    """

    true_positives: int = 0
    false_negatives: int = 0
    false_positives: int = 0

    def __add__(self, other: Identity) -> Identity:
        """Counts of both."""
        return Identity(
            self.true_positives + other.true_positives,
            self.false_negatives + other.false_negatives,
            self.false_positives + other.false_positives,
        )

    @property
    def idf1(self) -> Optional[float]:
        """Harmonic mean of `idp` and `idr`."""
        return ratio(2 * self.true_positives, 2 * self.true_positives + self.false_negatives + self.false_positives)

    @property
    def idp(self) -> Optional[float]:
        """Share of estimates that bear the right identity."""
        return ratio(self.true_positives, self.true_positives + self.false_positives)

    @property
    def idr(self) -> Optional[float]:
        """Share of annotations that bear the right identity."""
        return ratio(self.true_positives, self.true_positives + self.false_negatives)


def identity_scores(
    truth: Truth, estimates: Estimates, threshold: float = THRESHOLD_M, distance: Optional[Distance] = None
) -> Identity:
    """Assign whole tracks to whole persons so that most annotations are covered within the threshold.

    Leaving a person without a track costs as much as giving him one that is never near, so the assignment is the one
    with the most common frames, and need not be padded.
    """
    pairs = Pairs.within(truth, estimates, threshold, distance)
    together = np.zeros((pairs.person_count, pairs.track_count), dtype=int)
    np.add.at(together, (pairs.persons, pairs.tracks), 1)
    true_positives = int(together[linear_sum_assignment(-together)].sum())
    return Identity(true_positives, len(truth.ids) - true_positives, len(estimates.ids) - true_positives)
