"""Particles that are weighed by an image's scores (Poschmann 2018, 7.2.3)."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from score_images import image, with_features

from people_fusion.core.config import parse
from people_fusion.core.head_scores import FEATURES, NO_SCORES, SCORES
from people_fusion.tracking.tracker import TRACKERS


def build(**options):
    return TRACKERS.build(parse(TRACKERS.config_of("particle", "tracker"), options))


def heads_tracker(**options):
    return build(models={"head": {"type": "heads", **options}})


def walked(step, y=0.5):
    return [1.8 - 0.03 * step, y, 1.7]


def test_tracker_asks_for_what_its_models_need():
    assert build().scores == NO_SCORES
    assert heads_tracker().scores == SCORES


def test_head_that_no_detector_reports_any_more_is_followed():
    tracker = heads_tracker()
    for step in range(20):
        tracker.process(image(0.1 * step, [walked(step)], found=[0] if step < 5 else [], sequence=step))
    tracks = tracker.tracks()
    assert tracks.confirmed.tolist() == [True] and tracks.matched.tolist() == [True]
    np.testing.assert_allclose(tracks.means[0, :3], walked(19), atol=0.25)
    across = abs(tracks.means[0, 1] - 0.5)
    assert across < 0.06


def test_without_its_head_in_the_image_a_track_ends_after_a_second():
    tracker = heads_tracker()
    for step in range(5):
        tracker.process(image(0.1 * step, [walked(step)], sequence=step))
    for step in range(5, 20):
        tracker.process(image(0.1 * step, [], sequence=step))
        if step == 10:
            assert len(tracker.tracks()) == 1
    assert len(tracker.tracks()) == 0


def test_one_detection_is_no_person_yet():
    tracker = heads_tracker()
    tracker.process(image(0.0, [walked(0)]))
    assert tracker.tracks().confirmed.tolist() == [False]
    tracker.process(image(0.1, [walked(1)], sequence=1))
    assert tracker.tracks().confirmed.tolist() == [True]


def test_distance_follows_the_size_of_the_head():
    """A head that comes nearer without being detected: only the layer that it scores in tells how far it is."""
    tracker = heads_tracker()
    for step in range(30):
        found = [0] if step < 3 else []
        tracker.process(image(0.1 * step, [[1.9 - 0.03 * step, 0.0, 1.6]], found=found, sequence=step))
    assert abs(tracker.tracks().means[0, 0] - 1.03) < 0.2


def test_image_without_scores_is_taken_as_gaussians():
    tracker = heads_tracker()
    for step in range(5):
        tracker.process(dataclasses.replace(image(0.1 * step, [walked(step)], sequence=step), scores=None))
    tracks = tracker.tracks()
    assert tracks.confirmed.all() and len(tracks) == 1
    np.testing.assert_allclose(tracks.means[0, :3], walked(4), atol=0.15)


def test_uncertain_pose_of_the_camera_widens_the_track():
    stds = {}
    for turned in (0.0, 0.05):
        tracker = heads_tracker()
        covariance = np.diag([0.0] * 5 + [turned**2])
        for step in range(10):
            tracker.process(image(0.1 * step, [[1.8, 0.0, 1.7]], sequence=step, pose_covariance=covariance))
        stds[turned] = np.sqrt(tracker.tracks().covariances[0, 1, 1])
    assert stds[0.05] > 1.3 * stds[0.0]


def test_same_seed_gives_the_same_bytes_and_another_does_not():
    def run(seed):
        tracker = build(models={"head": {"type": "heads"}}, seed=seed)
        for step in range(10):
            tracker.process(image(0.1 * step, [walked(step), walked(step, -1.0)], sequence=step))
        return tracker.tracks().means.tobytes()

    assert run(1) == run(1)
    assert run(1) != run(2)


@pytest.mark.parametrize("proximity", [0.0, 0.6])
def test_proximity_keeps_a_hidden_person_from_the_one_in_front(proximity):
    """One stops in front of another: without the model both tracks gather at the one head that is seen."""
    tracker = build(
        models={"head": {"type": "heads"}},
        proximity={"distance_max": proximity},
        lifecycle={"type": "second_look", "longest_unseen_s": 3.0},
    )
    nearest = 9.0
    for step in range(50):
        still, passer = [1.9, 0.0, 1.7], [1.6, max(1.2 - 0.04 * step, 0.0), 1.7]
        heads = [passer] if abs(passer[1]) < 0.25 else [passer, still]
        tracker.process(image(0.1 * step, heads, sequence=step))
        places = tracker.tracks().means[:, :2]
        apart = np.hypot(*(places[:, None] - places[None]).transpose(2, 0, 1))
        nearest = min(nearest, apart[~np.eye(len(places), dtype=bool)].min(initial=9.0))
    assert (nearest > 0.2) == (proximity > 0.0), nearest


def test_detected_heads_are_as_near_as_their_detector_says():
    """The smallest heads that are looked for score alike at all greater distances; the detector knows their size."""
    error = {}
    for detections in (False, True):
        tracker = heads_tracker(detections=detections)
        for step in range(40):
            tracker.process(image(0.1 * step, [[2.5, 0.3, 1.7]], sequence=step))
        error[detections] = abs(tracker.tracks().means[0, 0] - 2.5)
    assert error[True] < 0.08 and error[True] < 0.5 * error[False]


def seen_by_another_cue(step, place, **changes):
    """Something else shows the track, and starts and confirms nobody: a leg, or an easel's."""
    legs = image(0.1 * step + 0.05, [place], sequence=step)
    legs = dataclasses.replace(legs, modality="legs", cue="scan", scores=None)
    return dataclasses.replace(legs, observed=(True, True, False), **changes)


