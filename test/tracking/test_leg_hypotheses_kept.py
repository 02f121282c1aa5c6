"""The children that are kept, against all children of all parents written out and sorted."""

import itertools
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.association import k_best
from people_fusion.tracking.leg_hypotheses import APPROVED, BESIDE, FREE, Forest, MhtConfig, MultiHypothesisTracker

R = 0.05**2 * np.eye(2)
DT = 0.1


def probabilities(config):
    """Of detected, occluded and deleted by kind."""
    approved = [config.approved_p_detected, config.approved_p_occluded, config.approved_p_deleted]
    beside = [config.approved_p_detected, 1.0 - config.approved_p_detected - config.p_deleted, config.p_deleted]
    return {
        FREE: [config.p_detected, config.p_occluded, config.p_deleted], APPROVED: approved, BESIDE: beside
    }  # fmt: skip


def every_child(config, forest, positions, kinds, ids):
    """(log p, {(identity, whether it was seen)}) of all children: every label of each leg and of each track."""
    found, of_kind = [], probabilities(config)
    for parent in forest.hypotheses:
        rows = list(parent.tracks)
        for labels in itertools.product(["new", "false", *rows], repeat=len(positions)):
            of_tracks = [label for label in labels if label in rows]
            if len(set(of_tracks)) < len(of_tracks):
                continue
            log_p, leaves = parent.log_p, []
            for label, z, name in zip(labels, positions, ids):
                if label == "new":
                    log_p += np.log(config.new_rate)
                    leaves.append((name, True))
                elif label == "false":
                    log_p += np.log(config.false_rate)
                else:
                    nu, S = z - forest.tracks.means[label, :2], forest.tracks.covariances[label, :2, :2] + R
                    distance = nu @ np.linalg.solve(S, nu)
                    log_p += np.log(of_kind[kinds[label]][0]) - 0.5 * distance
                    log_p -= 0.5 * np.log(np.linalg.det(2.0 * np.pi * S))
                    log_p = log_p if distance <= config.gate else -np.inf
                    leaves.append((int(forest.tracks.ids[label]), True))
            if log_p == -np.inf:
                continue
            missed = [row for row in rows if row not in labels]
            for gone in itertools.product([False, True], repeat=len(missed)):
                q, left = log_p, list(leaves)
                for row, is_gone in zip(missed, gone):
                    q += np.log(of_kind[kinds[row]][2 if is_gone else 1])
                    if not is_gone:
                        left.append((int(forest.tracks.ids[row]), False))
                found.append((q, frozenset(left)))
    return sorted(found, key=lambda entry: -entry[0])


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    most=st.integers(1, 60),
    min_ratio=st.sampled_from([0.0, 1e-4, 0.05]),
    new_rate=st.sampled_from([0.001, 0.37]),
)
def test_the_best_children_of_all_parents_are_kept_and_no_others(seed, most, min_ratio, new_rate):
    rng = np.random.default_rng(seed)
    config = MhtConfig(max_hypotheses=8, scan_back=100, new_rate=new_rate)
    tracker, forest = MultiHypothesisTracker(config), Forest.seed()
    for step in range(4):
        count = int(rng.integers(0, 4))
        positions, ids = rng.uniform(-0.4, 0.4, size=(count, 2)), 10 * step + np.arange(count)
        kinds = rng.integers(0, 3, size=len(forest.tracks.ids))
        noise = np.tile(R, (count, 1, 1))
        forest = tracker.predict(forest, DT)
        if step == 3:
            config = replace(config, max_hypotheses=most, min_ratio=min_ratio)
        before, tracker = forest, MultiHypothesisTracker(config)
        forest = tracker.grow(forest, step, positions, noise, ids, kinds)
    expected = every_child(config, before, positions, kinds, ids)
    expected = [entry for entry in expected if np.exp(entry[0] - expected[0][0]) >= min_ratio]
    shed, expected = len(expected) > most, expected[:most]
    assert tracker.counts["hypotheses shed: too many"] == shed
    total = np.logaddexp.reduce([log_p for log_p, _ in expected])
    ours = [entry.log_p for entry in forest.hypotheses]
    np.testing.assert_allclose(ours, [log_p - total for log_p, _ in expected], atol=1e-9)
    seen = list(zip(forest.tracks.ids.tolist(), (forest.tracks.seen_ns == 3).tolist()))
    found = [(entry.log_p, frozenset(seen[row] for row in entry.tracks)) for entry in forest.hypotheses]
    wanted = [(log_p - total, leaves) for log_p, leaves in expected]
    last = ours[-1] + 1e-9  # of those that tie with the last any may be kept
    assert Counter(leaves for log_p, leaves in found if log_p > last) == Counter(
        leaves for log_p, leaves in wanted if log_p > last
    )


def test_no_more_is_solved_than_parents_and_children_that_are_kept(monkeypatch):
    """What bounds the work of a scan."""
    solved, solve = [], k_best.linear_sum_assignment
    monkeypatch.setattr(k_best, "linear_sum_assignment", lambda costs: solved.append(costs.shape) or solve(costs))
    rng = np.random.default_rng(0)
    config = MhtConfig(max_hypotheses=20)
    tracker, forest = MultiHypothesisTracker(config), Forest.seed()
    spared = 0
    for step in range(20):
        solved.clear()
        parents, tracks = len(forest.hypotheses), len(forest.tracks.ids)
        forest = tracker.grow(
            tracker.predict(forest, DT), step, rng.uniform(-0.5, 0.5, (10, 2)), np.tile(R, (10, 1, 1)),
            100 * step + np.arange(10), np.full(tracks, FREE),
        )  # fmt: skip
        assert len(solved) <= parents + config.max_hypotheses + 1
        spared += len(solved) < parents
    assert spared  # most parents have no child that is kept, which is known without a solution


def test_legs_that_fit_no_track_are_the_first_to_be_shed():
    config = MhtConfig(max_legs=3, new_rate=0.01)
    tracker, forest = MultiHypothesisTracker(config), Forest.seed()
    walls = [(5.0 + k, 5.0) for k in range(10)]
    for step in range(20):
        scan = np.array([(0.05 * step, 0.0)] if step < 5 else [*walls, (0.05 * step, 0.0)])
        tracks, forest = len(forest.tracks.ids), tracker.predict(forest, DT)
        forest = tracker.grow(
            forest, step, scan, np.tile(R, (len(scan), 1, 1)), 100 * step + np.arange(len(scan)),
            np.full(tracks, FREE),
        )  # fmt: skip
    best = forest.tracks.take(np.array(forest.hypotheses[0].tracks))
    walker = best.means[:, 1] < 1.0
    assert best.seen_ns[walker].tolist() == [19] and best.ids[walker][0] < 500
    assert tracker.counts["legs shed: too many"] == 15 * 8
    assert best.means[:, 0].max() < 7.5  # of the others, the first two were looked at
    assert best.means[walker, 0] == pytest.approx(0.95, abs=0.05)
