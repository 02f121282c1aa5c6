"""Detections that share a slow error of the robot's place: honest from the first measurement to the last."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

from people_fusion.core.config import parse
from people_fusion.core.poses import Pose, UncertainPose
from people_fusion.core.transforms import TransformTree
from people_fusion.filtering.motion_models.near_constant_velocity import (
    NearConstantVelocity,
    NearConstantVelocityConfig,
)
from people_fusion.tracking.fusion import Fusion, FusionConfig
from people_fusion.tracking.tracker import TRACKERS

RUNS = 100
AXES = [0, 1, 3, 4]
PERIOD_S = 0.1
MOTION = NearConstantVelocity(NearConstantVelocityConfig(velocity_variance_rate=0.5))
ROBOT = Pose.from_xy_yaw(3.0, -2.0, 0.8)
LASER = Pose.from_xy_yaw(0.3, 0.1, -0.4, z=0.2)
LOCALISATION = np.diag([0.15**2, 0.1**2, 0.0, 0.0, 0.0, 0.04**2])


def fusion(treatment):
    tree = TransformTree()
    tree.add("map", "odom", 0, Pose.from_xy_yaw(1.0, 1.0, -0.3), static=True)
    odom_from_base = Pose.from_xy_yaw(1.0, 1.0, -0.3).inverse() @ ROBOT
    tree.add("odom", "base_link", 0, odom_from_base, static=True)
    tree.add("base_link", "laser", 0, LASER, static=True)
    tracker = {
        "type": "kalman",
        "gate": 1e9,
        "unlikely_cost": 1e9,
        "shared_error_time_s": 1e9,
        "motion": {"type": "near_constant_velocity", "velocity_variance_rate": 0.5},
    }
    built = Fusion(parse(FusionConfig, {"localisation": treatment, "tracker": tracker}), tree)
    built.transforms.add_localisation(0, UncertainPose(ROBOT, LOCALISATION))
    return built


def squared_errors(treatment, detect, count):
    """(RUNS,) NEES after `count` scans of one person, each run with its own error of the robot's place."""
    found = []
    for run in range(RUNS):
        rng = np.random.default_rng(run)
        laser = ROBOT.perturbed(rng.multivariate_normal(np.zeros(6), LOCALISATION)) @ LASER
        state = np.array([5.0, 1.0, 0.4, 0.0, 0.0]) + rng.multivariate_normal(np.zeros(5), MOTION.initial_covariance)
        transition, noise = MOTION.transition(PERIOD_S)
        tracked = fusion(treatment)
        for step in range(count):
            if step:
                state = transition @ state + rng.multivariate_normal(np.zeros(5), noise)
            seen = laser.inverse().apply(state[:3])[:2] + rng.normal(0.0, 0.05, 2)
            scan = dataclasses.replace(detect(1.0 + step * PERIOD_S, seen, sequence=step), frame_id="laser")
            for measurement in tracked.push(scan, scan.stamp_ns):
                tracked.process(measurement)
        tracks = tracked.tracks()
        assert len(tracks) == 1 and tracks.frame_id == "map"
        error = tracks.means[0, AXES] - state[AXES]
        found.append(error @ np.linalg.solve(tracks.covariances[0][np.ix_(AXES, AXES)], error))
    return np.array(found)


@pytest.mark.parametrize("count", [1, 2, 4, 30])
@pytest.mark.parametrize("treatment", ["consider", "output"])
def test_tracks_of_a_robot_that_errs_in_its_place_are_consistent_over_100_runs(treatment, count, detect):
    low, high = chi2.ppf([0.025, 0.975], len(AXES) * RUNS) / RUNS
    assert low < np.mean(squared_errors(treatment, detect, count)) < high


def test_localisation_error_as_fresh_noise_is_overconfident(detect):
    assert np.mean(squared_errors("white", detect, 30)) > 2 * len(AXES)


def test_sensor_on_the_wall_has_no_part_in_the_robot_s_error(detect):
    """What a track owes to the robot's place is still known after a sensor that needs no localisation saw it."""
    bias = np.diag([0.2**2, 0.2**2, 0.0, 0.0, 0.0, 0.0])
    jacobian = np.eye(3, 6)[None]
    found, runs = [], 2 * RUNS
    transition, noise = MOTION.transition(PERIOD_S)
    options = {"motion": {"type": "near_constant_velocity", "velocity_variance_rate": 0.5}, "gate": 1e9}
    for run in range(runs):
        rng = np.random.default_rng(run)
        state = rng.multivariate_normal(np.zeros(5), MOTION.initial_covariance)
        tracker = TRACKERS.build(
            parse(
                TRACKERS.config_of("kalman", "tracker"),
                {**options, "shared_error": "consider", "shared_error_time_s": 1e9, "unlikely_cost": 1e9},
            )
        )
        error = rng.normal(0.0, 0.2, 2)
        for step in range(20):
            if step:
                state = transition @ state + rng.multivariate_normal(np.zeros(5), noise)
            if step % 2 == 0:
                seen = state[:2] + error + rng.normal(0.0, 0.05, 2)
                shared = {"shared_jacobians": jacobian, "shared_covariance": bias}
                tracker.process(detect(step * PERIOD_S, seen, sequence=step, **shared))
            else:
                seen = state[:2] + rng.normal(0.0, 0.15, 2)
                tracker.process(detect(step * PERIOD_S, seen, std=0.15, cue="wall", sequence=step))
        tracks = tracker.tracks()
        off = tracks.means[0, AXES] - state[AXES]
        found.append(off @ np.linalg.solve(tracks.covariances[0][np.ix_(AXES, AXES)], off))
    low, high = chi2.ppf([0.025, 0.975], len(AXES) * runs) / runs
    assert low < np.mean(found) < high
