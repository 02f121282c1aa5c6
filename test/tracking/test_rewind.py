"""What a tracker that can go back must not forget, repeat or reveal."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Announcement
from people_fusion.core.poses import Pose
from people_fusion.core.stamps import from_seconds
from people_fusion.core.transforms import TransformSource
from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.fusion import Fusion, load_config
from people_fusion.tracking.rewind import Rewind
from people_fusion.tracking.tracker import TRACKERS


class Standing(TransformSource):
    """A robot that stands at the world's origin."""

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        return Pose.from_xy_yaw(0.0, 0.0, 0.0)


def rewind(parts=None, **options):
    tracker = TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), parts or {}))
    return Rewind(tracker, parse(BUFFERS.config_of("reprocess", "buffer"), options))


def fusion(buffer, **tracker):
    parts = {"type": "kalman", **tracker}
    overrides = {"localisation": "none", "buffer": {"type": buffer}, "tracker": parts}
    return Fusion(load_config(None, overrides), Standing())


def all_occupied():
    """A map in which nobody can stand."""
    return OccupancyGrid("map", 0.1, Pose.from_xy_yaw(-5.0, -5.0, 0.0), np.full((100, 100), 100, dtype=np.int8))


def assert_same(tracks, others):
    for field in ("means", "covariances", "existence", "confirmed"):
        np.testing.assert_array_equal(getattr(tracks, field), getattr(others, field))


def test_a_slow_cue_does_not_shorten_the_horizon(detect):
    """The newest is the only one within the horizon, and what comes before it can still be put before it."""
    late, sorted_run = rewind(), rewind()
    entries = [detect(time_s, (0.1 * time_s, 0.0), sequence=step) for step, time_s in enumerate((0.0, 1.5, 3.0))]
    between = detect(2.5, (0.25, 0.0), cue="other")
    for entry in (*entries, between):
        assert late.process(entry)
    for entry in sorted((*entries, between), key=lambda entry: entry.order):
        sorted_run.process(entry)
    assert_same(late.tracker.tracks(), sorted_run.tracker.tracks())


def test_what_is_older_than_all_that_is_remembered_is_refused(detect):
    past = rewind()
    for step, time_s in enumerate((0.0, 1.5, 3.0)):
        past.process(detect(time_s, (0.0, 0.0), sequence=step))
    assert not past.process(detect(1.4, (0.0, 0.0), cue="other"))
    assert past.counters() == {"late measurements dropped: beyond the memory": 1}


@pytest.mark.parametrize("name", TRACKERS.names())
def test_any_order_of_arrival_gives_what_the_sorted_run_gives(name, detect):
    """Two people walk past each other, a lamp stands, a camera sees heads; all come up to half a second late."""
    rng = np.random.default_rng(4)
    entries = []
    for step in range(60):
        way = 0.1 * step
        places = np.array([(way, 0.0), (6.0 - way, 0.6), (2.0, 2.0)])[rng.random(3) < 0.9]
        entries.append(detect(way, *(places + rng.normal(0.0, 0.03, places.shape)), sequence=step))
        head = detect(way + 0.05, (way + 0.05, 0.0), cue="camera", std=0.2, sequence=step)
        none = np.zeros(0, dtype=int)
        entries.append(dataclasses.replace(head, modality="head", legs=np.zeros((0, 2)), leg_owners=none))
    past, sorted_run = (
        Rewind(
            TRACKERS.build(parse(TRACKERS.config_of(name, "tracker"), {})),
            parse(BUFFERS.config_of("reprocess", "buffer"), {"replays_per_s": 100_000}),
        )
        for _ in range(2)
    )
    for row in np.argsort(np.arange(120) * 0.05 + rng.uniform(0.0, 0.5, 120), kind="stable").tolist():
        assert past.process(entries[row])
        past.tracker.tracks()
    for entry in entries:
        sorted_run.process(entry)
    tracks, expected = past.tracker.tracks(), sorted_run.tracker.tracks()
    assert len(expected) >= 2
    for field in dataclasses.fields(tracks):
        if field.name != "ids":
            np.testing.assert_array_equal(getattr(tracks, field.name), getattr(expected, field.name))
    legs = past.tracker.legs()
    if legs is not None:
        np.testing.assert_array_equal(legs.positions, sorted_run.tracker.legs().positions)


def test_a_full_memory_costs_no_more_replays(detect):
    past = rewind(capacity=20)
    for step in range(40):
        past.process(detect(0.02 * step, (0.0, 0.0), sequence=step))
    tracker, calls = past.tracker, []
    process = tracker.process
    tracker.process = lambda entry: (calls.append(entry), process(entry))
    for step in range(5):
        past.process(detect(0.61 + 0.02 * step, (0.0, 0.0), cue="other", sequence=step))
    assert past.tracker is tracker
    assert len(calls) == 9 + 5


