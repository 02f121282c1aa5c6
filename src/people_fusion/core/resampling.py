"""Drawing particles anew in proportion to their weights."""

from __future__ import annotations

import numpy as np


def systematic(weights: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Systematic resampling: of each row's particles those that N evenly spaced marks fall on (Kitagawa 1996).

    A particle of weight w is drawn floor(N w) or ceil(N w) times, on average N w; one of weight zero never.

    Args:
        weights: (T, N) not negative, each row's sum positive; they need not sum to 1.
        offsets: (T,) of the marks, in [0, 1) of the space between two.

    Returns:
        (T, N) indices along a row, ascending.
    """
    tracks, count = weights.shape
    cumulative = np.cumsum(weights, axis=1)
    cumulative = cumulative / cumulative[:, -1:]
    # How many of the marks (k + offset) / N lie below; all of them below the end, whatever rounding makes of it.
    below = np.where(cumulative < 1.0, np.ceil(cumulative * count - offsets[:, None]), count)
    times = np.diff(below, axis=1, prepend=0.0).astype(int)
    return np.repeat(np.tile(np.arange(count), tracks), times.ravel()).reshape(tracks, count)
