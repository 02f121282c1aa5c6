"""Transforms with covariance: honest over the whole chain, slow errors apart from fresh ones."""

import numpy as np
import pytest
from poses_at_random import random_covariance, random_pose

from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.gaussians import mahalanobis_squared
from people_fusion.core.localisation import STEP_NS
from people_fusion.core.poses import Pose, UncertainPose, vector_from_rotation
from people_fusion.core.transforms import (
    DriftConfig,
    FramesConfig,
    LinkUncertainty,
    TransformsConfig,
    TransformTree,
    UncertainTransforms,
)

SECOND = 1_000_000_000
PLANE = np.ix_([0, 1, 5], [0, 1, 5])
NO_DRIFT = DriftConfig(0.0, 0.0, 0.0, 0.0)
FIX = np.diag([0.04, 0.02, 0.0, 0.0, 0.0, 0.01])
LASER = LinkUncertainty(0.01, 0.005, 0.008, 0.007)


def wander(rng, seconds):
    """Odometry of a robot that turns and drives: poses at each step."""
    poses = [Pose.identity()]
    for speed, turn in zip(rng.uniform(0.0, 1.0, 10 * seconds), rng.normal(0.0, 0.6, 10 * seconds)):
        poses.append(poses[-1] @ Pose.from_xy_yaw(0.1 * speed, 0.0, 0.1 * turn))
    return poses


def robot(odometry, config=None, frames=None, map_from_odom=None, history_s=15.0):
    """Transforms of a robot whose odometry is given at each step; its map follows from `map_from_odom`."""
    tree = TransformTree(history_s)
    for k, pose in enumerate(odometry):
        tree.add("odom", "base_link", k * STEP_NS, pose)
    tree.add("map", "odom", 0, map_from_odom or Pose.from_xy_yaw(3.0, -2.0, 0.7), static=True)
    tree.add("base_link", "laser", 0, random_pose(np.random.default_rng(9), way=0.3, turn=0.5), static=True)
    tree.add("base_link", "camera", 0, random_pose(np.random.default_rng(8), way=0.3, turn=0.5), static=True)
    return UncertainTransforms(tree, frames or FramesConfig(), config or TransformsConfig(drift=NO_DRIFT))


def standing(seconds=10, **kwargs):
    return robot([Pose.from_xy_yaw(1.0, 2.0, 0.3)] * (10 * seconds + 1), **kwargs)


def fix(pose=None, covariance=FIX):
    return UncertainPose(pose or Pose.identity(), covariance)


