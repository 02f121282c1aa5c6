"""Poses, their covariance and their Jacobians, beside numeric ones, samples, SciPy and GTSAM."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from poses_at_random import covariances, poses, random_covariance, random_pose, vectors
from scipy.spatial.transform import Rotation, Slerp

from people_fusion.core.errors import DataError
from people_fusion.core.poses import (
    Pose,
    UncertainPose,
    interpolate,
    lever_jacobian,
    rotation_from_vector,
    skew,
    vector_from_rotation,
)

ORACLE = Path(__file__).parent / "oracle_poses.py"


def assert_same(first, second, tolerance=1e-9):
    np.testing.assert_allclose(first.rotation, second.rotation, atol=tolerance)
    np.testing.assert_allclose(first.translation, second.translation, atol=tolerance)


def error_of(true, estimate):
    """(6,) under the module's convention."""
    turn = Rotation.from_matrix(true.rotation @ estimate.rotation.T).as_rotvec()
    return np.concatenate([true.translation - estimate.translation, turn])


def numeric_jacobian(function, size=6, step=1e-5):
    """Central differences of a function of a (size,) error at zero."""
    columns = [(function(step * axis) - function(-step * axis)) / (2.0 * step) for axis in np.eye(size)]
    return np.stack(columns, axis=-1)


def relative_difference(measured, expected):
    return np.linalg.norm(measured - expected) / np.linalg.norm(expected)


@given(poses)
def test_inverse_undoes_a_pose(pose):
    assert_same(pose @ pose.inverse(), Pose.identity())
    assert_same(pose.inverse() @ pose, Pose.identity())


@given(poses, poses, vectors(5.0))
def test_composition_applies_one_pose_after_the_other(first, second, point):
    np.testing.assert_allclose((first @ second).apply(point), first.apply(second.apply(point)), atol=1e-9)


@given(poses, poses, poses, covariances, covariances, covariances)
def test_composition_is_associative_with_its_covariance(a, b, c, C_a, C_b, C_c):
    a, b, c = UncertainPose(a, C_a), UncertainPose(b, C_b), UncertainPose(c, C_c)
    left, right = (a @ b) @ c, a @ (b @ c)
    assert_same(left.mean, right.mean)
    np.testing.assert_allclose(left.covariance, right.covariance, rtol=1e-9, atol=1e-9)


@given(poses, covariances)
def test_inverse_twice_gives_the_covariance_back(pose, covariance):
    twice = UncertainPose(pose, covariance).inverse().inverse()
    np.testing.assert_allclose(twice.covariance, covariance, rtol=1e-9, atol=1e-9)


@given(poses, poses, covariances, covariances)
def test_composed_covariance_is_that_of_numeric_jacobians(a, b, C_a, C_b):
    J_a = numeric_jacobian(lambda error: error_of(a.perturbed(error) @ b, a @ b))
    J_b = numeric_jacobian(lambda error: error_of(a @ b.perturbed(error), a @ b))
    np.testing.assert_allclose(J_a, lever_jacobian(a.rotation @ b.translation), atol=1e-6)
    composed = UncertainPose(a, C_a) @ UncertainPose(b, C_b)
    np.testing.assert_allclose(composed.covariance, J_a @ C_a @ J_a.T + J_b @ C_b @ J_b.T, rtol=1e-6, atol=1e-6)


@given(poses, covariances)
def test_inverted_covariance_is_that_of_numeric_jacobians(pose, covariance):
    J = numeric_jacobian(lambda error: error_of(pose.perturbed(error).inverse(), pose.inverse()))
    inverted = UncertainPose(pose, covariance).inverse()
    np.testing.assert_allclose(inverted.covariance, J @ covariance @ J.T, rtol=1e-6, atol=1e-6)


