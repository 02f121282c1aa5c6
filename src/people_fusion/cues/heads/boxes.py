"""Boxes in an image, what they hold, and which of them overlap."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, NamedTuple

import numpy as np

from people_fusion.core.config import parameter


@dataclass(frozen=True)
class BoxConfig:
    """What a detector's boxes hold, in metres (Volkhardt 2013, III-B; Poschmann 2018, 3.1.2)."""

    height: float = parameter(0.25, "of what a box spans, on average over people, metres", low=0.01, high=3.0)
    height_std: float = parameter(0.03, "of that among people and from box to box, metres", low=1e-3)
    head_above: float = parameter(0.0, "middle of the head over the middle of the box, metres", -2.0, 2.0)
    head_above_std: float = parameter(0.03, "of that, metres", low=1e-3)
    across_std: float = parameter(0.04, "of the head sideways of the box's middle, metres", low=1e-3)
    doubt: float = parameter(0.0, "all of these are 1 + doubt (1 - confidence) times as large", low=0.0)

    def widths(self, confidences: np.ndarray) -> np.ndarray:
        """(N,) factors of the standard deviations, of finds with confidences (N,)."""
        return np.asarray(1.0 + self.doubt * (1.0 - confidences))


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
    shared, areas = _shared(first, second), [_areas(boxes) for boxes in (first, second)]
    union = areas[0][:, None] + areas[1][None, :] - shared
    return np.divide(shared, union, out=np.zeros_like(shared), where=union > 0.0)


def parts_of(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N, M) share of boxes (N, 4) that lies within boxes (M, 4) that are no smaller; 0 within those that are."""
    shared, areas = _shared(first, second), [_areas(boxes) for boxes in (first, second)]
    smaller = (areas[0][:, None] <= areas[1][None, :]) & (areas[0][:, None] > 0.0)
    return np.divide(shared, areas[0][:, None], out=np.zeros_like(shared), where=smaller)


def best_of_overlapping(boxes: Boxes, overlap: float, period: float = 0.0, inside: float = 1.0) -> np.ndarray:
    """Indices of the boxes that no better one overlaps by more than `overlap`, the best first; of equals the first.

    Args:
        boxes: N boxes.
        overlap: intersection over union.
        period: width of a panorama that wraps, pixels; 0: none.
        inside: a box of which a larger share lies within a better one that is no smaller goes, too; 1: none.
    """
    covered = np.zeros((len(boxes.scores),) * 2, dtype=bool)
    for turn in (0.0, -period, period) if period else (0.0,):
        others = boxes.corners + [turn, 0.0, turn, 0.0]
        covered |= (overlaps(boxes.corners, others) > overlap) | (parts_of(boxes.corners, others) > inside)
    best: List[int] = []
    for row in np.argsort(-boxes.scores, kind="stable").tolist():
        if not covered[row, best].any():
            best.append(row)
    return np.array(best, dtype=int)


def _shared(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(N, M) area."""
    low = np.maximum(first[:, None, :2], second[None, :, :2])
    high = np.minimum(first[:, None, 2:], second[None, :, 2:])
    return np.asarray(np.clip(high - low, 0.0, None).prod(axis=2))


def _areas(boxes: np.ndarray) -> np.ndarray:
    return np.asarray(np.clip(boxes[:, 2:] - boxes[:, :2], 0.0, None).prod(axis=1))
