"""One suite over all assignment methods, and what each of them promises."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from people_fusion.association.gates import coarse_pairs
from people_fusion.association.method import ASSIGNMENT_METHODS
from people_fusion.core.config import parse

NAMES = ASSIGNMENT_METHODS.names()


def build(name):
    return ASSIGNMENT_METHODS.build(parse(ASSIGNMENT_METHODS.config_of(name, "assignment"), {}))


@st.composite
def problems(draw):
    shape = (draw(st.integers(1, 5)), draw(st.integers(1, 5)))
    allowed = draw(st.lists(st.booleans(), min_size=shape[0] * shape[1], max_size=shape[0] * shape[1]))
    costs = draw(
        st.lists(st.integers(-20, 20), min_size=shape[0] * shape[1], max_size=shape[0] * shape[1], unique=False)
    )
    tracks, detections = np.nonzero(np.array(allowed).reshape(shape))
    return tracks, detections, np.array(costs, dtype=float).reshape(shape)[tracks, detections], shape


def best_by_enumeration(tracks, detections, costs):
    best = 0.0
    for size in range(1, len(tracks) + 1):
        for subset in itertools.combinations(range(len(tracks)), size):
            rows = list(subset)
            if len(set(tracks[rows])) == size and len(set(detections[rows])) == size:
                best = min(best, float(costs[rows].sum()))
    return best


@pytest.mark.parametrize("name", NAMES)
@given(problem=problems())
def test_nothing_is_assigned_twice(name, problem):
    tracks, detections, costs, shape = problem
    chosen = build(name).assign(tracks, detections, costs, shape)
    assert len(set(tracks[chosen])) == len(chosen) == len(set(detections[chosen]))


@pytest.mark.parametrize("name", NAMES)
def test_a_pair_that_costs_more_than_leaving_alone_is_left_alone(name):
    pairs = np.array([0, 1])
    assert build(name).assign(pairs, pairs, np.array([-0.1, 0.1]), (2, 2)).tolist() == [0]


@pytest.mark.parametrize("name", NAMES)
def test_no_candidates_give_no_pairs(name):
    none = np.zeros(0, dtype=int)
    assert len(build(name).assign(none, none, np.zeros(0), (3, 0))) == 0


@given(problem=problems())
def test_optimal_has_least_cost(problem):
    tracks, detections, costs, shape = problem
    if len(tracks) > 10:
        return
    chosen = build("optimal").assign(tracks, detections, costs, shape)
    assert costs[chosen].sum() == pytest.approx(best_by_enumeration(tracks, detections, costs))


def test_greedy_takes_the_nearest_pair_first_even_where_the_total_suffers():
    tracks, detections = np.array([0, 0, 1, 1]), np.array([0, 1, 0, 1])
    chosen = build("greedy").assign(tracks, detections, np.array([-9.0, -8.0, -8.5, -1.0]), (2, 2))
    assert chosen.tolist() == [0, 3]


@given(seed=st.integers(0, 2**32 - 1))
def test_coarse_gate_loses_no_pair_of_the_fine_one(seed):
    rng = np.random.default_rng(seed)
    predicted, detected = rng.normal(scale=2, size=(5, 2)), rng.normal(scale=2, size=(6, 2))
    factors = rng.normal(size=(5, 2, 2))
    spreads = factors @ factors.swapaxes(1, 2) + 0.01 * np.eye(2)
    noise = 0.1 * np.eye(2)
    kept = set(zip(*coarse_pairs(predicted, spreads[:, [0, 1], [0, 1]], detected, np.full((6, 2), 0.1), 9.2)))
    for track, detection in itertools.product(range(5), range(6)):
        difference = predicted[track] - detected[detection]
        if difference @ np.linalg.solve(spreads[track] + noise, difference) <= 9.2:
            assert (track, detection) in kept
