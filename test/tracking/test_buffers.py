"""One suite over all buffer policies; reprocessing any order equals the sorted run."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.core.config import parse
from people_fusion.core.measurements import XY_OBSERVED, Measurement
from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.tracker import TRACKERS

NAMES = BUFFERS.names()
ALL_PARTS = [
    {},
    {
        "motion": {"type": "constant_velocity_3d"},
        "lifecycle": {"type": "capped"},
        "sequential": True,
        "merge_distance": 0.3,
    },
    {"assignment": {"type": "greedy"}, "lifecycle": {"type": "window"}, "shared_error": "consider"},
]


def build(name, tracker=None, **options):
    tracker = tracker or TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), {}))
    return BUFFERS.build(parse(BUFFERS.config_of(name, "buffer"), options), tracker=tracker)


def measurement(time_s, positions, cue="scan", sequence=0, shared=False):
    positions = np.array(positions, dtype=float).reshape(-1, 2)
    covariances = np.zeros((len(positions), 3, 3))
    covariances[:, 0, 0] = covariances[:, 1, 1] = 0.05**2
    jacobians = np.tile(np.hstack([np.eye(3), np.zeros((3, 3))]), (len(positions), 1, 1))
    return Measurement(
        stamp_ns=round(time_s * 1e9),
        cue=cue,
        modality="legs",
        frame_id="odom",
        positions=np.column_stack([positions, np.zeros(len(positions))]),
        covariances=covariances,
        confidences=np.full(len(positions), 0.7),
        observed=XY_OBSERVED,
        sequence=sequence,
        shared_jacobians=jacobians if shared else None,
        shared_covariance=np.diag([0.01, 0.01, 0, 0, 0, 1e-4]) if shared else None,
    )


def state_of(tracker):
    tracks = tracker.tracks()
    order = np.lexsort((tracks.means[:, 1], tracks.means[:, 0]))
    return tracks.means[order], tracks.covariances[order], tracks.existence[order], tracks.confirmed[order]


@pytest.mark.parametrize("name", NAMES)
def test_measurements_in_order_pass_unchanged(name, detect):
    buffer, reference = build(name), build("drop")
    for step in range(30):
        for policy in (buffer, reference):
            assert policy.push(detect(step * 0.1, (step * 0.1, 0.0), sequence=step), now_ns=step * 10**8)
    for ours, theirs in zip(state_of(buffer.tracker), state_of(reference.tracker)):
        np.testing.assert_array_equal(ours, theirs)
    assert sum(buffer.counters().values()) == 0


@pytest.mark.parametrize("name", NAMES)
def test_what_is_lost_is_counted(name, detect):
    buffer = build(name)
    buffer.push(detect(100.0, (0.0, 0.0)), 0)
    assert not buffer.push(detect(10.0, (0.0, 0.0)), 0)
    assert sum(buffer.counters().values()) == 1


@pytest.mark.parametrize("name", NAMES)
def test_reset_forgets_the_order(name, detect):
    buffer = build(name)
    buffer.push(detect(100.0, (0.0, 0.0)), 0)
    buffer.reset()
    buffer.tracker.reset()
    assert buffer.push(detect(10.0, (0.0, 0.0)), 0)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    order=st.permutations(range(8)),
    parts=st.sampled_from(ALL_PARTS),
    count=st.integers(2, 8),
)
def test_reprocessing_any_permutation_equals_the_sorted_run(seed, order, parts, count):
    rng = np.random.default_rng(seed)
    cues = [measurement(0.0, [(0, 0), (2, 0)])]
    for index in range(count):
        people = [(0.1 * index, 0), (2, 0.1 * index)] + rng.normal(scale=0.05, size=(2, 2))
        people = np.vstack([people, rng.uniform(-4, 4, size=(rng.integers(0, 2), 2))])
        time_s = 0.1 * (index + rng.integers(0, 2))  # some stamps are equal
        cues.append(measurement(time_s, people, cue=f"scan{index % 2}", sequence=index, shared=index % 3 == 0))

    def run(measurements):
        tracker = TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), parts))
        buffer = build("reprocess", tracker, horizon_s=2.0)
        for entry in measurements:
            buffer.push(entry, 0)
        return state_of(tracker)

    shuffled = [cues[0], *(cues[1 + index] for index in order if index < count)]
    for ours, theirs in zip(run(shuffled), run(sorted(cues, key=lambda entry: entry.order))):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_identities_survive_reprocessing(detect):
    buffer = build("reprocess")
    for step in range(10):
        buffer.push(detect(step * 0.1, (0.1 * step, 0.0), sequence=step), 0)
    before = buffer.tracker.tracks().ids
    buffer.push(detect(0.55, (0.55, 0.0), cue="other"), 0)
    np.testing.assert_array_equal(buffer.tracker.tracks().ids, before)


def test_reprocessing_keeps_bounded_memory(detect):
    buffer = build("reprocess", horizon_s=1.0, capacity=8)
    for step in range(500):
        buffer.push(detect(step * 0.01, (0.0, 0.0), sequence=step), 0)
    assert len(buffer._history) <= 9
