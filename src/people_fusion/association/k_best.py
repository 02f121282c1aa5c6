"""The best solutions in order: assignments of one problem (Murty 1968), choices on top, and many problems at once.

Everything is lazy: what nobody asks for is not computed.
"""

from __future__ import annotations

import heapq
import itertools
from typing import Callable, Iterable, Iterator, List, Optional, Sequence, Tuple, TypeVar

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
    return ((total, columns) for total, columns in announced_assignments(costs) if columns is not None)


def announced_assignments(costs: np.ndarray) -> Iterator[Tuple[float, Optional[np.ndarray]]]:
    """`ranked_assignments`, and before each but the first, before it is solved: its cost and None."""
    turn = itertools.count()  # heaps compare no arrays
    heap: List[Tuple[float, int, np.ndarray, int, np.ndarray]] = []
    allowed, fixed = np.where(np.isfinite(costs), costs, FORBIDDEN), 0
    columns = _best(allowed, np.zeros(0, dtype=int))
    every = np.arange(len(costs))
    while columns is not None:
        total = float(costs[every, columns].sum())
        yield total, columns
        # All others have a first row in which they differ from this one.
        for row, extra in enumerate(_changes(allowed, columns, fixed).tolist(), start=fixed):
            if extra < 0.5 * FORBIDDEN:
                heapq.heappush(heap, (total + max(extra, 0.0), next(turn), allowed, row, columns))
        if not heap:
            return
        total, _, allowed, fixed, columns = heapq.heappop(heap)
        yield total, None
        allowed = allowed.copy()
        allowed[fixed, columns[fixed]] = FORBIDDEN
        columns = _best(allowed, columns[:fixed])


def _best(allowed: np.ndarray, head: np.ndarray) -> Optional[np.ndarray]:
    """(M,) columns of the best assignment whose first rows are as in `head`, or None."""
    matrix = allowed[len(head) :]
    if len(head):
        matrix = matrix.copy()
        matrix[:, head] = FORBIDDEN
    rows, found = linear_sum_assignment(matrix)
    if len(rows) < len(matrix) or (matrix[rows, found] >= FORBIDDEN).any():
        return None
    return np.concatenate([head, found])


def _changes(allowed: np.ndarray, columns: np.ndarray, fixed: int) -> np.ndarray:
    """(M - fixed,) what it costs more, at best, that each row is the first to differ from the best assignment.

    A row takes the column of another one, this one that of a third and so on, until the round is closed or somebody
    takes a column that is free. The cheapest round of a row and those after it is found by Floyd and Warshall, who let
    rows take part one by one, the last first.
    """
    rows, own = allowed[fixed:], columns[fixed:]
    count = len(rows)
    places = np.arange(count)
    free = np.ones(allowed.shape[1], dtype=bool)
    free[columns] = False
    extra = np.zeros((count + 1, count + 1))  # from a row to whose column it takes; the last: free columns
    extra[:count, :count] = rows[:, own]
    extra[:count, count] = rows[:, free].min(axis=1, initial=FORBIDDEN)
    extra[:count] -= rows[places, own][:, None]
    extra[places, places] = FORBIDDEN
    found = np.zeros(count)
    for row in range(count - 1, -1, -1):
        extra = np.minimum(extra[:-1, :-1], extra[:-1, -1:] + extra[-1, :-1])
        found[row] = extra[row, row]
    return found


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
    solutions: Iterable[Tuple[float, Optional[T]]], choices: Callable[[T], Iterator[Tuple[float, S]]]
) -> Iterator[Tuple[float, Optional[T], Optional[S]]]:
    """Solutions in order of cost, each with every choice it leaves, in order of the sum of both costs.

    Args:
        solutions: in order of cost; None announces that nothing cheaper follows, and is passed on.
        choices: of a solution, in order of additional cost >= 0, the first at none.
    """
    turn = itertools.count()
    heap: List[Tuple[float, int, float, T, S, Iterator[Tuple[float, S]]]] = []

    def push(base: float, solution: T, rest: Iterator[Tuple[float, S]]) -> None:
        for extra, choice in itertools.islice(rest, 1):
            heapq.heappush(heap, (base + extra, next(turn), base, solution, choice, rest))

    def until(cost: float) -> Iterator[Tuple[float, T, S]]:
        while heap and heap[0][0] <= cost:
            total, _, base, known, choice, rest = heapq.heappop(heap)
            yield total, known, choice
            push(base, known, rest)

    for cost, solution in solutions:
        yield from until(cost)
        if solution is None:
            yield cost, None, None
        else:
            push(cost, solution, choices(solution))
            yield from until(cost)
    yield from until(np.inf)