def joint_covariance(covariances, jacobians, shared):
    """(3K, 3K) of K points of one shared error."""
    J = np.concatenate(jacobians)
    joint = J @ shared @ J.T
    for k, covariance in enumerate(covariances):
        joint[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += covariance
    return joint


def test_points_seen_twice_are_consistent_over_the_whole_chain():
    """NEES of two points in two look-ups, with what they share: localisation and calibration, not jitter and noise."""
    rng = np.random.default_rng(1)
    count = 4000
    transforms = standing(config=TransformsConfig(links={"laser": LASER}, drift=NO_DRIFT))
    covariance = random_covariance(rng, 0.02)
    world_from_base, base_from_laser = (
        transforms.source.lookup(*frames, SECOND) for frames in (("map", "base_link"), ("base_link", "laser"))
    )
    transforms.add_localisation(0, fix(world_from_base, covariance))
    points, C_point = rng.normal(0.0, 2.0, (2, 3)), random_covariance(rng, 0.02, 3)

    true_world_from_base = world_from_base.perturbed(rng.multivariate_normal(np.zeros(6), covariance, count))
    calibrated = base_from_laser.perturbed(rng.multivariate_normal(np.zeros(6), LASER.calibration_covariance, count))
    errors, covariances, jacobians = [], [], []
    for k in range(2):
        transform = transforms.lookup("map", "laser", (1 + k) * SECOND)
        means, spreads, J = transform.transform(points[k : k + 1], C_point[None])
        covariances.append(spreads[0])
        jacobians.append(J[0])
        shaken = calibrated.perturbed(rng.multivariate_normal(np.zeros(6), LASER.jitter_covariance, count))
        true_points = rng.multivariate_normal(points[k], C_point, count)
        errors.append((true_world_from_base @ shaken).apply(true_points) - means[0])
    nees = mahalanobis_squared(
        np.hstack(errors), joint_covariance(covariances, jacobians, transform.shared_covariance)
    ).mean()
    assert nees == pytest.approx(6.0, rel=0.04)


def test_covariance_grown_along_the_way_is_that_of_sampled_drift():
    rng = np.random.default_rng(2)
    drift = DriftConfig(0.05, 0.02, 0.05, 0.03)
    odometry = wander(rng, 10)
    transforms = robot(odometry, TransformsConfig(drift=drift))
    start = Pose.from_xy_yaw(5.0, 1.0, 2.0)
    transforms.add_localisation(0, fix(start, 0.1 * FIX))
    estimate, true = start, start.perturbed(rng.multivariate_normal(np.zeros(6), 0.1 * FIX, 4000))
    for before, after in zip(odometry, odometry[1:]):
        motion = before.inverse() @ after
        estimate = estimate @ motion
        true = true @ motion.perturbed(rng.multivariate_normal(np.zeros(6), drift.covariance(motion), 4000))
    turns = np.array([vector_from_rotation(turn)[2] for turn in true.rotation @ estimate.rotation.T])
    errors = np.column_stack([true.translation[:, :2] - estimate.translation[:2], turns])
    grown = transforms.localisation_covariance(10 * SECOND)[PLANE]
    assert mahalanobis_squared(errors, grown).mean() == pytest.approx(3.0, rel=0.05)
    assert mahalanobis_squared(errors, 0.1 * FIX[PLANE]).mean() > 6.0


def test_localisation_is_interpolated_between_fixes_and_held_before_the_first():
    transforms = standing()
    transforms.add_localisation(4 * SECOND, fix(covariance=3.0 * FIX))
    transforms.add_localisation(2 * SECOND, fix())
    np.testing.assert_allclose(transforms.localisation_covariance(5 * SECOND // 2), 1.5 * FIX)
    np.testing.assert_allclose(transforms.localisation_covariance(2 * SECOND), FIX)
    np.testing.assert_allclose(transforms.localisation_covariance(0), FIX)


def test_covariance_never_shrinks_without_a_fix():
    """Its volume, that is: on a way back the yaw's lever on the position gets shorter again."""
    transforms = robot(wander(np.random.default_rng(3), 10), TransformsConfig())
    transforms.add_localisation(0, fix())
    grown = [transforms.localisation_covariance(k * STEP_NS // 3)[PLANE] for k in range(300)]
    assert (np.diff([np.linalg.slogdet(covariance)[1] for covariance in grown]) >= -1e-9).all()
    assert (np.diff([covariance[2, 2] for covariance in grown]) >= 0.0).all()
    assert np.linalg.det(grown[-1]) > 1.5 * np.linalg.det(grown[0])


def test_robot_that_stands_keeps_its_covariance():
    transforms = standing(config=TransformsConfig())
    transforms.add_localisation(0, fix())
    np.testing.assert_allclose(transforms.localisation_covariance(9 * SECOND), FIX, atol=1e-12)


def test_way_there_and_back_counts():
    there = [Pose.from_xy_yaw(0.1 * k, 0.0, 0.0) for k in range(31)]
    transforms = robot(there + there[::-1], TransformsConfig(drift=DriftConfig(0.05, 0.0, 0.0, 0.0)))
    transforms.add_localisation(0, fix(covariance=np.zeros((6, 6))))
    grown = transforms.localisation_covariance(6 * SECOND)
    assert grown[0, 0] == pytest.approx(6.0 * 0.05**2, rel=0.02)


def test_growth_does_not_depend_on_who_asked_before():
    odometry = wander(np.random.default_rng(4), 10)
    asked_often, asked_once = robot(odometry, TransformsConfig()), robot(odometry, TransformsConfig())
    for transforms in (asked_often, asked_once):
        transforms.add_localisation(0, fix())
    for stamp in np.random.default_rng(5).integers(0, 9 * SECOND, 50):
        asked_often.localisation_covariance(int(stamp))
    stamp = 7 * SECOND + 12_345_678
    np.testing.assert_array_equal(asked_often.localisation_covariance(stamp), asked_once.localisation_covariance(stamp))


def test_new_fix_ends_the_growth():
    transforms = robot(wander(np.random.default_rng(6), 10), TransformsConfig())
    transforms.add_localisation(0, fix())
    transforms.localisation_covariance(9 * SECOND)
    transforms.add_localisation(9 * SECOND, fix(covariance=0.5 * FIX))
    np.testing.assert_allclose(transforms.localisation_covariance(9 * SECOND), 0.5 * FIX)
    np.testing.assert_allclose(transforms.localisation_covariance(9 * SECOND + STEP_NS), 0.5 * FIX, atol=2e-3)


def test_way_that_nobody_asked_about_is_not_forgotten():
    """Fix, then a drive longer than odometry is remembered: the net way counts at least."""
    drive = [Pose.from_xy_yaw(0.05 * k, 0.0, 0.0) for k in range(1001)]
    tree = TransformTree(5.0)
    config = TransformsConfig(drift=DriftConfig(0.05, 0.0, 0.0, 0.0), history_s=5.0)
    transforms = UncertainTransforms(tree, FramesConfig(), config)
    tree.add("odom", "base_link", 0, drive[0])
    transforms.add_localisation(0, fix(covariance=np.zeros((6, 6))))
    for k, pose in enumerate(drive):
        tree.add("odom", "base_link", k * STEP_NS, pose)
    assert transforms.localisation_covariance(100 * SECOND)[0, 0] == pytest.approx(50.0 * 0.05**2)


def test_fix_that_arrives_before_its_odometry_grows_all_the_same():
    tree = TransformTree()
    transforms = UncertainTransforms(tree, FramesConfig(), TransformsConfig(drift=DriftConfig(0.05, 0.0, 0.0, 0.0)))
    transforms.add_localisation(0, fix(covariance=np.zeros((6, 6))))
    for k in range(11):
        tree.add("odom", "base_link", k * STEP_NS, Pose.from_xy_yaw(0.1 * k, 0.0, 0.0))
    assert transforms.localisation_covariance(SECOND)[0, 0] == pytest.approx(0.05**2)


def test_memory_is_bounded_while_fixes_come_and_when_they_stay_away():
    transforms = standing(seconds=1)
    transforms.add_localisation(0, fix())
    for k in range(2000):
        transforms.source.add("odom", "base_link", k * STEP_NS, Pose.identity())
        transforms.localisation_covariance(k * STEP_NS)
    assert len(transforms._localisation._grown) <= 152
    for k in range(2000, 4000):
        transforms.add_localisation(k * STEP_NS, fix())
    assert len(transforms._localisation) <= 152


@pytest.mark.parametrize("first", [False, True])
def test_one_fix_stamped_far_ahead_takes_nothing_away(first):
    year = 365 * 24 * 3600 * SECOND
    odometry = wander(np.random.default_rng(7), 30)
    right, misled = (robot(odometry, TransformsConfig(), history_s=40.0) for _ in range(2))
    if first:
        misled.add_localisation(year, fix(covariance=9.0 * FIX))
    for k in range(0, 300, 5):
        for transforms in (right, misled):
            transforms.add_localisation(k * STEP_NS, fix(covariance=(1.0 + 0.01 * k) * FIX))
        if k % 50 == 0:
            misled.add_localisation(year, fix(covariance=9.0 * FIX))
        for stamp in (k - 40, k - 1, k, k + 4):
            np.testing.assert_array_equal(
                misled.localisation_covariance(stamp * STEP_NS), right.localisation_covariance(stamp * STEP_NS)
            )
    assert len(misled._localisation) <= len(right._localisation) + 1


def test_fix_after_a_long_stand_counts_at_once():
    transforms = standing(seconds=100, history_s=100.0)
    transforms.add_localisation(0, fix())
    transforms.add_localisation(90 * SECOND, fix(covariance=25.0 * FIX))
    np.testing.assert_allclose(transforms.localisation_covariance(90 * SECOND), 25.0 * FIX)
    np.testing.assert_allclose(transforms.localisation_covariance(95 * SECOND), 25.0 * FIX)
    np.testing.assert_allclose(transforms.localisation_covariance(50 * SECOND), FIX)


@pytest.mark.parametrize("odom", ["", "odometry"])
def test_covariance_is_held_where_there_is_no_odometry(odom):
    tree = TransformTree()
    for k in range(50):
        tree.add("map", "base_link", k * STEP_NS, Pose.from_xy_yaw(0.1 * k, 0.0, 0.0))
    transforms = UncertainTransforms(tree, FramesConfig(odom=odom), TransformsConfig())
    transforms.add_localisation(0, fix())
    np.testing.assert_allclose(transforms.lookup("map", "base_link", 4 * SECOND).shared_covariance, FIX)


def test_without_a_fix_localisation_counts_as_certain_and_says_so():
    transforms = standing()
    assert not transforms.has_localisation
    transform = transforms.lookup("map", "laser", SECOND)
    assert not transform.shared_covariance.any()
    assert not transform.white_covariance.any()
    transforms.add_localisation(0, fix())
    assert transforms.has_localisation
    assert transforms.lookup("map", "laser", SECOND).shared_covariance.any()
    transforms.reset()
    assert not transforms.has_localisation


def test_each_pair_of_frames_gets_the_errors_between_them_alone():
    transforms = standing(config=TransformsConfig(links={"/laser": LASER}, drift=NO_DRIFT))
    transforms.add_localisation(0, fix())
    for target, source, localised, jitters in (
        ("map", "/laser", True, True),
        ("map", "camera", True, False),
        ("map", "base_link", True, False),
        ("map", "odom", True, False),
        ("odom", "laser", False, True),
        ("base_link", "laser", False, True),
        ("camera", "laser", False, True),
        ("odom", "camera", False, False),
        ("odom", "base_link", False, False),
        ("map", "map", False, False),
        ("laser", "laser", False, False),
    ):
        for transform in (transforms.lookup(target, source, SECOND), transforms.lookup(source, target, SECOND)):
            assert transform.white_covariance.any() == jitters, (target, source)
            assert transform.shared_covariance.any() == (localised or jitters), (target, source)


def test_localisation_acts_on_odom_with_its_lever():
    """World from odom errs as world from base composed with a certain base from odom."""
    transforms = robot([Pose.from_xy_yaw(4.0, 3.0, 1.0)] * 20)
    transforms.add_localisation(0, fix())
    world_from_base, base_from_odom = (
        transforms.source.lookup(*frames, SECOND) for frames in (("map", "base_link"), ("base_link", "odom"))
    )
    expected = UncertainPose(world_from_base, FIX) @ UncertainPose.certain(base_from_odom)
    shared = transforms.lookup("map", "odom", SECOND).shared_covariance
    np.testing.assert_allclose(shared, expected.covariance, atol=1e-12)
    backwards = transforms.lookup("odom", "map", SECOND)
    np.testing.assert_allclose(backwards.shared_covariance, expected.inverse().covariance, atol=1e-12)
    np.testing.assert_allclose((backwards.pose @ expected.mean).translation, 0.0, atol=1e-12)


def test_between_two_sensors_both_calibrations_count():
    camera = LinkUncertainty(calibration_position_std=0.05, calibration_rotation_std=0.03)
    links = {"laser": LinkUncertainty(0.02, 0.01), "camera": camera}
    transforms = standing(config=TransformsConfig(links=links))
    base_from = {
        name: UncertainPose(transforms.source.lookup("base_link", name, SECOND), link.calibration_covariance)
        for name, link in links.items()
    }
    expected = base_from["camera"].inverse() @ base_from["laser"]
    transform = transforms.lookup("camera", "laser", SECOND)
    np.testing.assert_allclose(transform.pose.translation, expected.mean.translation, atol=1e-12)
    np.testing.assert_allclose(transform.shared_covariance, expected.covariance, atol=1e-12)


def test_default_link_is_of_sensors_that_are_not_named():
    config = TransformsConfig(links={"laser": LinkUncertainty()}, default_link=LASER, drift=NO_DRIFT)
    transforms = standing(config=config)
    assert not transforms.lookup("base_link", "laser", SECOND).shared_covariance.any()
    np.testing.assert_allclose(
        transforms.lookup("odom", "camera", SECOND).shared_covariance, LASER.calibration_covariance
    )


def test_world_that_is_odometry_has_no_localisation_error():
    transforms = standing(frames=FramesConfig(world="odom"))
    transforms.add_localisation(0, fix())
    assert not transforms.lookup("odom", "laser", SECOND).shared_covariance.any()


def test_recording_without_any_transform_is_told_in_the_sensor_frame():
    transforms = UncertainTransforms(TransformTree(), FramesConfig(world="laser"), TransformsConfig(default_link=LASER))
    transform = transforms.lookup("laser", "laser", 0)
    np.testing.assert_array_equal(transform.pose.apply(np.ones((2, 3))), 1.0)
    assert not transform.white_covariance.any()
    with pytest.raises(TransformUnavailable):
        transforms.lookup("map", "laser", 0)


@pytest.mark.parametrize(
    "localisation",
    [
        fix(covariance=-FIX),
        fix(covariance=np.full((6, 6), np.nan)),
        fix(pose=Pose(np.eye(3), np.array([np.inf, 0.0, 0.0]))),
    ],
)
def test_localisation_without_sense_is_refused_and_the_last_one_stays(localisation):
    transforms = standing()
    transforms.add_localisation(0, fix())
    with pytest.raises(DataError, match="localisation"):
        transforms.add_localisation(SECOND, localisation)
    np.testing.assert_allclose(transforms.localisation_covariance(2 * SECOND), FIX)
