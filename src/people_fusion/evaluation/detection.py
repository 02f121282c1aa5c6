"""How well a detector finds things in images: miss rate over false positives per image (Dollár et al. 2012, and
Poschmann 2018, 4.5.1)."""

from __future__ import annotations

from typing import NamedTuple, Sequence

import numpy as np

from people_fusion.cues.heads.boxes import overlaps

MATCH = 0.5  # intersection over union, Pascal criterion
REFERENCES = np.logspace(-2.0, 0.0, 9)  # false positives per image at which miss rates are averaged
LEAST_MISS_RATE = 1e-10  # a logarithm is taken


class Matches(NamedTuple):
    """What became of the detections in one image, or in several.

    Attributes:
        scores: (D,) of those that count: true or false, not ignored.
        true: (D,) which of them found something that is considered.
        considered: how many there were to be found.
        images: how many images.
    """

    scores: np.ndarray
    true: np.ndarray
    considered: int
    images: int


class DetCurve(NamedTuple):
    """Detection error tradeoff: one point for each threshold, from the strictest to the laxest.

    Attributes:
        false_positives: (P,) per image, not falling.
        miss_rates: (P,) not rising.
        thresholds: (P,) lowest score that counts as found; the first is infinite.
    """

    false_positives: np.ndarray
    miss_rates: np.ndarray
    thresholds: np.ndarray


def match(
    corners: np.ndarray, scores: np.ndarray, truth: np.ndarray, considered: np.ndarray, overlap: float = MATCH
) -> Matches:
    """Detections against annotations in one image, greedily, the best score first.

    A detection takes the free considered annotation that it overlaps most. If there is none, and it overlaps an
    ignored one, it counts as nothing at all; these can take any number of detections. Else it is false.

    Args:
        corners: (D, 4) detections as left, top, right, bottom.
        scores: (D,) theirs; of equal ones the first is matched first.
        truth: (A, 4) annotations.
        considered: (A,) which of them should be found; the others are ignored.
        overlap: intersection over union from which two boxes hold the same.
    """
    shared = overlaps(corners, truth)
    free, ignored = considered.astype(bool), ~considered.astype(bool)
    counts, true = np.zeros(len(scores), dtype=bool), np.zeros(len(scores), dtype=bool)
    for row in np.argsort(-scores, kind="stable").tolist():
        open_to_it = np.where(free, shared[row], -1.0)
        best = int(np.argmax(open_to_it)) if len(truth) else -1
        if best >= 0 and open_to_it[best] >= overlap:
            free[best] = False
            counts[row] = true[row] = True
        else:
            counts[row] = not (shared[row, ignored] >= overlap).any()
    return Matches(scores[counts], true[counts], int(considered.sum()), 1)


def together(several: Sequence[Matches]) -> Matches:
    """Matches of many images as one."""
    return Matches(
        np.concatenate([np.zeros(0), *(entry.scores for entry in several)]),
        np.concatenate([np.zeros(0, dtype=bool), *(entry.true for entry in several)]),
        sum(entry.considered for entry in several),
        sum(entry.images for entry in several),
    )


def det_curve(matches: Matches) -> DetCurve:
    """The curve over all thresholds; equal scores pass together. Miss rates are NaN where nothing is to be found."""
    order = np.argsort(-matches.scores, kind="stable")
    scores, true = matches.scores[order], matches.true[order]
    last = np.flatnonzero(np.append(scores[1:] != scores[:-1], len(scores) > 0))
    found, false = np.cumsum(true)[last], np.cumsum(~true)[last]
    possible = matches.considered if matches.considered else np.nan
    return DetCurve(
        np.append(0.0, false / max(matches.images, 1)),
        np.append(1.0 + 0.0 * possible, 1.0 - found / possible),
        np.append(np.inf, scores[last]),
    )


def miss_rates_at(curve: DetCurve, false_positives: np.ndarray) -> np.ndarray:
    """(R,) miss rate at the laxest threshold with at most so many false positives per image (R,).

    A curve that ends before is continued with its last miss rate, as in Dollár's own evaluation.
    """
    places = np.searchsorted(curve.false_positives, false_positives, side="right") - 1
    return np.asarray(curve.miss_rates[places])


def log_average_miss_rate(curve: DetCurve) -> float:
    """Geometric mean of the miss rates at nine points from 0.01 to 1 false positives per image (Dollár et al. 2012)."""
    rates = np.maximum(miss_rates_at(curve, REFERENCES), LEAST_MISS_RATE)
    return float(np.exp(np.log(rates).mean()))
