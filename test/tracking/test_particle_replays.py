"""Particles are the same to the last bit however late their measurements come, and in every round of a loop."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from score_images import image, with_features

from people_fusion.core.config import parse
from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.rewind import Rewind
from people_fusion.tracking.tracker import TRACKERS

pytest.importorskip("people_fusion.cues.heads.appearance")

OPTIONS = {
    "models": {"head": {"type": "heads", "adaptive": True, "own_threshold": -3.0}, "legs": {"type": "legs"}},
    "walking": {"stop_rate": 0.2},
    "lifecycle": {"type": "second_look", "doubt_after_s": 3.0},
}


def build():
    return TRACKERS.build(parse(TRACKERS.config_of("particle", "tracker"), OPTIONS))


def rewind():
    return Rewind(build(), parse(BUFFERS.config_of("reprocess", "buffer"), {"replays_per_s": 100_000}))


@pytest.fixture(scope="module")
def entries(detect):
    """Two people pass each other, seen by a camera that can score and learn and by a laser."""
    rng, found = np.random.default_rng(4), []
    for step in range(30):
        heads = [[1.8 - 0.03 * step, 0.5, 1.7], [1.2 + 0.02 * step, -0.4 + 0.01 * step, 1.6]]
        seen = np.flatnonzero(rng.random(2) < 0.6)
        scored = image(0.1 * step, heads, found=seen, sequence=step, pose_covariance=1e-4 * np.eye(6))
        found.append(with_features(scored, seed=step))
        found.append(detect(0.1 * step + 0.05, *np.array(heads)[:, :2], sequence=step))
    return found


def state_of(tracker):
    """All that a tracker of particles knows but the names of its tracks, which are never used again."""
    state = tracker.snapshot()
    arrays = {name: value for name, value in vars(state.table).items() if name != "ids"}
    arrays.update({"states": state.states, "weights": state.weights, "walks": state.walks, **state.memories})
    return {name: array.tobytes() for name, array in arrays.items()}, state.generator


def test_any_order_of_arrival_gives_the_bytes_of_the_sorted_run(entries):
    late, sorted_run = rewind(), rewind()
    delays = np.random.default_rng(1).uniform(0.0, 0.5, len(entries))
    order = np.argsort(np.array([entry.stamp_ns for entry in entries]) + 1e9 * delays, kind="stable")
    assert (np.diff(order) < 0).sum() > 10
    for row in order.tolist():
        assert late.process(entries[row])
        late.tracker.tracks()
    for entry in sorted(entries, key=lambda entry: entry.order):
        sorted_run.process(entry)
    assert len(sorted_run.tracker.tracks()) >= 2
    assert any(memory.any() for memory in sorted_run.tracker.snapshot().memories.values())
    assert state_of(late.tracker) == state_of(sorted_run.tracker)


def test_every_round_of_a_loop_gives_the_same_bytes(entries):
    tracker, rounds = build(), []
    for _ in range(2):
        for entry in entries:
            tracker.process(entry)
        rounds.append(state_of(tracker))
        tracker.reset()
    assert rounds[0] == rounds[1]


def test_what_a_tracker_did_before_a_snapshot_was_restored_leaves_no_trace(entries):
    """Not even in the random generator."""
    wandering, straight = build(), build()
    for entry in entries[:20]:
        straight.process(entry)
        wandering.process(entry)
    kept = wandering.snapshot()
    for entry in entries[20:30]:
        wandering.process(dataclasses.replace(entry, positions=entry.positions + 0.3))
    wandering.restore(kept)
    for entry in entries[20:]:
        straight.process(entry)
        wandering.process(entry)
    assert state_of(wandering) == state_of(straight)
