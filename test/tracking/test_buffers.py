"""One suite over all buffer policies, with the tracker whose past they keep."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.core.config import parse
from people_fusion.core.measurements import XY_OBSERVED, Announcement, Measurement
from people_fusion.core.stamps import from_seconds
from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.rewind import Rewind
from people_fusion.tracking.tracker import TRACKERS

NAMES = BUFFERS.names()
ORDERED = ("announced", "dynamic", "fixed_lag", "revisable")
REPROCESSING = ("announced", "dynamic", "fixed_lag", "reprocess", "revisable")
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
FOREVER_NS = 10**15


def policy(name, **options):
    return BUFFERS.build(parse(BUFFERS.config_of(name, "buffer"), options))


class Chain:
    """A policy and a tracker behind it, as Fusion joins them."""

    def __init__(self, name, parts=None, **options):
        self.buffer = policy(name, **options)
        tracker = TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), parts or {}))
        self.past = Rewind(tracker, self.buffer.config)

    def push(self, item, now_ns):
        return [self.past.process(entry) for entry in self.buffer.push(item, now_ns)]

    def finish(self):
        """Nothing more comes and time goes on."""
        for entry in self.buffer.poll(FOREVER_NS):
            self.past.process(entry)

    def state(self):
        tracks = self.past.tracker.tracks()
        order = np.lexsort((tracks.means[:, 1], tracks.means[:, 0]))
        return tracks.means[order], tracks.covariances[order], tracks.existence[order], tracks.confirmed[order]

    def counters(self):
        return {**self.buffer.counters(), **self.past.counters()}


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


def announcement_of(entry):
    return Announcement(entry.stamp_ns, entry.cue, entry.sequence)


@pytest.mark.parametrize("name", NAMES)
def test_measurements_in_order_pass_unchanged(name, detect):
    chain, reference = Chain(name), Chain("drop")
    for step in range(30):
        for each in (chain, reference):
            each.push(detect(step * 0.1, (step * 0.1, 0.0), sequence=step), now_ns=step * 10**8)
    for each in (chain, reference):
        each.finish()
    for ours, theirs in zip(chain.state(), reference.state()):
        np.testing.assert_array_equal(ours, theirs)
    assert sum(chain.counters().values()) == 0


@pytest.mark.parametrize("name", NAMES)
def test_what_is_lost_is_counted(name, detect):
    chain = Chain(name)
    chain.push(detect(100.0, (0.0, 0.0)), from_seconds(100.0))
    chain.push(detect(110.0, (0.0, 0.0)), from_seconds(110.0))
    late = detect(10.0, (0.0, 0.0))
    chain.push(announcement_of(late), from_seconds(110.4))
    assert not any(chain.push(late, from_seconds(110.5)))
    assert sum(times for event, times in chain.counters().items() if "dropped" in event) == 1


@pytest.mark.parametrize("name", NAMES)
def test_reset_forgets_the_order(name, detect):
    chain = Chain(name)
    chain.push(detect(100.0, (0.0, 0.0)), from_seconds(100.0))
    chain.finish()
    chain.buffer.reset()
    chain.past.reset()
    chain.push(detect(10.0, (0.0, 0.0)), from_seconds(10.0))
    chain.finish()
    assert chain.past.tracker.stamp_ns == from_seconds(10.0)


@pytest.mark.parametrize("name", NAMES)
def test_reset_counts_what_waited(name, detect):
    buffer = policy(name)
    count = len(buffer.push(detect(100.0, (0.0, 0.0)), from_seconds(100.0)))
    buffer.push(Announcement(from_seconds(99.95), "other", 1), from_seconds(100.0))
    count += len(buffer.push(detect(100.1, (0.0, 0.0)), from_seconds(100.1)))
    buffer.reset()
    assert count + buffer.counters().get("waited when time jumped", 0) == 2


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    order=st.permutations(range(8)),
    parts=st.sampled_from(ALL_PARTS),
    count=st.integers(2, 8),
    name=st.sampled_from(REPROCESSING),
    announce=st.booleans(),
)
def test_any_permutation_gives_the_sorted_run(seed, order, parts, count, name, announce):
    rng = np.random.default_rng(seed)
    cues = [measurement(0.0, [(0, 0), (2, 0)])]
    for index in range(count):
        people = [(0.1 * index, 0), (2, 0.1 * index)] + rng.normal(scale=0.05, size=(2, 2))
        people = np.vstack([people, rng.uniform(-4, 4, size=(rng.integers(0, 2), 2))])
        time_s = 0.1 * index + (0.1 if index % 2 == 0 and rng.random() < 0.5 else 0.0)  # some stamps are equal
        cues.append(measurement(time_s, people, cue=f"scan{index % 2}", sequence=index, shared=index % 3 == 0))
    arrivals_s = 1.0 + np.sort(rng.uniform(0.0, 0.5, count + 1))

    def run(measurements, which):
        chain = Chain(which, parts, horizon_s=2.0)
        if announce:
            for entry in measurements:
                chain.push(announcement_of(entry), from_seconds(1.0))
        for entry, arrival_s in zip(measurements, arrivals_s):
            chain.push(entry, from_seconds(arrival_s))
        chain.finish()
        return chain.state()

    shuffled = [cues[0], *(cues[1 + index] for index in order if index < count)]
    for ours, theirs in zip(run(shuffled, name), run(sorted(cues, key=lambda entry: entry.order), "drop")):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_identities_survive_reprocessing(detect):
    chain = Chain("reprocess")
    for step in range(10):
        chain.push(detect(step * 0.1, (0.1 * step, 0.0), sequence=step), from_seconds(1.0))
    before = chain.past.tracker.tracks().ids
    chain.push(detect(0.55, (0.55, 0.0), cue="other"), from_seconds(1.0))
    np.testing.assert_array_equal(chain.past.tracker.tracks().ids, before)


def test_a_late_measurement_changes_the_association_after_it(detect):
    """Without the late one the second person takes over the first one's track."""
    chain, sorted_run = Chain("reprocess"), Chain("reprocess")
    steps = [detect(0.1 * step, (0.0, 0.0), sequence=step) for step in range(5)]
    late = detect(0.45, (0.0, 0.0), (0.35, 0.0), cue="other")
    after = detect(0.5, (0.35, 0.0), sequence=5)
    for entry in (*steps, after, late):
        chain.push(entry, from_seconds(1.0))
    for entry in (*steps, late, after):
        sorted_run.push(entry, from_seconds(1.0))
    np.testing.assert_array_equal(chain.past.tracker.tracks().ids, sorted_run.past.tracker.tracks().ids)
    for ours, theirs in zip(chain.state(), sorted_run.state()):
        np.testing.assert_allclose(ours, theirs, atol=1e-9)


