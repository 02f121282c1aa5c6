"""The tracker of particles against the Kalman tracker, chance and the equations of Poschmann's chapter 7."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2
from score_images import image

from people_fusion.core.config import parse
from people_fusion.core.measurements import XYZ_OBSERVED, Measurement
from people_fusion.cues.heads.places import scores_at, seen
from people_fusion.tracking.models.heads import HeadScoreModel, HeadScoreModelConfig
from people_fusion.tracking.models.legs import LegModel, LegModelConfig
from people_fusion.tracking.tracker import TRACKERS
from people_fusion.tracking.weighing import NONE, Belief

MOTION = {"type": "near_constant_velocity", "velocity_variance_rate": 0.5}
ANYWHERE = {"head_heights": [-9.0, 9.0], "proximity": {"distance_max": 0.0}, "motion": MOTION}
GATELESS = {"head": {"type": "gaussian", "gate": 1e9}}


def build(name, **options):
    return TRACKERS.build(parse(TRACKERS.config_of(name, "tracker"), options))


def seen_at(time_s, positions, std, sequence):
    positions = np.asarray(positions, dtype=float).reshape(-1, 3)
    return Measurement(
        stamp_ns=round(1e9 * time_s), cue="camera", modality="head", frame_id="map", positions=positions,
        covariances=np.repeat(std**2 * np.eye(3)[None], len(positions), axis=0), observed=XYZ_OBSERVED,
        confidences=np.full(len(positions), 0.9), sequence=sequence,
    )  # fmt: skip


def test_many_particles_weighed_by_gaussians_are_the_kalman_tracker():
    """Two people, one of whom is missed now and then; mean within 0.1 of a deviation, deviations within 5 %."""
    rng, lifecycle = np.random.default_rng(3), {"type": "second_look"}
    kalman = build("kalman", gate=11.345, motion=MOTION, lifecycle=lifecycle)
    particles = build("particle", particles=20_000, roughening=0.1, lifecycle=lifecycle, **ANYWHERE)
    for step in range(40):
        positions = np.array([[0.1 * step, 0.0, 1.7], [4.0 - 0.08 * step, 1.5, 1.6]])[: 1 if step % 5 == 4 else 2]
        measurement = seen_at(0.1 * step, positions + rng.normal(0.0, 0.05, positions.shape), 0.05, step)
        for tracker in (kalman, particles):
            tracker.process(measurement)
    expected, tracks = kalman.tracks(), particles.tracks()
    np.testing.assert_array_equal(tracks.ids, expected.ids)
    assert tracks.confirmed.all() and len(tracks) == 2
    stds = np.sqrt(np.diagonal(expected.covariances, axis1=1, axis2=2))
    np.testing.assert_allclose((tracks.means - expected.means) / stds, 0.0, atol=0.1)
    np.testing.assert_allclose(np.sqrt(np.diagonal(tracks.covariances, axis1=1, axis2=2)) / stds, 1.0, atol=0.05)


@pytest.mark.parametrize(("count", "roughening"), [(500, 0.5), (2000, 0.1)])
def test_errors_are_as_large_as_the_tracks_say_in_the_matched_case(count, roughening):
    """NEES over 60 walks within 0.8 to 1.25 of its dimension.

    500 particles without much roughening are too few for five dimensions: 1.6 to 1.9, as those of a new track, whose
    velocity may be any, come down to a handful.
    """
    nees = []
    for run in range(60):
        rng = np.random.default_rng(run)
        options = {"particles": count, "roughening": roughening, "seed": run, "models": GATELESS}
        tracker = build("particle", **options, **ANYWHERE)
        transition, noise = tracker._motion.transition(0.1)
        truth = rng.multivariate_normal(np.zeros(5), tracker._motion.initial_covariance)
        for step in range(25):
            tracker.process(seen_at(0.1 * step, truth[:3] + rng.normal(0.0, 0.1, 3), 0.1, step))
            if step >= 10:
                tracks = tracker.tracks()
                error = tracks.means[0] - truth
                nees.append(error @ np.linalg.solve(tracks.covariances[0], error))
            truth = transition @ truth + rng.multivariate_normal(np.zeros(5), noise)
    assert 0.8 < np.mean(nees) / 5.0 < 1.25
    assert np.mean(np.array(nees) > chi2.ppf(0.99, 5)) < 0.05


def believed(states):
    tracks, count = states.shape[:2]
    weights, covariances = np.full((tracks, count), 1.0 / count), np.repeat(0.01 * np.eye(5)[None], tracks, axis=0)
    confirmed = np.ones(tracks, dtype=bool)
    return Belief(states, weights, states.mean(axis=1), covariances, confirmed, np.zeros((tracks, 0)))


def test_particles_weigh_what_equations_7_3_and_7_4_say():
    rng = np.random.default_rng(2)
    heads = np.array([[1.5, 0.0, 1.7], [1.2, 1.0, 1.6]])
    states = np.pad(heads[:, None] + rng.normal(0.0, 0.1, (2, 200, 3)), ((0, 0), (0, 0), (0, 2)))
    measurement = image(0.0, heads, found=[])
    model, belief = HeadScoreModel(HeadScoreModelConfig()), believed(states)
    logs = model.weigh(belief, measurement, model.associate(belief, measurement), rng)
    scores = measurement.scores
    for track in range(2):
        for particle in range(200):
            box = seen(scores, states[track, particle, None, :3])
            (score,) = scores_at(scores, box.middles, box.heights)
            of_head = 1.0 / (1.0 + np.exp(scores.platt_slope * score))
            assert np.exp(logs[track, particle]) == pytest.approx(0.7 * of_head + 0.3 * 0.05, rel=1e-6)
    assert logs.max() - logs.min() > 1.0


def legs_at(detect, legs, owners):
    """People whose legs are these, each at the middle of his."""
    legs, owners = np.asarray(legs, dtype=float), np.asarray(owners)
    places = [legs[owners == person].mean(axis=0) for person in range(owners.max() + 1)]
    return dataclasses.replace(detect(0.0, *places), legs=legs, leg_owners=owners)


def standing(*places):
    return believed(np.repeat(np.pad(np.array(places, dtype=float), ((0, 0), (0, 3)))[:, None], 3, axis=1))


def test_legs_go_to_tracks_not_to_each_other(detect):
    """7.2.2: the cue took the inner legs of two people for a third's; the tracks take their own."""
    legs = [[0.0, 0.1], [0.0, -0.1], [0.0, -0.3], [0.0, -0.5]]
    measurement = legs_at(detect, legs, [0, 1, 1, 2])
    model, belief = LegModel(LegModelConfig()), standing([0.0, 0.0], [0.0, -0.4])
    pairing = model.associate(belief, measurement)
    np.testing.assert_allclose(pairing.points, [[0.0, 0.0], [0.0, -0.4]], atol=1e-12)
    assert pairing.used.all() and pairing.detected.all()


