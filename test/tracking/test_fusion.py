"""Measurements through uncertain transforms: Monte Carlo of the whole placement, and the treatments' difference."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.errors import ConfigError
from people_fusion.core.measurements import Announcement
from people_fusion.core.poses import Pose
from people_fusion.core.tracks import NOBODY, Legs, Tracks
from people_fusion.core.transforms import TransformSource, UncertainTransform
from people_fusion.tracking.fusion import Fusion, load_config, move_legs, move_tracks, place

TRANSFORM = UncertainTransform(
    Pose.from_xy_yaw(2.0, -1.0, 0.7),
    np.diag([1e-4, 1e-4, 0, 0, 0, 1e-5]),
    np.diag([0.01, 0.02, 0, 0, 0, 4e-4]),
)


def moved_by(pose, error):
    """`pose` with an error in its fixed axes."""
    turn = Pose.from_xy_yaw(0.0, 0.0, error[5]).rotation
    return Pose(turn @ pose.rotation, pose.translation + error[:3])


@pytest.mark.parametrize("localisation, shared", [("white", True), ("none", False), ("output", False)])
def test_placed_covariance_equals_monte_carlo(detect, localisation, shared):
    rng = np.random.default_rng(1)
    measurement = dataclasses.replace(detect(0.0, (3.0, 1.0)), frame_id="laser")
    placed = place(measurement, TRANSFORM, "map", localisation)
    errors = rng.multivariate_normal(np.zeros(6), TRANSFORM.white_covariance, 20000)
    if shared:
        errors += rng.multivariate_normal(np.zeros(6), TRANSFORM.shared_covariance, 20000)
    points = np.array([3.0, 1.0, 0.4]) + np.pad(rng.normal(0, 0.05, (20000, 2)), ((0, 0), (0, 1)))
    sample = np.array([moved_by(TRANSFORM.pose, e).apply(p) for e, p in zip(errors, points)])
    np.testing.assert_allclose(placed.covariances[0, :2, :2], np.cov(sample[:, :2].T), rtol=0.03, atol=3e-5)
    assert (placed.shared_covariance is not None) == (localisation == "output")


def test_moved_tracks_equal_monte_carlo_in_position_and_velocity():
    rng = np.random.default_rng(2)
    covariance = np.diag([0.01, 0.01, 0.01, 0.04, 0.04])
    state = np.array([3.0, 1.0, 1.6, 1.0, -0.5])
    one = np.ones(1, dtype=bool)
    tracks = Tracks(0, "odom", np.ones(1, int), state[None], covariance[None], np.ones(1), one, one, one, np.ones(1))
    moved = move_tracks(tracks, TRANSFORM, "map")
    whole = TRANSFORM.white_covariance + TRANSFORM.shared_covariance
    sample = []
    for _ in range(20000):
        draw = rng.multivariate_normal(state, covariance)
        pose = moved_by(TRANSFORM.pose, rng.multivariate_normal(np.zeros(6), whole))
        sample.append([*pose.apply(draw[:3]), *(pose.rotation @ [draw[3], draw[4], 0.0])[:2]])
    np.testing.assert_allclose(moved.means[0], np.mean(sample, axis=0), atol=0.01)
    np.testing.assert_allclose(moved.covariances[0], np.cov(np.transpose(sample)), rtol=0.03, atol=1e-3)


def test_moved_legs_equal_monte_carlo():
    rng = np.random.default_rng(3)
    covariance = np.array([[0.02, 0.01], [0.01, 0.03]])
    one = np.ones(1, dtype=bool)
    legs = Legs(0, "odom", np.ones(1, int), np.array([[3.0, 1.0]]), covariance[None], np.array([NOBODY]), one)
    moved = move_legs(legs, TRANSFORM, "map")
    whole = TRANSFORM.white_covariance + TRANSFORM.shared_covariance
    points = np.pad(rng.multivariate_normal([3.0, 1.0], covariance, 20000), ((0, 0), (0, 1)))
    errors = rng.multivariate_normal(np.zeros(6), whole, 20000)
    sample = np.array([moved_by(TRANSFORM.pose, e).apply(p) for e, p in zip(errors, points)])[:, :2]
    np.testing.assert_allclose(moved.positions[0], sample.mean(axis=0), atol=0.01)
    np.testing.assert_allclose(moved.covariances[0], np.cov(sample.T), rtol=0.03, atol=1e-3)
    assert moved.frame_id == "map" and moved.owners.tolist() == [NOBODY]


def test_legs_are_told_in_the_frame_of_the_tracks(detect):
    class Shifted(TransformSource):
        def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
            return Pose.from_xy_yaw(5.0 if (target_frame, source_frame) == ("map", "odom") else 0.0, 0.0, 0.0)

    assert Fusion(load_config(), Shifted()).legs() is None
    fusion = Fusion(load_config("leg_mht", {"buffer": {"type": "drop"}}), Shifted())
    for step in range(30):
        for measurement in fusion.push(detect(0.1 * step, (0.1 * step, 1.0), sequence=step), round(1e8 * step)):
            fusion.process(measurement)
    legs, tracks = fusion.legs(), fusion.tracks()
    assert legs.frame_id == tracks.frame_id == "map" and len(legs) == 2 and legs.seen.all()
    np.testing.assert_allclose(legs.positions.mean(axis=0), tracks.means[0, :2], atol=0.02)
    assert tracks.means[0, 0] > 7.0 and set(legs.owners) == set(tracks.ids)


@pytest.mark.parametrize("preset", ["default", "poschmann_t1", "volkhardt"])
def test_presets_load(preset):
    assert load_config(preset) is not None


@pytest.mark.parametrize(
    "overrides, path",
    [
        ({"tracker": {"type": "kalman", "gates": 3.0}}, "tracker/gates"),
        ({"tracker": {"type": "kalman", "gate": "wide"}}, "tracker/gate"),
        ({"tracker": {"type": "kalman", "gate": -1.0}}, "tracker/gate"),
        ({"tracker": {"type": "kalmann"}}, "tracker/type"),
        ({"localisation": "maybe"}, "localisation"),
        ({"transforms": {"links": {"laser": {"jitter_position_std": -0.1}}}}, "links/laser/jitter_position_std"),
        ({"tracks": {}}, "tracks"),
        ({"leg_cue": {"type": "heads"}}, "leg_cue: 'heads' takes Image, not Scan"),
        ({"head_cues": {"face": {"type": "legs"}}}, "head_cues/face: 'legs' takes Scan, not Image"),
        ({"rgbd_cues": {"kinect": {"type": "heads"}}}, "rgbd_cues/kinect: 'heads' takes Image, not DepthImage"),
        ({"head_cues": {"face": {"type": "heads", "min_range": 9.0}}}, "head_cues/face/max_range"),
    ],
)
def test_bad_parameters_are_refused_by_their_path(overrides, path):
    with pytest.raises(ConfigError, match=path):
        load_config("default", overrides)


def test_modalities_that_are_not_heeded_withdraw_what_was_announced(detect):
    config = load_config(overrides={"modalities": ["head"], "buffer": {"type": "announced"}, "localisation": "none"})

    class Standing(TransformSource):
        def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
            return Pose.from_xy_yaw(0.0, 0.0, 0.0)

    fusion = Fusion(config, Standing())
    legs, head, newer = (
        dataclasses.replace(detect(stamp_s, (2.0, 0.0), cue=modality), modality=modality)
        for stamp_s, modality in ((1.0, "legs"), (1.1, "head"), (1.2, "legs"))
    )
    for each in (legs, head, newer):
        fusion.push(Announcement(each.stamp_ns, each.cue, each.sequence), each.stamp_ns)
    assert not fusion.push(head, newer.stamp_ns)  # the legs come first
    assert [each.cue for each in fusion.push(legs, newer.stamp_ns)] == ["head"]


def test_particles_are_told_in_the_frame_of_the_tracks(detect):
    turned = Pose.from_xy_yaw(2.0, -1.0, 0.7)

    class Turned(TransformSource):
        def lookup(self, target, source, stamp_ns):  # noqa: ARG002
            return Pose.identity() if target == source else turned if target == "map" else turned.inverse()

    overrides = {"tracker": {"type": "particle"}, "localisation": "output"}
    fusion = Fusion(load_config(None, overrides), Turned())
    fusion.process(dataclasses.replace(detect(0.0, (3.0, 1.0)), frame_id="odom"))
    particles, tracks = fusion.particles(), fusion.tracks()
    assert particles.frame_id == tracks.frame_id == "map" and particles.ids.tolist() == tracks.ids.tolist()
    means = (particles.weights[..., None] * particles.positions).sum(axis=1)
    np.testing.assert_allclose(means, tracks.means[:, :3], atol=1e-9)
    assert np.hypot(*(particles.positions[0, :, :2] - turned.apply(np.array([[3.0, 1.0, 0.4]]))[:, :2]).T).max() < 1.0
    assert Fusion(load_config(None, {"localisation": "output"}), Turned()).particles() is None
