"""What the next assignment costs is known before it is solved, so that who asks for no more solves no more."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.association import k_best
from people_fusion.association.k_best import announced_assignments, ranked_subsets, with_choices


def matrix(seed, rows, extra, forbidden):
    """Some costs are round, so that they tie."""
    rng = np.random.default_rng(seed)
    costs = rng.normal(scale=3.0, size=(rows, rows + extra))
    costs = np.where(rng.random(costs.shape) < 0.3, np.round(costs), costs)
    costs[rng.random(costs.shape) < forbidden] = np.inf
    return costs


@settings(max_examples=100, deadline=None)
@given(
    seed=st.integers(0, 10_000), rows=st.integers(0, 7), extra=st.integers(0, 7), forbidden=st.floats(0.0, 0.8)
)
def test_each_cost_is_announced(seed, rows, extra, forbidden):
    found = list(itertools.islice(announced_assignments(matrix(seed, rows, extra, forbidden)), 201))
    assert all(columns is not None for _, columns in found[::2])
    for (announced, nothing), (total, _) in zip(found[1::2], found[2::2]):
        assert nothing is None and total == pytest.approx(announced, abs=1e-9)
    assert len(found) % 2 == 1 or not found  # what is announced comes


def test_only_what_is_asked_for_is_solved(monkeypatch):
    solved, solve = [], k_best.linear_sum_assignment
    monkeypatch.setattr(k_best, "linear_sum_assignment", lambda costs: solved.append(1) or solve(costs))
    ranked = announced_assignments(matrix(0, 6, 3, 0.0))
    for count in range(1, 20):
        next(ranked)
        assert len(solved) == (count + 1) // 2


def test_announcements_are_passed_on_between_choices():
    solutions = [(0.0, "a"), (0.7, None), (0.7, "b")]
    found = list(with_choices(solutions, lambda _: ranked_subsets([0.5])))
    assert found == [
        (0.0, "a", ()), (0.5, "a", (0,)), (0.7, None, None), (0.7, "b", ()), (1.2, "b", (0,))
    ]  # fmt: skip
