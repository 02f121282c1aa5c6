"""Measurements that a cue should not have made, and some that it may: the tracks survive all of them."""

from __future__ import annotations

import dataclasses
import warnings

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.tracking.fusion import load_config
from people_fusion.tracking.tracker import TRACKERS

PRESETS = ("default", "poschmann_t1", "volkhardt", "kalman_over_legs")


PARTICLES = {"gaussians of particles": {}, "legs of particles": {"legs": {"type": "legs", "starts": True}}}


@pytest.fixture(params=[*PRESETS, *PARTICLES])
def tracker(request):
    if request.param in PARTICLES:
        return TRACKERS.build(parse(TRACKERS.config_of("particle", "tracker"), {"models": PARTICLES[request.param]}))
    return TRACKERS.build(load_config(request.param).tracker)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e300])
def test_detection_at_no_place_is_left_out_and_the_others_count(tracker, detect, wrong):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for step in range(20):
            measurement = detect(step * 0.1, (wrong, 0.0), (0.05 * step, 1.0), sequence=step)
            tracker.process(measurement)
    tracks = tracker.tracks()
    assert np.isfinite(tracks.means).all() and np.isfinite(tracks.covariances).all()
    assert len(tracks) == 1 and tracks.matched.all() and tracks.means[0, 1] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("variance", [np.nan, np.inf, -1.0])
def test_detection_without_a_covariance_is_left_out_and_counted(tracker, detect, variance):
    for step in range(20):
        measurement = detect(step * 0.1, (4.0, 4.0), (0.05 * step, 1.0), sequence=step)
        covariances = measurement.covariances.copy()
        covariances[0, 0, 0] = variance
        tracker.process(dataclasses.replace(measurement, covariances=covariances))
    tracks = tracker.tracks()
    assert np.isfinite(tracks.covariances).all() and len(tracks) == 1
    assert tracker.counters()["detections without place or covariance"] == 20


def test_detections_that_claim_to_be_exact_are_tracked(tracker, detect):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for step in range(20):
            for cue in ("front", "rear"):  # at one stamp
                tracker.process(detect(step * 0.1, (0.05 * step, 1.0), std=0.0, cue=cue, sequence=step))
    tracks = tracker.tracks()
    assert len(tracks) == 1 and tracks.matched.all()
    assert tracks.means[0, :2] == pytest.approx([0.95, 1.0], abs=2e-3)
    assert np.linalg.eigvalsh(tracks.covariances).min() >= -1e-12


def test_detections_that_claim_to_be_exact_in_one_direction_are_tracked(tracker, detect):
    """Along a ray that is slanted, so that no variance is zero."""
    for step in range(20):
        measurement = detect(step * 0.1, (0.05 * step, 1.0), sequence=step)
        covariances = measurement.covariances.copy()
        covariances[:, :2, :2] = 0.05**2
        tracker.process(dataclasses.replace(measurement, covariances=covariances))
    tracks = tracker.tracks()
    assert len(tracks) == 1 and tracks.matched.all()
    assert np.isfinite(tracks.means).all() and np.isfinite(tracks.covariances).all()


@pytest.mark.parametrize("models", PARTICLES.values(), ids=PARTICLES)
def test_people_without_legs_are_one_track_each(models, detect):
    """A cue that does not tell what it saw of them, and finds them all the same."""
    tracker = TRACKERS.build(parse(TRACKERS.config_of("particle", "tracker"), {"models": models}))
    for step in range(20):
        measurement = detect(step * 0.1, (0.05 * step, 1.0), (0.05 * step, -1.0), sequence=step)
        none = np.zeros(0, dtype=int)
        tracker.process(dataclasses.replace(measurement, legs=np.zeros((0, 2)), leg_owners=none))
    assert len(tracker.tracks()) == 2


def test_exact_duplicates_are_fused(detect):
    tracker = TRACKERS.build(load_config("volkhardt").tracker)
    tracker.process(detect(0.0, (1.0, 1.0), (1.0, 1.0), (2.0, 1.0), std=0.0))
    assert sorted(tracker.tracks().means[:, 0]) == pytest.approx([1.0, 2.0])


def test_nothing_seen_for_a_year_is_no_trouble(tracker, detect):
    for step in range(20):
        tracker.process(detect(step * 0.1, (0.05 * step, 1.0), sequence=step))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tracker.process(detect(365 * 24 * 3600.0, sequence=99))
    assert len(tracker.tracks()) == 0
    for step in range(20):
        tracker.process(detect(365 * 24 * 3600.0 + 1.0 + step * 0.1, (0.05 * step, 1.0), sequence=100 + step))
    assert len(tracker.tracks()) == 1


def test_a_thousand_detections_at_once_are_a_thousand_tracks(detect):
    tracker = TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), {}))
    crowd = np.stack(np.meshgrid(np.arange(40.0), np.arange(25.0)), axis=-1).reshape(-1, 2)
    for step in range(3):
        tracker.process(detect(step * 0.1, *crowd, sequence=step))
    assert len(tracker.tracks()) == 1000 and tracker.tracks().matched.all()


def test_measurements_that_call_themselves_the_same_begin_tracks_of_their_own(tracker, detect):
    """A cue that numbers nothing and stamps two messages alike."""
    for place in ((0.0, 0.0), (5.0, 0.0), (0.0, 5.0)):
        tracker.process(detect(1.0, place))
    assert len(set(tracker.tracks().ids.tolist())) == 3


def test_reprocessing_gives_such_measurements_their_identities_again(tracker, detect):
    before = tracker.snapshot()
    tracks = []
    for _ in range(2):
        tracker.restore(before)
        for place in ((0.0, 0.0), (5.0, 0.0), (0.0, 5.0)):
            tracker.process(detect(1.0, place))
        tracks.append(tracker.tracks().ids.tolist())
    assert tracks[0] == tracks[1]


@pytest.mark.parametrize("height_std", [0.3, 1.0, 1000.0])
def test_height_that_is_hardly_known_does_not_speak_against_a_person(detect, height_std):
    """A detection with a height of no use is worth as much as one without."""
    lifecycle = {"type": "bayes", "end_below": 0.0}
    given, none = (TRACKERS.build(parse(TRACKERS.config_of("kalman", "t"), {"lifecycle": lifecycle})) for _ in range(2))
    for step in range(10):
        measurement = detect(0.1 * step, (0.05 * step, 0.0), std=0.2, sequence=step)
        none.process(measurement)
        covariances = measurement.covariances + np.diag([0.0, 0.0, height_std**2])
        given.process(dataclasses.replace(measurement, covariances=covariances, observed=(True, True, True)))
    assert len(given.tracks()) == 1
    assert given.tracks().existence == pytest.approx(none.tracks().existence, abs=1e-9)
