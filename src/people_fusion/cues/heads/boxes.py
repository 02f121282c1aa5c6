"""Boxes in an image, and the overlap of boxes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Boxes(NamedTuple):
    """What a detector found in one image.

    Attributes:
        corners: (N, 4) left, top, right, bottom, pixels; float64, right and bottom exclusive. On a panorama that wraps
            right may exceed its width.
        scores: (N,) the detector's own scale; higher is surer.
        confidences: (N,) in [0, 1], probability that it is what the detector looks for.
    """

    corners: np.ndarray
    scores: np.ndarray
    confidences: np.ndarray

    @staticmethod
    def none() -> Boxes:
        """No boxes."""
        return Boxes(np.zeros((0, 4)), np.zeros(0), np.zeros(0))

    def take(self, rows: np.ndarray) -> Boxes:
        """Some of the boxes, by mask or index."""
        return Boxes(*(column[rows] for column in self))


def overlaps(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N, M) intersection over union of boxes (N, 4) and (M, 4); 0 where both are empty."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    shared = np.clip(high - low, 0.0, None).prod(axis=2)
    areas = [np.clip(boxes[:, 2:] - boxes[:, :2], 0.0, None).prod(axis=1) for boxes in (first, second)]
    union = areas[0][:, None] + areas[1][None, :] - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0.0)
