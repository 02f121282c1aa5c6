"""What the confidence of detections does to resting tracks, and what slow errors do to the output."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.tracking.tracker import TRACKERS

BAYES = {"type": "bayes", "confirm_above": 0.6, "furniture_unmoved_after_s": 1e9, "furniture_after_s": 1e9}


def build(**options):
    return TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), {"lifecycle": BAYES, **options}))


def reported(tracker, detect, places, confidences):
    """(N,) whether the one track is confirmed after each detection, at 10 Hz."""
    shown = []
    for step, (place, confidence) in enumerate(zip(places, confidences)):
        measurement = detect(step * 0.1, place, sequence=step)
        tracker.process(dataclasses.replace(measurement, confidences=np.array([confidence])))
        shown.append(bool(tracker.tracks().confirmed.any()))
    return shown


def test_doubt_about_what_rests_does_not_average_out(detect):
    places = [(1.0, 0.0)] * 100
    assert reported(build(), detect, places, [0.7] * 100)[-1]
    assert not any(reported(build(), detect, places, [0.4] * 100))


def test_doubted_thing_that_walks_is_a_person(detect):
    walk = [(0.06 * step, 0.0) for step in range(60)]
    shown = reported(build(), detect, walk, [0.4] * 60)
    assert shown[-1] and not any(shown[:7])
    assert not any(reported(build(), detect, walk, [0.1] * 60))


def test_doubt_ends_who_rests_and_spares_who_walked_a_moment_ago(detect):
    still = [(1.0, 0.0)] * 60
    shown = reported(build(), detect, still, [0.9] * 10 + [0.2] * 50)
    assert shown[9] and not shown[-1]
    walk = [(0.06 * min(step, 20), 0.0) for step in range(100)]
    shown = reported(build(), detect, walk, [0.9] * 20 + [0.2] * 80)
    assert shown[59] and not shown[-1]


def spread(tracker):
    return tracker.tracks().covariances[0, :2, :2]


def test_slow_offset_is_added_to_the_output_and_not_averaged_away(detect):
    plain, offset = build(), build(offset_stds={"legs": 0.3})
    for step in range(50):
        for tracker in (plain, offset):
            tracker.process(detect(step * 0.1, (1.0, 0.0), sequence=step))
        assert spread(offset) - spread(plain) == pytest.approx(0.09 * np.eye(2))
    other = build(offset_stds={"face": 0.3})
    other.process(detect(0.0, (1.0, 0.0)))
    assert spread(other) == pytest.approx(0.05**2 * np.eye(2))


def test_gait_makes_a_walker_uncertain_along_the_way_alone(detect):
    plain, gait = build(), build(gait_s=0.1)
    for step in range(30):
        for tracker in (plain, gait):
            tracker.process(detect(step * 0.1, (0.1 * step, 0.0), sequence=step))
    speed = gait.tracks().means[0, 3]
    assert speed > 0.8
    assert spread(gait) - spread(plain) == pytest.approx(np.diag([(0.1 * speed) ** 2, 0.0]), abs=1e-4)
