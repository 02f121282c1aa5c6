"""All scores of a tracker's output against truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Dict, Optional, Union

import numpy as np

from people_fusion.evaluation.clear_mot import THRESHOLD_M, ClearMot, Event, Events, match
from people_fusion.evaluation.consistency import Consistency, position_nees, state_nees
from people_fusion.evaluation.distances import IMAGE_THRESHOLD, Distance
from people_fusion.evaluation.hota import Hota, hota_scores
from people_fusion.evaluation.identity import Identity, identity_scores
from people_fusion.evaluation.truth import Estimates, Truth


@dataclass(frozen=True)
class Scores:
    """Counts of one run, or of several added with `+` (Poschmann adds five); `Scores()` is the sum of none.

    Attributes:
        clear_mot: misses, false positives, mismatches, distances.
        identity: IDF1.
        hota: HOTA.
        position_consistency: NEES of matched positions in the plane, dimension 2.
        state_consistency: NEES of matched positions and velocities in the plane, dimension 4.
    """

    clear_mot: ClearMot = field(default_factory=ClearMot)
    identity: Identity = field(default_factory=Identity)
    hota: Hota = field(default_factory=Hota)
    position_consistency: Consistency = field(default_factory=lambda: Consistency(2))
    state_consistency: Consistency = field(default_factory=lambda: Consistency(4))

    def __add__(self, other: Scores) -> Scores:
        """Scores of both together."""
        return Scores(
            self.clear_mot + other.clear_mot,
            self.identity + other.identity,
            self.hota + other.hota,
            self.position_consistency + other.position_consistency,
            self.state_consistency + other.state_consistency,
        )

    def to_dict(self) -> Dict[str, Union[float, int, None]]:
        """For JSON: rates as fractions of 1, None where undefined."""
        clear, hota = self.clear_mot, self.hota
        return {
            "mota": clear.mota,
            "motp_m": clear.motp_m,
            "motp_image": clear.motp_image,
            "miss_rate": clear.miss_rate,
            "false_positive_rate": clear.false_positive_rate,
            "mismatch_rate": clear.mismatch_rate,
            "recall": clear.recall,
            "precision": clear.precision,
            "idf1": self.identity.idf1,
            "idp": self.identity.idp,
            "idr": self.identity.idr,
            "hota": hota.hota,
            "deta": hota.detection_accuracy,
            "assa": hota.association_accuracy,
            "loca": hota.localisation_accuracy,
            "nees": self.position_consistency.average,
            "nees_inside_95": self.position_consistency.inside_share,
            "nees_4d": self.state_consistency.average,
            "matches": clear.matches,
            "misses": clear.misses,
            "false_positives": clear.false_positives,
            "identity_switches": clear.mismatches,
            "takeovers": clear.takeovers,
            "transfers": clear.transfers,
            "ground_truth_count": clear.ground_truth_count,
            "frames": clear.frames,
            "only_annotated": clear.only_annotated,
        }


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Scores of one run and the events behind them.

    Attributes:
        scores: counts, which can be added over runs.
        events: what happened in each frame.
        nees: (E,) NEES in the plane of each event, NaN where there is none.
        threshold_m: largest distance of a match; in an image not metres, but one minus overlap.
    """

    scores: Scores
    events: Events
    nees: np.ndarray
    threshold_m: float

    def to_dict(self) -> Dict[str, Union[float, int, None]]:
        """See `Scores.to_dict`."""
        return self.scores.to_dict()


def evaluate(
    truth: Truth, estimates: Estimates, threshold_m: float = THRESHOLD_M, only_annotated: bool = False
) -> Evaluation:
    """Score a run.

    Args:
        truth: annotated people.
        estimates: the people that the tracker reports at the truth's frames.
        threshold_m: largest distance of a match in the ground plane; half the distance where HOTA's similarity is 0.
        only_annotated: not everybody is annotated; tracks that match nobody are left out of all scores, and precision
            is undefined.

    Raises:
        DataError: if an estimate belongs to no frame, or a covariance of a matched one is not positive definite.
    """
    return _evaluate(truth, estimates, threshold_m, only_annotated, 2.0 * threshold_m, None)


def evaluate_in_image(
    truth: Truth,
    estimates: Estimates,
    distance: Distance,
    threshold: float = IMAGE_THRESHOLD,
    only_annotated: bool = False,
) -> Evaluation:
    """Score a run by the boxes that people and tracks fill in an image (Volkhardt et al. 2013, IV).

    NEES is that of the positions of those who match.

    Args:
        truth: annotated people who are in the image.
        estimates: reported people who are in the image.
        distance: of their rows, from `in_the_image`.
        threshold: largest distance of a match; HOTA's similarity is 0 where boxes do not overlap.
        only_annotated: see `evaluate`.

    Raises:
        DataError: see `evaluate`.
    """
    return _evaluate(truth, estimates, threshold, only_annotated, 1.0, distance)


def _evaluate(
    truth: Truth,
    estimates: Estimates,
    threshold: float,
    only_annotated: bool,
    zero_distance: float,
    distance: Optional[Distance],
) -> Evaluation:
    events = match(truth, estimates, threshold, only_annotated, distance)
    nees = position_nees(truth, estimates, events)
    known, known_distance = estimates, distance
    if only_annotated:
        rows = _known_rows(events, len(estimates.ids))
        known = estimates.select(rows)
        known_distance = None if distance is None else _of_rows(distance, rows)
    scores = Scores(
        ClearMot.of(events, truth.frame_count, only_annotated, distance is not None),
        identity_scores(truth, known, threshold, known_distance),
        hota_scores(truth, known, zero_distance, known_distance),
        Consistency.of(nees, 2),
        Consistency.of(state_nees(truth, estimates, events), 4),
    )
    return Evaluation(scores, events, nees, threshold)


def _known_rows(events: Events, count: int) -> np.ndarray:
    """Rows of the estimates that are not ignored."""
    return np.setdiff1d(np.arange(count), events.estimate_rows[events.kinds == Event.IGNORED])


def _of_rows(distance: Distance, rows: np.ndarray) -> Distance:
    """The distance of some rows of the estimates alone."""
    return lambda people, tracks: distance(people, rows[tracks])
