"""AdaBoost with decision stumps on single features (Arras et al. 2012, 2.1, table 1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Callable, List, Tuple

import numpy as np

from people_fusion.core.errors import DataError

PERFECT = 1.0 - 1e-9  # of a correlation: a stump without error would have an infinite weight


@dataclass(frozen=True, eq=False)
class Stumps:
    """T weak classifiers, eq. 1: h(e) is 1 where parity * feature < parity * threshold, else -1.

    Thresholds lie between the values that were trained on; a value that equals one counts as above it.

    Attributes:
        features: (T,) index of the feature.
        thresholds: (T,).
        parities: (T,) +1 or -1.
        weights: (T,) alpha, positive.
    """

    features: np.ndarray
    thresholds: np.ndarray
    parities: np.ndarray
    weights: np.ndarray

    def __post_init__(self) -> None:
        # The stumps of one feature add up to a function of steps, in which an example is looked up once.
        total, tables = self.weights.sum(), []
        for feature in np.unique(self.features).tolist():
            rows = np.flatnonzero(self.features == feature)
            rows = rows[np.argsort(self.thresholds[rows], kind="stable")]
            votes = (self.weights * self.parities)[rows] / total
            tables.append((feature, self.thresholds[rows], votes.sum() - 2.0 * np.cumsum(np.append(0.0, votes))))
        object.__setattr__(self, "_tables", tuple(tables))

    def scores(self, examples: np.ndarray) -> np.ndarray:
        """(N,) in [-1, 1]: F(e) of table 1 for examples (N, F), divided by the sum of the weights."""
        tables: Tuple[Tuple[int, np.ndarray, np.ndarray], ...] = self._tables  # type: ignore[attr-defined]
        total = np.zeros(len(examples))
        for feature, thresholds, levels in tables:
            total += levels[np.searchsorted(thresholds, examples[:, feature], side="right")]
        return total


def adaboost(
    examples: np.ndarray,
    labels: np.ndarray,
    rounds: int,
    columns: np.ndarray,
    progress: Callable[[int], None] = lambda _round: None,
) -> Stumps:
    """Learn a strong classifier as in table 1.

    Args:
        examples: (N, F) features, finite.
        labels: (N,) bool, True for a leg.
        rounds: T. Fewer are made where one stump tells all, or none is better than guessing.
        columns: features that may be used.
        progress: called after each round.

    Raises:
        DataError: not both classes are there, a feature is not finite, or none tells them apart.
    """
    if labels.all() or not labels.any():
        raise DataError("training needs examples of both classes", f"{int(labels.sum())} of {len(labels)} are legs")
    if not np.isfinite(examples[:, columns]).all():
        raise DataError("a feature is not finite")
    signs = np.where(labels, 1.0, -1.0)
    values = examples[:, columns].T
    order = np.argsort(values, axis=1, kind="stable")
    ordered = np.take_along_axis(values, order, axis=1)
    is_cut = ordered[:, :-1] < ordered[:, 1:]
    weights = np.where(labels, 0.5 / labels.sum(), 0.5 / (~labels).sum())
    chosen: List[Tuple[int, float, float, float]] = []
    for index in range(rounds):
        weights = weights / weights.sum()
        votes = weights * signs
        # r of a stump that cuts behind each example: those below count for it, those above against.
        correlation = 2.0 * np.cumsum(votes[order], axis=1)[:, :-1] - votes.sum()
        strength = np.where(is_cut, np.abs(correlation), 0.0)
        row, cut = np.unravel_index(int(np.argmax(strength)), strength.shape)
        if strength[row, cut] <= 0.0:
            break
        r = min(float(strength[row, cut]), PERFECT)
        parity = 1.0 if correlation[row, cut] > 0 else -1.0
        threshold = 0.5 * (ordered[row, cut] + ordered[row, cut + 1])
        alpha = 0.5 * np.log((1.0 + r) / (1.0 - r))
        says = np.where(values[row] < threshold, parity, -parity)
        weights = weights * np.exp(-alpha * signs * says)
        chosen.append((int(columns[row]), float(threshold), parity, float(alpha)))
        progress(index + 1)
        if r == PERFECT:
            break
    if not chosen:
        raise DataError("no feature tells the classes apart")
    features, thresholds, parities, alphas = zip(*chosen)
    return Stumps(np.array(features), np.array(thresholds), np.array(parities), np.array(alphas))
