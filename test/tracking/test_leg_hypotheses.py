"""The forest of hypotheses against eq. 15 written out for every hypothesis there is."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from people_fusion.core.errors import ConfigError
from people_fusion.tracking.leg_hypotheses import Forest, LegTracks, MhtConfig, MultiHypothesisTracker

EVERYTHING = MhtConfig(max_hypotheses=1_000_000, min_ratio=0.0, scan_back=100, gate=1e9)
R = 0.05**2 * np.eye(2)
DT = 0.1


def grow(tracker, forest, step, positions, approved=lambda _: False):
    positions = np.asarray(positions, dtype=float).reshape(-1, 2)
    forest = tracker.predict(forest, DT if step else 0.0)
    return tracker.grow(
        forest,
        step * 10**8,
        positions,
        np.tile(R, (len(positions), 1, 1)),
        100 * (step + 1) + np.arange(len(positions)),
        np.array([approved(name) for name in forest.tracks.ids.tolist()], dtype=int),
    )


def enumerate_all(config, scans, approved=lambda _: False, start=None):
    """Every hypothesis as (probability, {identity: mean}), by eq. 15 and textbook Kalman filters."""
    F = np.eye(4)
    F[0, 2] = F[1, 3] = DT
    G = np.vstack([0.5 * DT**2 * np.eye(2), DT * np.eye(2)])
    Q, H = config.acceleration_std**2 * G @ G.T, np.eye(2, 4)
    leaves = [(1.0, start or {})]
    for step, scan in enumerate(scans, start=1 if start else 0):
        grown = []
        for p, tracks in leaves:
            if step:
                tracks = {name: (F @ x, F @ P @ F.T + Q) for name, (x, P) in tracks.items()}
            names = list(tracks)
            for labels in itertools.product(["new", "false", *names], repeat=len(scan)):
                used = [label for label in labels if label in tracks]
                if len(set(used)) < len(used):
                    continue
                missed = [name for name in names if name not in used]
                for gone in itertools.product([False, True], repeat=len(missed)):
                    q, after = p, {}
                    for name, is_gone in zip(missed, gone):
                        kind = "approved_" if approved(name) else ""
                        q *= getattr(config, f"{kind}p_{'deleted' if is_gone else 'occluded'}")
                        if not is_gone:
                            after[name] = tracks[name]
                    for place, (label, z) in enumerate(zip(labels, scan)):
                        if label == "new":
                            q *= config.new_rate
                            P = np.zeros((4, 4))
                            P[:2, :2], P[2:, 2:] = R, config.initial_speed_std**2 * np.eye(2)
                            after[100 * (step + 1) + place] = (np.array([*z, 0.0, 0.0]), P)
                        elif label == "false":
                            q *= config.false_rate
                        else:
                            x, P = tracks[label]
                            S, nu = H @ P @ H.T + R, np.asarray(z) - x[:2]
                            density = np.exp(-0.5 * nu @ np.linalg.inv(S) @ nu) / np.sqrt(np.linalg.det(2 * np.pi * S))
                            q *= density * getattr(config, f"{'approved_' if approved(label) else ''}p_detected")
                            K = P @ H.T @ np.linalg.inv(S)
                            after[label] = (x + K @ nu, P - K @ S @ K.T)
                    grown.append((q, after))
        total = sum(q for q, _ in grown)
        leaves = [(q / total, after) for q, after in grown]
    return leaves


def compare(forest, leaves):
    ours = sorted(np.exp([entry.log_p for entry in forest.hypotheses]))
    theirs = sorted(q for q, _ in leaves if q > 1e-300)
    assert len(ours) >= len(theirs)
    np.testing.assert_allclose(ours[-len(theirs) :], theirs, rtol=1e-6, atol=1e-12)
    marginal = {}
    for q, tracks in leaves:
        for name in tracks:
            marginal[name] = marginal.get(name, 0.0) + q
    found = {}
    for name, share in zip(forest.tracks.ids.tolist(), forest.marginals().tolist()):
        found[name] = found.get(name, 0.0) + share
    for name, share in marginal.items():
        assert found.get(name, 0.0) == pytest.approx(share, abs=1e-9)
    best = max(leaves, key=lambda leaf: leaf[0])[1]
    rows = list(forest.hypotheses[0].tracks)
    assert sorted(forest.tracks.ids[rows].tolist()) == sorted(best)
    for row in rows:
        np.testing.assert_allclose(forest.tracks.means[row], best[int(forest.tracks.ids[row])][0], atol=1e-9)


def test_with_every_hypothesis_kept_three_scans_equal_full_enumeration():
    scans = [[(0.0, 0.0), (0.5, 0.0)], [(0.05, 0.0), (0.45, 0.02)], [(0.1, 0.01)]]
    tracker, forest = MultiHypothesisTracker(EVERYTHING), Forest.seed()
    for step, scan in enumerate(scans):
        forest = grow(tracker, forest, step, scan)
    compare(forest, enumerate_all(EVERYTHING, scans))


def test_four_tracks_and_four_measurements_equal_full_enumeration():
    first = [(0.0, 0.0), (0.3, 0.0), (0.6, 0.0), (0.9, 0.0)]
    second = [(0.1, 0.05), (0.35, 0.0), (0.5, 0.0), (2.0, 0.0)]
    forest = grow(MultiHypothesisTracker(replace(EVERYTHING, new_rate=1e6)), Forest.seed(), 0, first)
    forest = forest._replace(hypotheses=(forest.hypotheses[0]._replace(log_p=0.0),))
    start = dict(zip(forest.tracks.ids.tolist(), zip(forest.tracks.means, forest.tracks.covariances)))
    assert len(start) == len(forest.hypotheses[0].tracks) == 4
    forest = grow(MultiHypothesisTracker(EVERYTHING), forest, 1, second)
    assert len(forest.hypotheses) == 2840  # sum over k matches of C(4,k)^2 k! 2^(8-2k)
    compare(forest, enumerate_all(EVERYTHING, [second], start=start))


def test_legs_of_people_have_probabilities_of_their_own():
    scans = [[(0.0, 0.0), (0.5, 0.0)], [(0.05, 0.0)], []]
    tracker, forest = MultiHypothesisTracker(EVERYTHING), Forest.seed()
    for step, scan in enumerate(scans):
        forest = grow(tracker, forest, step, scan, approved=lambda ids: ids == 101)
    compare(forest, enumerate_all(EVERYTHING, scans, approved=lambda name: name == 101))


def test_probabilities_sum_to_one_however_much_is_pruned():
    rng = np.random.default_rng(0)
    tracker, forest = MultiHypothesisTracker(MhtConfig(max_hypotheses=10)), Forest.seed()
    for step in range(40):
        forest = grow(tracker, forest, step, rng.uniform(-1, 1, size=(rng.integers(0, 6), 2)))
        assert np.exp([entry.log_p for entry in forest.hypotheses]).sum() == pytest.approx(1.0)
        assert 1 <= len(forest.hypotheses) <= 10
        used = {row for entry in forest.hypotheses for row in entry.tracks}
        assert used == set(range(len(forest.tracks.ids)))
    assert tracker.counts["hypotheses shed: too many"] > 0


def test_after_the_scan_back_all_hypotheses_share_one_ancestor():
    rng = np.random.default_rng(1)
    tracker, forest = MultiHypothesisTracker(MhtConfig(scan_back=3)), Forest.seed()
    for step in range(20):
        forest = grow(tracker, forest, step, rng.uniform(-1, 1, size=(4, 2)))
        if step > 3:
            assert len({entry.ancestors[0] for entry in forest.hypotheses}) == 1


def test_a_leg_keeps_its_identity_through_an_occlusion():
    tracker, forest = MultiHypothesisTracker(MhtConfig()), Forest.seed()
    for step in range(30):
        forest = grow(tracker, forest, step, [] if 15 <= step < 17 else [(0.05 * step, 0.0)])
    rows = list(forest.hypotheses[0].tracks)
    assert len(rows) == 1 and forest.tracks.born_ns[rows[0]] < 3 * 10**8


def test_empty_scans_leave_an_empty_forest():
    tracker, forest = MultiHypothesisTracker(MhtConfig()), Forest.seed()
    for step in range(5):
        forest = grow(tracker, forest, step, [])
    assert len(forest.hypotheses) == 1 and forest.hypotheses[0].log_p == 0.0 and len(LegTracks.empty().ids) == 0


def test_probabilities_that_do_not_sum_to_one_are_refused():
    with pytest.raises(ConfigError, match="p_detected"):
        MhtConfig(p_detected=0.5)