def with_legs(**options):
    return build(models={"head": {"type": "heads", **options}, "legs": {"type": "gaussian", "starts": False}},
                 lifecycle={"type": "second_look", "doubt_after_s": 0.5})  # fmt: skip


def test_what_no_camera_sees_any_more_is_no_person_whatever_its_legs():
    tracker = with_legs()
    for step in range(20):
        tracker.process(
            image(
                0.1 * step,
                [[1.8, 0.0, 1.7]] if step < 8 else [],
                sequence=step,
            )
        )
        tracker.process(seen_by_another_cue(step, [1.8, 0.0, 0.0]))
        if step == 9:
            assert tracker.tracks().confirmed.tolist() == [True]
    assert not tracker.tracks().confirmed.any()


def test_whom_nobody_could_see_is_not_doubted():
    """One stands behind another; the camera looks in vain, and for a reason."""
    tracker, front, behind = with_legs(), [1.2, 0.0, 1.75], [2.0, 0.02, 1.7]
    for step in range(30):
        heads = [behind] if step < 5 else [behind, [1.2, 1.0, 1.75]] if step < 8 else [front]
        tracker.process(image(0.1 * step, heads, sequence=step))
        if step < 8:
            tracker.process(seen_by_another_cue(step, [2.0, 0.02, 0.0]))
            continue
        legs = image(0.1 * step + 0.05, [front, behind], sequence=step)
        legs = dataclasses.replace(legs, modality="legs", cue="scan", scores=None, observed=(True, True, False))
        tracker.process(legs)
    near = np.hypot(*(tracker.tracks().means[:, :2] - behind[:2]).T) < 0.3
    assert tracker.tracks().confirmed[near].tolist() == [True]


def without_layers(measurement):
    """An image too small for any window."""
    return dataclasses.replace(measurement, scores=dataclasses.replace(measurement.scores, layers=()))


@pytest.mark.parametrize(
    "other",
    [lambda entry: with_features(entry, dimensions=10), without_layers, lambda entry: entry],
    ids=["another detector's", "no windows", "no features"],
)
def test_looks_survive_images_of_another_kind(other):
    """A head cue that comes back with another detector, or another camera beside the first."""
    pytest.importorskip("people_fusion.cues.heads.appearance")
    tracker = heads_tracker(adaptive=True)
    for step in range(15):
        measurement = image(0.1 * step, [walked(step)], sequence=step)
        tracker.process(other(measurement) if 5 <= step < 10 else with_features(measurement, seed=step))
    tracks = tracker.tracks()
    assert tracks.confirmed.tolist() == [True]
    np.testing.assert_allclose(tracks.means[0, :2], walked(14)[:2], atol=0.3)


def test_features_are_asked_for_by_appearance_alone():
    pytest.importorskip("people_fusion.cues.heads.appearance")
    assert heads_tracker(adaptive=True).scores == FEATURES
