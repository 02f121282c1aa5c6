"""Ranked solutions against brute force."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.association.k_best import ranked_assignments, ranked_subsets, with_choices


def brute_force(costs):
    rows, columns = costs.shape
    sums = (sum(costs[i, p[i]] for i in range(rows)) for p in itertools.permutations(range(columns), rows))
    return sorted(total for total in sums if np.isfinite(total))


@settings(max_examples=80, deadline=None)
@given(
    seed=st.integers(0, 10_000), rows=st.integers(0, 5), extra=st.integers(0, 2), forbidden=st.floats(0.0, 0.6)
)
def test_all_assignments_come_in_order_and_once(seed, rows, extra, forbidden):
    rng = np.random.default_rng(seed)
    costs = rng.normal(scale=10.0, size=(rows, rows + extra))
    costs[rng.random(costs.shape) < forbidden] = np.inf
    found = list(ranked_assignments(costs))
    np.testing.assert_allclose([total for total, _ in found], brute_force(costs), atol=1e-9)
    assert len({tuple(columns) for _, columns in found}) == len(found)
    for total, columns in found:
        assert len(set(columns.tolist())) == rows
        assert total == pytest.approx(costs[np.arange(rows), columns].sum())


@pytest.mark.parametrize("size", [6, 7])
def test_seven_by_seven(size):
    costs = np.random.default_rng(size).normal(size=(size, size))
    found = [total for total, _ in itertools.islice(ranked_assignments(costs), 500)]
    np.testing.assert_allclose(found, brute_force(costs)[:500], atol=1e-9)


def test_costs_that_tie_come_once_each():
    assert len(list(ranked_assignments(np.zeros((3, 3))))) == 6


def test_where_nothing_is_allowed_nothing_comes():
    assert list(ranked_assignments(np.array([[np.inf, np.inf], [1.0, 2.0]]))) == []


@given(st.lists(st.floats(0.0, 10.0), max_size=8))
def test_all_subsets_come_in_order_and_once(costs):
    found = list(ranked_subsets(costs))
    assert len({chosen for _, chosen in found}) == len(found) == 2 ** len(costs)
    totals = [total for total, _ in found]
    for total, chosen in found:
        assert len(set(chosen)) == len(chosen)
        assert total == pytest.approx(sum(costs[item] for item in chosen), abs=1e-9)
    assert all(a <= b + 1e-9 for a, b in zip(totals, totals[1:]))


def test_choices_of_all_solutions_come_in_order_of_the_whole_cost():
    prices = {"a": [1.0, 5.0], "b": [0.5], "c": []}
    solutions = [(0.0, "a"), (0.7, "b"), (3.0, "c")]
    found = list(with_choices(solutions, lambda name: ranked_subsets(prices[name])))
    assert [name for _, name, _ in found] == ["a", "b", "a", "b", "c", "a", "a"]
    assert [total for total, _, _ in found] == pytest.approx([0.0, 0.7, 1.0, 1.2, 3.0, 5.0, 6.0])


def test_only_what_is_asked_for_is_solved():
    asked = []

    def endless():
        for cost in itertools.count():
            asked.append(cost)
            yield float(cost), cost

    list(itertools.islice(with_choices(endless(), lambda _: ranked_subsets([])), 3))
    assert len(asked) <= 5
