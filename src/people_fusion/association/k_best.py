"""The best solutions in order: assignments of one problem (Murty 1968), choices on top, and many problems at once.

Everything is lazy: what nobody asks for is not computed.
"""

from __future__ import annotations

import heapq
import itertools
from typing import Callable, Iterable, Iterator, List, Sequence, Tuple, TypeVar

import numpy as np
from scipy.optimize import linear_sum_assignment

T = TypeVar("T")
S = TypeVar("S")

FORBIDDEN = 1e6  # no sum of costs comes near it; old SciPy does not take infinity


def ranked_assignments(costs: np.ndarray) -> Iterator[Tuple[float, np.ndarray]]:
    """All assignments of every row to a column of its own, in order of their cost.

    Args:
        costs: (M, C) with C >= M, infinite where a pair is forbidden; finite ones far below `FORBIDDEN`.

    Yields:
        Total cost and the column (M,) of each row. Nothing where no assignment is possible.
    """
    turn = itertools.count()  # heaps compare no arrays
    heap: List[Tuple[float, int, np.ndarray, np.ndarray, int]] = []

    def solve(allowed: np.ndarray, fixed: int, head: np.ndarray) -> None:
        """The best with the first rows as in `head`; the others keep to what is allowed."""
        matrix = allowed[fixed:]
        if fixed:
            matrix = matrix.copy()
            matrix[:, head] = FORBIDDEN
        rows, found = linear_sum_assignment(matrix)
        if len(rows) < len(matrix) or (matrix[rows, found] >= FORBIDDEN).any():
            return
        columns = np.concatenate([head, found])
        total = float(costs[np.arange(len(costs)), columns].sum())
        heapq.heappush(heap, (total, next(turn), columns, allowed, fixed))

    if not len(costs):
        yield 0.0, np.zeros(0, dtype=int)
        return
    solve(np.where(np.isfinite(costs), costs, FORBIDDEN), 0, np.zeros(0, dtype=int))
    while heap:
        total, _, columns, allowed, fixed = heapq.heappop(heap)
        yield total, columns
        # All others have a first row in which they differ from this one.
        is_open = allowed < FORBIDDEN
        is_open[:, columns[:fixed]] = False
        for row in range(fixed, len(costs)):
            if np.count_nonzero(is_open[row]) > 1:
                others = allowed.copy()
                others[row, columns[row]] = FORBIDDEN
                solve(others, row, columns[:row])
            is_open[:, columns[row]] = False


def ranked_subsets(costs: Sequence[float]) -> Iterator[Tuple[float, Tuple[int, ...]]]:
    """All subsets of items with costs >= 0, in order of the sum of their costs, the empty one first."""
    yield 0.0, ()
    order = sorted(range(len(costs)), key=lambda item: costs[item])
    heap: List[Tuple[float, Tuple[int, ...]]] = [(costs[order[0]], (0,))] if order else []
    while heap:
        total, places = heapq.heappop(heap)
        yield total, tuple(order[place] for place in places)
        last = places[-1]
        if last + 1 < len(order):
            step = costs[order[last + 1]]
            heapq.heappush(heap, (total + step, (*places, last + 1)))
            heapq.heappush(heap, (total + step - costs[order[last]], (*places[:-1], last + 1)))


def with_choices(
    solutions: Iterable[Tuple[float, T]], choices: Callable[[T], Iterator[Tuple[float, S]]]
) -> Iterator[Tuple[float, T, S]]:
    """Solutions in order of cost, each with every choice it leaves, in order of the sum of both costs.

    Args:
        solutions: in order of cost.
        choices: of a solution, in order of additional cost >= 0, the first at none.
    """
    turn = itertools.count()
    heap: List[Tuple[float, int, float, T, S, Iterator[Tuple[float, S]]]] = []

    def push(base: float, solution: T, rest: Iterator[Tuple[float, S]]) -> None:
        for extra, choice in itertools.islice(rest, 1):
            heapq.heappush(heap, (base + extra, next(turn), base, solution, choice, rest))

    for cost, solution in solutions:
        while heap and heap[0][0] < cost:
            total, _, base, known, choice, rest = heapq.heappop(heap)
            yield total, known, choice
            push(base, known, rest)
        push(cost, solution, choices(solution))
    while heap:
        total, _, base, known, choice, rest = heapq.heappop(heap)
        yield total, known, choice
        push(base, known, rest)