@given(poses, vectors(10.0), vectors(10.0))
def test_point_jacobians_are_the_numeric_ones(pose, first, second):
    points = np.stack([first, second])
    numeric = numeric_jacobian(lambda error: pose.perturbed(error).apply(points))
    np.testing.assert_allclose(UncertainPose.certain(pose).point_jacobians(points), numeric, atol=1e-6)


def test_covariances_are_those_of_samples():
    rng = np.random.default_rng(3)
    count = 20_000
    a, b, point = random_pose(rng), random_pose(rng), rng.normal(0.0, 2.0, 3)
    C_a, C_b, C_point = random_covariance(rng, 0.03), random_covariance(rng, 0.03), random_covariance(rng, 0.05, 3)
    samples_a = a.perturbed(rng.multivariate_normal(np.zeros(6), C_a, count))
    samples_b = b.perturbed(rng.multivariate_normal(np.zeros(6), C_b, count))
    sample_points = rng.multivariate_normal(point, C_point, count)

    def spread(samples, mean):
        turns = Rotation.from_matrix(samples.rotation @ mean.rotation.T).as_rotvec()
        return np.cov(np.hstack([samples.translation - mean.translation, turns]).T)

    composed = UncertainPose(a, C_a) @ UncertainPose(b, C_b)
    assert relative_difference(spread(samples_a @ samples_b, composed.mean), composed.covariance) < 0.03
    inverted = UncertainPose(a, C_a).inverse()
    assert relative_difference(spread(samples_a.inverse(), inverted.mean), inverted.covariance) < 0.03
    means, spreads = UncertainPose(a, C_a).transform(point[None], C_point[None])
    moved = samples_a.apply(sample_points)
    assert relative_difference(np.cov(moved.T), spreads[0]) < 0.03
    np.testing.assert_allclose(moved.mean(axis=0), means[0], atol=0.01)


def test_covariances_are_those_of_gtsam(oracle_python):
    rng = np.random.default_rng(4)
    cases, ours = [], []
    for _ in range(20):
        a, b = (UncertainPose(random_pose(rng), random_covariance(rng)) for _ in "ab")
        point, C_point = rng.normal(size=3), random_covariance(rng, size=3)
        composed, inverted, (moved, C_moved) = a @ b, a.inverse(), a.transform(point[None], C_point[None])
        ours.append((composed, inverted, moved[0], C_moved[0]))
        described = [
            {"rotation": p.mean.rotation, "translation": p.mean.translation, "covariance": p.covariance} for p in (a, b)
        ]
        cases.append({"a": described[0], "b": described[1], "point": point, "point_covariance": C_point})
    finished = subprocess.run(
        [oracle_python, str(ORACLE)],
        input=json.dumps(cases, default=np.ndarray.tolist),
        capture_output=True,
        text=True,
        check=False,
    )
    if "No module named 'gtsam'" in finished.stderr:
        pytest.skip("GTSAM is not in the oracles' environment: tools/setup --tests installs it")
    assert finished.returncode == 0, finished.stderr
    for (composed, inverted, moved, C_moved), theirs in zip(ours, json.loads(finished.stdout)):
        for uncertain, name in ((composed, "composed"), (inverted, "inverted")):
            matrix = np.array(theirs[name])
            assert_same(uncertain.mean, Pose(matrix[:3, :3], matrix[:3, 3]))
            np.testing.assert_allclose(uncertain.covariance, theirs[name + "_covariance"], atol=1e-9)
        np.testing.assert_allclose(moved, theirs["point"], atol=1e-9)
        np.testing.assert_allclose(C_moved, theirs["point_covariance"], atol=1e-9)


@given(poses, poses, st.lists(st.floats(0.0, 1.0), min_size=1, max_size=5))
def test_interpolation_turns_like_slerp_and_goes_straight(first, second, fractions):
    way = interpolate(first, second, np.array(fractions))
    slerp = Slerp([0.0, 1.0], Rotation.from_matrix(np.stack([first.rotation, second.rotation])))
    np.testing.assert_allclose(way.rotation, slerp(fractions).as_matrix(), atol=1e-7)
    straight = first.translation + np.outer(fractions, second.translation - first.translation)
    np.testing.assert_allclose(way.translation, straight, atol=1e-9)
    single = interpolate(first, second, fractions[0])
    assert_same(single, Pose(way.rotation[0], way.translation[0]))


