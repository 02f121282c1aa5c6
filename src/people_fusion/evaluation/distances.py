"""How far apart a person and a track are: on the floor, or by the boxes that they fill in an image."""

from __future__ import annotations

from typing import Callable, Optional

import numpy as np

from people_fusion.evaluation.truth import Estimates, Truth

# Of rows of truth and rows of estimates, which are broadcast against each other.
Distance = Callable[[np.ndarray, np.ndarray], np.ndarray]

IMAGE_THRESHOLD = 0.75  # Volkhardt et al. 2013, IV: boxes match from an overlap of 0.25 on


def on_the_floor(truth: Truth, estimates: Estimates) -> Distance:
    """Metres in the ground plane."""
    points, means = truth.points, estimates.points

    def distance(truth_rows: np.ndarray, estimate_rows: np.ndarray) -> np.ndarray:
        offsets = points[truth_rows] - means[estimate_rows]
        return np.asarray(np.hypot(offsets[..., 0], offsets[..., 1]))

    return distance


def in_the_image(truth_boxes: np.ndarray, estimate_boxes: np.ndarray, period: Optional[float] = None) -> Distance:
    """One minus intersection over union (Volkhardt et al. 2013, IV): 0 for the same box, 1 for boxes side by side.

    Args:
        truth_boxes, estimate_boxes: (N, 4) and (M, 4) left, top, right, bottom of each row, pixels.
        period: width of an image that wraps; None: it does not.
    """

    def distance(truth_rows: np.ndarray, estimate_rows: np.ndarray) -> np.ndarray:
        people, tracks = truth_boxes[truth_rows], estimate_boxes[estimate_rows]
        shift = np.zeros(1)
        if period is not None:
            apart = 0.5 * (people[..., 0] + people[..., 2] - tracks[..., 0] - tracks[..., 2])
            shift = period * np.round(apart / period)
        lefts = np.maximum(people[..., 0], tracks[..., 0] + shift)
        rights = np.minimum(people[..., 2], tracks[..., 2] + shift)
        tops, bottoms = np.maximum(people[..., 1], tracks[..., 1]), np.minimum(people[..., 3], tracks[..., 3])
        common = np.maximum(rights - lefts, 0.0) * np.maximum(bottoms - tops, 0.0)
        return np.asarray(1.0 - common / (_areas(people) + _areas(tracks) - common))

    return distance


def _areas(boxes: np.ndarray) -> np.ndarray:
    return np.asarray((boxes[..., 2] - boxes[..., 0]) * (boxes[..., 3] - boxes[..., 1]))