def test_several_late_measurements_in_a_row_cost_one_replay(detect):
    chain = Chain("reprocess")
    for step in range(20):
        chain.push(detect(0.02 * step, (0.0, 0.0), sequence=step), from_seconds(1.0))
    tracker, calls = chain.past.tracker, []
    process = tracker.process
    tracker.process = lambda entry: (calls.append(entry), process(entry))
    for step in range(5):
        chain.push(detect(0.21 + 0.02 * step, (0.0, 0.0), cue="other", sequence=step), from_seconds(1.0))
    assert chain.past.tracker is tracker
    assert len(calls) == 9 + 5


def test_reprocessing_has_a_budget_and_says_what_it_sheds(detect):
    chain = Chain("reprocess", replays_per_s=10)
    for step in range(20):
        chain.push(detect(0.02 * step, (0.0, 0.0), sequence=step), from_seconds(1.0))
    assert len(chain.past.tracker.tracks()) == 1
    assert chain.push(detect(0.31, (0.0, 0.0), cue="other"), from_seconds(1.0)) == [True]
    assert chain.push(detect(0.01, (0.0, 0.0), cue="third"), from_seconds(1.0)) == [False]
    assert chain.counters()["late measurements shed: reprocessing is over its budget"] == 1


def test_reprocessing_keeps_bounded_memory(detect):
    chain = Chain("reprocess", horizon_s=1.0, capacity=8)
    for step in range(500):
        chain.push(detect(step * 0.01, (0.0, 0.0), sequence=step), from_seconds(5.0))
    assert len(chain.past._history) <= 8
    assert not any(chain.push(detect(4.5, (0.0, 0.0), cue="other"), from_seconds(5.0)))
    assert chain.counters()["late measurements dropped: beyond the memory"] == 1