def test_what_is_processed_again_is_counted_once(detect):
    parts = {"prune_by_map": True}
    past, sorted_run = rewind(parts), rewind(parts)
    for each in (past, sorted_run):
        each.tracker.set_map(all_occupied())
    entries = [detect(0.1 * step, (0.0, 0.0), sequence=step) for step in range(10)]
    late = detect(0.35, (0.0, 0.0), cue="other")
    for entry in entries:
        past.process(entry)
    assert past.tracker.stamp_ns == from_seconds(0.9)
    past.process(late)
    for entry in sorted((*entries, late), key=lambda entry: entry.order):
        sorted_run.process(entry)
    assert past.tracker.stamp_ns == sorted_run.tracker.stamp_ns
    counts = past.counters()
    assert counts.pop("late measurements reprocessed") == 1
    assert counts == sorted_run.counters() == {"detections in occupied cells": 11}


def test_reset_between_a_late_measurement_and_its_replay_forgets_both(detect):
    past = rewind()
    for step in range(5):
        past.process(detect(0.1 * step, (0.0, 0.0), sequence=step))
    past.process(detect(0.25, (0.0, 0.0), cue="other"))
    past.reset()
    assert len(past.tracker.tracks()) == 0
    assert past.process(detect(0.05, (0.0, 0.0)))
    assert past.tracker.stamp_ns == from_seconds(0.05)


def waiting_fusion(detect, **tracker):
    """`revisable` with measurements that wait for an announced older one."""
    each = fusion("revisable", **tracker)
    for step in range(10):
        stamp_ns = from_seconds(100.0 + 0.1 * step)
        each.push(Announcement(stamp_ns, "scan", step), stamp_ns)
        for entry in each.push(framed(detect(100.0 + 0.1 * step, (0.1 * step, 0.0), sequence=step)), stamp_ns):
            each.process(entry)
    each.push(Announcement(from_seconds(100.95), "cam", 0), from_seconds(101.0))
    for step in (10, 11):
        now_ns = from_seconds(100.0 + 0.1 * step)
        entry = framed(detect(100.0 + 0.1 * step, (0.1 * step, 0.0), (3.0, 1.0), sequence=step))
        assert each.push(entry, now_ns) == []
    return each


def framed(measurement):
    return dataclasses.replace(measurement, frame_id="laser")


def test_a_preview_shows_what_waits(detect):
    each = waiting_fusion(detect)
    settled, preview = each.tracks(), each.preview()
    assert preview.stamp_ns == from_seconds(101.1)
    assert settled.stamp_ns == from_seconds(100.9)
    assert len(preview) == len(settled) + 1
    assert preview.means[0, 0] > settled.means[0, 0] + 0.1


def test_a_preview_leaves_no_trace(detect):
    looked, blind = (waiting_fusion(detect, prune_by_map=True) for _ in range(2))
    for each in (looked, blind):
        each.set_map(all_occupied())
    before = looked.tracks()
    for _ in range(3):
        looked.preview()
    assert_same(before, looked.tracks())
    assert looked.counters() == blind.counters()
    for each in (looked, blind):
        for entry in each.push(framed(detect(100.95, (0.95, 0.0), cue="cam")), from_seconds(101.15)):
            each.process(entry)
    assert_same(looked.tracks(), blind.tracks())
    np.testing.assert_array_equal(looked.tracks().ids, blind.tracks().ids)
    assert looked.counters() == blind.counters()


def test_a_person_keeps_the_identity_that_the_preview_gave(detect):
    each = waiting_fusion(detect)
    guessed = each.preview()
    for entry in each.poll(from_seconds(102.0)):
        each.process(entry)
    assert set(guessed.ids) == set(each.tracks().ids)


def test_a_preview_that_fails_leaves_no_trace(detect):
    each = waiting_fusion(detect)
    before, tracker = each.tracks(), each.tracker
    process = tracker.process
    tracker.process = lambda entry: (process(entry), 1 / 0)
    with pytest.raises(ZeroDivisionError):
        each.preview()
    assert_same(before, each.tracks())


def test_a_new_map_finds_the_tracker_up_to_date(detect):
    """What came before the map was processed without it."""
    each = fusion("reprocess", prune_by_map=True)
    for step in range(10):
        stamp_ns = from_seconds(100.0 + 0.1 * step)
        for entry in each.push(framed(detect(100.0 + 0.1 * step, (0.0, 0.0), sequence=step)), stamp_ns):
            each.process(entry)
    each.set_map(all_occupied())
    assert len(each.tracks()) == 1
    assert "detections in occupied cells" not in each.counters()
