"""Angles of vectors, the same on every repetition."""

from __future__ import annotations

import numpy as np


def bearings(vectors: np.ndarray) -> np.ndarray:
    """(N,) direction of vectors (N, 2) or longer in the xy plane, radians in (-pi, pi].

    NumPy computes arctan2 with another routine where columns of an array happen to lie close to the result in memory,
    and the last bit differs; copies never do.
    """
    x, y = np.array(vectors[:, :2].T)
    return np.arctan2(y, x)