def test_a_track_has_two_legs_at_most_and_none_from_afar(detect):
    measurement = legs_at(detect, [[0.0, 0.1], [0.0, -0.1], [0.0, 0.2], [0.0, 0.6]], [0, 0, 1, 2])
    model, belief = LegModel(LegModelConfig()), standing([0.0, 0.0], [5.0, 0.0])
    pairing = model.associate(belief, measurement)
    np.testing.assert_allclose(pairing.points[0], [0.0, 0.0], atol=1e-12)
    assert pairing.rows[1] == NONE and np.isnan(pairing.points[1]).all()
    assert pairing.used.tolist() == [True, False, False]
    weights = model.weigh(belief, measurement, pairing, np.random.default_rng(0))
    assert not weights[1].any()


def test_legs_begin_nobody_and_keep_those_alive_who_are_confirmed(detect):
    """7.3: the laser spawns no tracks; who was confirmed by a camera stays while his legs are seen."""
    tracker = build("particle", models={"legs": {"type": "legs"}})
    for step in range(5):
        tracker.process(detect(0.1 * step, (1.0, 0.0), sequence=step))
    assert len(tracker.tracks()) == 0
    tracker.process(seen_at(0.5, [1.0, 0.0, 1.7], 0.05, 5))
    for step in range(6, 20):
        tracker.process(detect(0.1 * step, (1.0, 0.0), sequence=step))
    assert len(tracker.tracks()) == 0  # seen once
    for step in (20, 21):
        tracker.process(seen_at(0.1 * step, [1.0, 0.0, 1.7], 0.05, step))
    for step in range(22, 60):
        tracker.process(detect(0.1 * step, (1.0, 0.0), sequence=step))
    assert tracker.tracks().confirmed.tolist() == [True]
    for step in range(60, 72):
        tracker.process(detect(0.1 * step, sequence=step))
    assert len(tracker.tracks()) == 0


@pytest.mark.parametrize(("height", "people"), [(0.5, 0), (0.8, 1), (1.2, 1), (2.6, 0)])
def test_heads_where_no_head_can_be_begin_nobody(height, people):
    """Their particles would weigh nothing, whatever is measured, and go their own ways."""
    tracker = build("particle", head_heights=[0.9, 2.1])
    for step in range(20):
        tracker.process(seen_at(0.1 * step, [1.5 - 0.05 * step, 0.0, height], 0.06, step))
    assert len(tracker.tracks()) == people
