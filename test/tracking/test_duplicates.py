"""Duplicates of one cue are fused without becoming more certain than they are."""

import dataclasses

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from people_fusion.tracking.duplicates import fuse_duplicates


def test_two_detections_of_one_person_become_one_no_more_certain(detect):
    fused = fuse_duplicates(detect(0.0, (1.0, 1.0), (1.02, 1.0), (3.0, 0.0)), threshold=1.5)
    np.testing.assert_allclose(fused.positions[:, :2], [[1.01, 1.0], [3.0, 0.0]])
    np.testing.assert_allclose(fused.covariances[0], np.diag([0.05**2, 0.05**2, 0.0]), atol=1e-12)


def test_detections_apart_are_left_alone(detect):
    measurement = detect(0.0, (1.0, 1.0), (2.0, 1.0))
    assert fuse_duplicates(measurement, threshold=1.5) is measurement


def test_legs_follow_their_fused_owner(detect):
    measurement = detect(0.0, (3.0, 0.0), (1.0, 1.0), (1.02, 1.0))
    legs = np.array([[3.0, 0.1], [1.0, 1.1], [1.0, 0.9], [1.02, 1.0]])
    measurement = dataclasses.replace(measurement, legs=legs, leg_owners=np.array([0, 1, 1, 2]))
    assert fuse_duplicates(measurement, threshold=1.5).leg_owners.tolist() == [0, 1, 1, 1]


@given(seed=st.integers(0, 2**32 - 1))
def test_fused_covariance_is_never_smaller_than_the_smallest(detect, seed):
    rng = np.random.default_rng(seed)
    measurement = detect(0.0, *rng.normal(scale=0.05, size=(4, 2)))
    covariances = measurement.covariances * rng.uniform(0.5, 2.0, size=(4, 1, 1))
    fused = fuse_duplicates(dataclasses.replace(measurement, covariances=covariances), threshold=100.0)
    assert len(fused) == 1
    assert fused.covariances[0, 0, 0] >= covariances[:, 0, 0].min() - 1e-12
