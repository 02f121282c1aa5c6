"""Figures that the papers give for confidence."""

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.tracking.tracker import TRACKERS


def build(lifecycle):
    return TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), {"lifecycle": lifecycle, "gate": 11.345}))


def test_window_sums_reliability_over_rate(detect):
    """Eq. 3.7: three of a 10 Hz laser's observations are worth 3 * 0.1 / 10."""
    tracker = build({"type": "window", "confirm_above": 0.5})
    for step in range(3):
        tracker.process(detect(step * 0.1, (0.0, 0.0), sequence=step))
    assert tracker.tracks().existence[0] == pytest.approx(0.03)


def test_window_confidence_never_exceeds_the_reliability_of_a_lone_cue(detect):
    tracker = build({"type": "window", "confirm_above": 0.5})
    for step in range(50):
        tracker.process(detect(step * 0.1, (0.0, 0.0), sequence=step))
    assert tracker.tracks().existence[0] == pytest.approx(0.1)


def test_window_ends_a_track_after_a_second_unseen(detect):
    tracker = build({"type": "window", "confirm_above": 0.02, "lose_below": 0.0})
    for step in range(3):
        tracker.process(detect(step * 0.1, (0.0, 0.0), sequence=step))
    tracker.process(detect(1.1, sequence=4))
    assert tracker.tracks().confirmed.all() and len(tracker.tracks()) == 1
    tracker.process(detect(1.21, sequence=5))
    assert len(tracker.tracks()) == 0


@pytest.mark.parametrize("front, rear, confirmed", [(2, 0, False), (3, 0, True), (0, 1, False), (0, 2, True)])
def test_laser_alone_confirms_after_two_or_three_scans_as_in_the_thesis(detect, front, rear, confirmed):
    """7.5.4: two observations of the 5 Hz rear laser, three of the 12 Hz front one."""
    import dataclasses

    tracker = build({"type": "window", "confirm_above": 0.022, "lose_below": 0.0})
    for step in range(front):
        tracker.process(dataclasses.replace(detect(step / 12, (0.0, 0.0), sequence=step), period_s=1 / 12))
    for step in range(rear):
        tracker.process(dataclasses.replace(detect(step / 5, (0.0, 0.0), cue="rear", sequence=step), period_s=1 / 5))
    assert tracker.tracks().confirmed.tolist() == [confirmed]


def test_capped_confidence_follows_equation_3(detect):
    tracker = build({"type": "capped", "gains": {"legs": 0.2}, "caps": {"legs": 1.0}, "decay_per_s": 0.0})
    for step in range(3):
        tracker.process(detect(step * 0.1, (0.0, 0.0), sequence=step))
    assert tracker.tracks().existence[0] == pytest.approx(1 - 0.8**3)


def test_bayes_existence_equals_the_formula(detect):
    options = {"detection_probability": 0.8, "birth_existence": 0.3, "mean_stay_s": 1e9, "largest_ratio": 1e9}
    tracker = build({"type": "bayes", **options})
    tracker.process(detect(0.0, (0.0, 0.0)))
    assert tracker.tracks().existence[0] == pytest.approx(0.3)
    tracker.process(detect(0.1, sequence=1))
    assert tracker.tracks().existence[0] == pytest.approx(0.3 * 0.2 / (1 - 0.3 * 0.8))


def test_bayes_counts_what_rests_as_furniture(detect):
    tracker = build({"type": "bayes", "furniture_unmoved_after_s": 2.0})
    reported = []
    for step in range(60):
        tracker.process(detect(step * 0.1, (1.0, 0.0), (0.05 * step, 2.0), sequence=step))
        tracks = tracker.tracks()
        reported.append(sorted(np.round(tracks.means[tracks.confirmed, 1])))
    assert reported[15] == [0.0, 2.0]
    assert reported[-1] == [2.0]


def test_bayes_waits_longer_with_who_has_moved_before(detect):
    """Who walked in and stands is a person for longer than what stood there from the start."""
    tracker = build({"type": "bayes", "furniture_unmoved_after_s": 2.0, "furniture_after_s": 4.0})
    for step in range(50):
        tracker.process(detect(step * 0.1, (1.0, 0.0), (0.1 * min(step, 20), 2.0), sequence=step))
    tracks = tracker.tracks()
    assert np.round(tracks.means[tracks.confirmed, 1]).tolist() == [2.0]
