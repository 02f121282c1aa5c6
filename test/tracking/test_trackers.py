"""The contract of all trackers, and consistency of the Kalman tracker."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

from people_fusion.core.config import parse
from people_fusion.core.measurements import Sight
from people_fusion.filtering.motion_models.near_constant_velocity import NearConstantVelocityConfig
from people_fusion.tracking.lifecycle import LIFECYCLES
from people_fusion.tracking.tracker import TRACKERS
from people_fusion.tracking.trackers.kalman import KalmanConfig, KalmanTracker

NAMES = TRACKERS.names()


def build(name, **overrides):
    return TRACKERS.build(parse(TRACKERS.config_of(name, "tracker"), overrides))


@pytest.fixture(params=NAMES)
def tracker(request):
    return build(request.param)


def walk(tracker, detect, seconds=3.0, speed=1.0):
    for step in range(int(seconds * 10)):
        tracker.process(detect(step * 0.1, (speed * step * 0.1, 1.0), sequence=step))


def test_a_walking_person_becomes_one_confirmed_track(tracker, detect):
    walk(tracker, detect)
    tracks = tracker.tracks()
    assert len(tracks) == 1
    assert tracks.confirmed.all() and tracks.matched.all()
    np.testing.assert_allclose(tracks.means[0, :2], [2.9, 1.0], atol=0.1)
    np.testing.assert_allclose(tracks.means[0, 3:5], [1.0, 0.0], atol=0.2)


def test_looking_ahead_changes_nothing(tracker, detect):
    walk(tracker, detect)
    now = tracker.tracks()
    ahead = tracker.tracks(now.stamp_ns + 10**9)
    assert ahead.means[0, 0] > now.means[0, 0] + 0.3
    assert ahead.covariances[0, 0, 0] > now.covariances[0, 0, 0]
    np.testing.assert_array_equal(tracker.tracks().means, now.means)


def test_restoring_a_snapshot_undoes_everything(tracker, detect):
    walk(tracker, detect)
    before, snapshot = tracker.tracks(), tracker.snapshot()
    tracker.process(detect(3.0, (9.0, 9.0), (3.0, 1.0)))
    tracker.process(detect(3.5))
    tracker.restore(snapshot)
    after = tracker.tracks()
    for field in dataclasses.fields(before):
        np.testing.assert_array_equal(getattr(before, field.name), getattr(after, field.name))


def test_identities_are_not_reused_after_a_reset(tracker, detect):
    walk(tracker, detect)
    used = set(tracker.tracks().ids)
    tracker.reset()
    assert len(tracker.tracks()) == 0 and tracker.stamp_ns is None
    walk(tracker, detect)
    assert not used & set(tracker.tracks().ids)


def test_seeing_nobody_ends_tracks(tracker, detect):
    walk(tracker, detect)
    for step in range(200):
        tracker.process(detect(3.0 + step * 0.1, sequence=100 + step))
    assert len(tracker.tracks()) == 0


def test_covariances_stay_symmetric_and_positive(tracker, detect):
    rng = np.random.default_rng(0)
    for step in range(100):
        tracker.process(detect(step * 0.1, *rng.uniform(-3, 3, size=(rng.integers(0, 5), 2)), sequence=step))
        covariances = tracker.tracks().covariances
        np.testing.assert_allclose(covariances, covariances.swapaxes(1, 2), atol=1e-12)
        assert not len(covariances) or np.linalg.eigvalsh(covariances).min() > -1e-9


@pytest.mark.parametrize("lifecycle", LIFECYCLES.names())
def test_every_lifecycle_confirms_who_stays_and_ends_who_left(lifecycle, detect):
    tracker = build("kalman", lifecycle={"type": lifecycle}, gate=11.345)
    if lifecycle == "window":
        tracker = build("kalman", lifecycle={"type": lifecycle, "confirm_above": 0.02, "lose_below": 0.0})
    if lifecycle == "capped":
        tracker = build("kalman", lifecycle={"type": lifecycle, "caps": {"legs": 0.8}})
    walk(tracker, detect)
    assert tracker.tracks().confirmed.tolist() == [True]
    for step in range(300):
        tracker.process(detect(3.0 + step * 0.1, sequence=100 + step))
    assert len(tracker.tracks()) == 0


def test_existence_outlasts_an_occlusion_but_not_a_clear_view(detect):
    def after_gap(ranges):
        tracker = build("kalman", lifecycle={"type": "bayes"})
        walk(tracker, detect, speed=0.5)
        sight = Sight(np.zeros(2), 0.0, -np.pi, 2 * np.pi / 360, np.full(360, ranges), 30.0)
        for step in range(10):
            tracker.process(detect(3.0 + step * 0.1, sequence=100 + step, sight=sight))
        return tracker.tracks()

    hidden, absent = after_gap(0.3), after_gap(25.0)
    assert hidden.confirmed.all() and len(hidden) == 1 and hidden.occluded.all()
    assert not absent.confirmed.any()


def test_capped_confidence_needs_two_cues(detect):
    lifecycle = {"type": "capped", "caps": {"legs": 0.5, "face": 0.5}, "gains": {"legs": 0.3, "face": 0.3}}
    tracker = build("kalman", lifecycle=lifecycle)
    walk(tracker, detect)
    assert not tracker.tracks().confirmed.any()
    for step in range(3):
        face = detect(3.0 + step * 0.1, (3.0 + step * 0.1, 1.0), cue="camera", sequence=step)
        tracker.process(dataclasses.replace(face, modality="face"))
    assert tracker.tracks().confirmed.all()


def test_track_with_two_detections_takes_both_only_when_sequential(detect):
    for sequential, expected in ((True, 1), (False, 2)):
        tracker = build("kalman", sequential=sequential)
        walk(tracker, detect)
        tracker.process(detect(3.0, (3.0, 1.0), (3.02, 1.02), sequence=50))
        assert len(tracker.tracks()) == expected


def test_shared_error_is_not_averaged_away(detect):
    """Twenty measurements with one common error: the position is no better known than that error."""
    bias = np.zeros((6, 6))
    bias[0, 0] = bias[1, 1] = 0.1**2
    jacobian = np.zeros((1, 3, 6))
    jacobian[0, :, :3] = np.eye(3)
    stds = {}
    for treatment in ("add", "consider"):
        tracker = build("kalman", shared_error=treatment, shared_error_time_s=1e6)
        for step in range(20):
            tracker.process(
                detect(step * 0.1, (1.0, 1.0), sequence=step, shared_jacobians=jacobian, shared_covariance=bias)
            )
        stds[treatment] = np.sqrt(tracker.tracks().covariances[0, 0, 0])
    assert 0.1 <= stds["add"] < 0.12
    assert 0.1 <= stds["consider"] < 0.12


@pytest.mark.parametrize("late", [False, True])
def test_matched_model_is_consistent_over_100_runs(detect, late):
    """Average NEES of the matched model inside the 95 % chi-square band; late ones predicted forward included."""
    config = KalmanConfig(gate=1e9, motion=NearConstantVelocityConfig(velocity_variance_rate=0.5))
    errors = []
    for run in range(100):
        rng = np.random.default_rng(run)
        tracker = KalmanTracker(config)
        transition, noise = tracker._motion.transition(0.05)
        state = rng.multivariate_normal(np.zeros(5), tracker._motion.initial_covariance)
        truth = []
        for _ in range(80):
            truth.append(state)
            state = transition @ state + rng.multivariate_normal(np.zeros(5), noise)
        order = list(range(0, 80, 2))
        if late:  # each fourth measurement comes after the next one
            for place in range(4, 40, 4):
                order[place - 1], order[place] = order[place], order[place - 1]
        for step in order:
            tracker.process(detect(step * 0.05, rng.normal(truth[step][:2], 0.05), sequence=step))
        tracks = tracker.tracks()
        axes = [0, 1, 3, 4]
        error = tracks.means[0, axes] - truth[order[-1]][axes]
        errors.append(error @ np.linalg.solve(tracks.covariances[0][np.ix_(axes, axes)], error))
    low, high = chi2.ppf([0.025, 0.975], 4 * 100) / 100
    assert low < np.mean(errors) < high
