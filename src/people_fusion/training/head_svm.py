"""A linear support vector machine with weighted examples."""

from __future__ import annotations

from typing import NamedTuple, Optional

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from people_fusion.core.errors import DataError

ITERATIONS = 60
TOLERANCE = 1e-4  # of the gradient, beside that at the start


class Svm(NamedTuple):
    """Score of an example x: weights @ x + bias (Poschmann 2018, eq. 4.1).

    Attributes:
        weights: (D,).
        bias: score of nothing.
    """

    weights: np.ndarray
    bias: float

    def scores(self, values: np.ndarray) -> np.ndarray:
        """(N,) of examples (N, D)."""
        return np.asarray(values @ self.weights.astype(values.dtype), dtype=float) + self.bias


def train_svm(positives: np.ndarray, negatives: np.ndarray, penalty: float, start: Optional[Svm] = None) -> Svm:
    """The least of |w|^2 / 2 + C sum_i v_i max(0, 1 - y_i f(x_i))^2, by Newton steps (Keerthi & DeCoste 2005).

    The weights v of each class sum to half the number of examples (Poschmann 2018, 4.4); the bias is not penalised.

    Args:
        positives, negatives: (P, D) and (N, D).
        penalty: C.
        start: where to begin, for speed.

    Raises:
        DataError: a class is empty.
    """
    if not len(positives) or not len(negatives):
        raise DataError(f"{len(positives)} positives and {len(negatives)} negatives: nothing can be told apart")
    values = np.vstack([positives, negatives])
    count, size = values.shape
    signs = np.repeat([1.0, -1.0], [len(positives), len(negatives)])
    cost = np.repeat([0.5 / len(positives), 0.5 / len(negatives)], [len(positives), len(negatives)]) * penalty * count
    point = np.zeros(size + 1) if start is None else np.append(start.weights, start.bias)

    def scores(at: np.ndarray) -> np.ndarray:
        return Svm(at[:-1], at[-1]).scores(values)

    found, first = scores(point), np.inf
    for _ in range(ITERATIONS):
        active = np.flatnonzero(signs * found < 1.0)
        inside = values[active]
        pull = 2.0 * cost[active] * (found[active] - signs[active])
        gradient = np.append(point[:-1] + inside.T @ pull.astype(values.dtype), pull.sum())
        norm = float(np.linalg.norm(gradient))
        first = min(first, norm) if np.isinf(first) else first
        if norm <= TOLERANCE * max(first, 1.0):
            break
        step = -_solve(inside, 2.0 * cost[active], gradient)
        change = scores(step)
        length = _line_search(point[:-1], step[:-1], found, change, signs, cost)
        point, found = point + length * step, found + length * change
    return Svm(point[:-1], float(point[-1]))


def _solve(inside: np.ndarray, curvature: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Solution of the Newton system; the Hessian is that of the examples inside the margin."""
    size = inside.shape[1]
    weighted = inside * np.sqrt(curvature)[:, None].astype(inside.dtype)
    hessian = np.empty((size + 1, size + 1))
    hessian[:size, :size] = weighted.T @ weighted
    hessian[:size, size] = hessian[size, :size] = inside.T @ curvature.astype(inside.dtype)
    hessian[size, size] = curvature.sum() + 1e-9
    hessian[np.arange(size), np.arange(size)] += 1.0
    return np.asarray(cho_solve(cho_factor(hessian, overwrite_a=True), gradient))


def _line_search(
    weights: np.ndarray, step: np.ndarray, scores: np.ndarray, change: np.ndarray, signs: np.ndarray, cost: np.ndarray
) -> float:
    """The best length of a step: the loss along it is convex, its derivative piecewise linear."""

    def slope(length: float) -> float:
        at = scores + length * change
        active = signs * at < 1.0
        losses = 2.0 * cost[active] * (at[active] - signs[active]) * change[active]
        return float(weights @ step + length * step @ step + losses.sum())

    low, high = 0.0, 1.0
    while slope(high) < 0.0 and high < 1e3:
        low, high = high, 2.0 * high
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slope(middle) < 0.0 else (low, middle)
    return 0.5 * (low + high)
