import numpy as np
import pytest

from people_fusion.filtering.kalman import consider_fading


@pytest.mark.parametrize("seed", range(20))
def test_considered_error_of_another_shape_leaves_a_covariance(seed):
    rng = np.random.default_rng(seed)
    roots = rng.normal(size=(10, 10))
    joint = roots @ roots.T
    states, cross, before = joint[:4, :4], joint[:4, 4:], joint[4:, 4:]
    known = 6 if seed % 2 else 3  # a robot in the plane has no error of height, roll and pitch
    now = np.zeros((6, 6))
    roots = rng.normal(size=(known, known)) * 10.0 ** rng.uniform(-2, 1)
    now[:known, :known] = roots @ roots.T
    fading = consider_fading(before, now)
    carried = np.block([[states, cross @ fading.T], [fading @ cross.T, now]])
    assert np.linalg.eigvalsh(carried)[0] > -1e-9 * np.trace(carried)


def test_considered_error_that_does_not_shrink_is_kept():
    before = np.diag([1.0, 2.0, 0.0, 0.0, 0.0, 0.5])
    np.testing.assert_allclose(consider_fading(before, 1.5 * before) @ before, before, atol=1e-12)
    assert not consider_fading(before, np.zeros((6, 6))).any()
