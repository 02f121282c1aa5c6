import math

import numpy as np

from people_fusion.core.angles import bearings


def test_bearings_point_where_the_vectors_do():
    vectors = np.array([[1.0, 0.0, 9.0], [0.0, 2.0, 9.0], [-1.0, 0.0, 9.0], [-1.0, -1.0, 9.0]])
    np.testing.assert_allclose(bearings(vectors), [0.0, math.pi / 2, math.pi, -0.75 * math.pi])
    assert bearings(np.zeros((0, 2))).shape == (0,)