def test_interpolation_between_equal_poses_stays():
    pose = random_pose(np.random.default_rng(1))
    assert_same(interpolate(pose, pose, 0.3), pose)
    assert_same(interpolate(pose, pose, np.array([0.3])), Pose(pose.rotation[None], pose.translation[None]))


@given(vectors(3.0), vectors(9.0))
def test_quaternions_are_those_of_scipy(turn, way):
    rotation = Rotation.from_rotvec(turn)
    pose = Pose.from_quaternion(way, 7.0 * rotation.as_quat())
    np.testing.assert_allclose(pose.rotation, rotation.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rotation_from_vector(turn), rotation.as_matrix(), atol=1e-12)
    expected = rotation.as_quat() * (1.0 if rotation.as_quat()[3] >= 0.0 else -1.0)
    np.testing.assert_allclose(pose.quaternion, expected, atol=1e-9)
    np.testing.assert_allclose(pose.yaw, rotation.as_euler("xyz")[2], atol=1e-6)


@pytest.mark.parametrize("axis", [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.6, 0, -0.8], [-0.48, 0.6, 0.64]])
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, np.pi - 1e-9, np.pi])
def test_rotation_vectors_survive_the_extremes(axis, angle):
    turn = angle * np.array(axis)
    back = vector_from_rotation(rotation_from_vector(turn))
    np.testing.assert_allclose(rotation_from_vector(back), rotation_from_vector(turn), atol=1e-12)
    assert np.linalg.norm(back) == pytest.approx(angle, abs=1e-12)


def test_batches_are_the_single_poses():
    rng = np.random.default_rng(5)
    quaternions, ways, points = rng.normal(size=(7, 4)), rng.normal(size=(7, 3)), rng.normal(size=(7, 3))
    batch, other = Pose.from_quaternion(ways, quaternions), random_pose(rng)
    for i in range(7):
        single = Pose.from_quaternion(ways[i], quaternions[i])
        np.testing.assert_allclose(batch.apply(points)[i], single.apply(points[i]))
        np.testing.assert_allclose(batch.apply(points[0])[i], single.apply(points[0]))
        np.testing.assert_allclose(batch.quaternion[i], single.quaternion)
        np.testing.assert_allclose(batch.yaw[i], single.yaw)
        for ours, expected in (
            (batch.inverse(), single.inverse()),
            (batch @ other, single @ other),
            (other @ batch, other @ single),
            (batch @ batch, single @ single),
        ):
            assert_same(Pose(ours.rotation[i], ours.translation[i]), expected)
    np.testing.assert_allclose((skew(ways) @ points[..., None])[..., 0], np.cross(ways, points))
    np.testing.assert_allclose(skew(ways[0]) @ points[0], np.cross(ways[0], points[0]))


def test_planar_pose_turns_counterclockwise():
    pose = Pose.from_xy_yaw(1.0, 2.0, np.pi / 2.0, z=0.5)
    np.testing.assert_allclose(pose.apply(np.array([[1.0, 0.0, 0.0]])), [[1.0, 3.0, 0.5]], atol=1e-12)
    assert pose.yaw == pytest.approx(np.pi / 2.0)


@pytest.mark.parametrize(
    ("translation", "quaternion"),
    [([0, 0, np.inf], [0, 0, 0, 1]), ([0, 0, 0], [0, np.nan, 0, 1]), ([0, 0, 0], [0, 0, 0, 0])],
)
def test_pose_without_sense_is_refused(translation, quaternion):
    with pytest.raises(DataError):
        Pose.from_quaternion(translation, quaternion)
