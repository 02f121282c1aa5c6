"""Random poses and covariances for the tests of core."""

import numpy as np
from hypothesis import strategies as st

from people_fusion.core.poses import Pose, rotation_from_vector


def vectors(limit):
    return st.tuples(*[st.floats(-limit, limit)] * 3).map(np.array)


poses = st.builds(lambda turn, way: Pose(rotation_from_vector(turn), way), vectors(3.0), vectors(10.0))
covariances = st.builds(
    lambda seed, scale: random_covariance(np.random.default_rng(seed), scale), st.integers(0, 999), st.floats(0.01, 1)
)


def random_pose(rng, way=3.0, turn=1.0):
    return Pose(rotation_from_vector(rng.normal(0.0, turn, 3)), rng.normal(0.0, way, 3))


def random_covariance(rng, std=0.1, size=6):
    root = rng.normal(0.0, std, (size, size))
    return root @ root.T / size
