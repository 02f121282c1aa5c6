"""What a head detector's model says of every window of an image, to weigh particles by (Poschmann 2018, 7.2.3).

No threshold has been applied: a head that no detector reports still scores higher than what is beside it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import NamedTuple, Tuple

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.core.poses import Pose

NO_SCORES, SCORES, FEATURES = "none", "scores", "features"  # what a tracker may want of an image


class ScoreWindow(NamedTuple):
    """What is scored: a window of cells, and where in it the head is.

    Attributes:
        rows, cols: cells of the window.
        cell: edge of a cell, pixels of its layer.
        box: left, top, right, bottom of the head's box, in cells from the window's upper left.
    """

    rows: int
    cols: int
    cell: int
    box: Tuple[float, float, float, float]

    @property
    def head_height(self) -> float:
        """Height of the head's box in pixels of its layer."""
        return (self.box[3] - self.box[1]) * self.cell


class ScoreLayer(NamedTuple):
    """Scores of a piece of the image at one scale.

    Attributes:
        scale: (2,) the layer's pixels per pixel of the image, across and down.
        row, col: cell of the layer that is the upper left one of the first window.
        scores: (R, C) float32, of the window whose upper left cell is (row + r, col + c).
        features: (R + rows - 1, C + cols - 1, D) float32 cells that the windows are made of; (0, 0, D) where they were
            not asked for.
    """

    scale: np.ndarray
    row: int
    col: int
    scores: np.ndarray
    features: np.ndarray


@dataclass(frozen=True, eq=False)
class HeadScores:
    """Scores of one image.

    Attributes:
        camera: that took the image.
        window: what is scored.
        platt_slope: a of eq. 4.2, negative; b is 0.
        height, head_above: of what a box spans, and the head's middle over the box's middle, metres (as BoxConfig).
        beyond: columns of the image's pixels that the layers begin left of the image; a panorama that wraps goes on
            beyond both ends.
        layers: the scales, finest first.
        corners: (N, 4) boxes of the measurement's detections, pixels, as the detector gives them.
        box_scores: (N,) their scores.
        pose: the measurement's frame from the camera's optical frame; identity in the camera's own.
        pose_covariance: (6, 6) error of `pose` that is fresh in each measurement, see core.poses.
    """

    camera: Camera
    window: ScoreWindow
    platt_slope: float
    height: float
    head_above: float
    beyond: int
    layers: Tuple[ScoreLayer, ...]
    corners: np.ndarray
    box_scores: np.ndarray
    pose: Pose = field(default_factory=Pose.identity)
    pose_covariance: np.ndarray = field(default_factory=lambda: np.zeros((6, 6)))

    @property
    def has_features(self) -> bool:
        """Whether other models can be scored on the same cells."""
        return bool(self.layers) and all(layer.features.size > 0 for layer in self.layers)

    def select(self, rows: np.ndarray) -> HeadScores:
        """The same image with some of the detections, by mask or index."""
        return dataclasses.replace(self, corners=self.corners[rows], box_scores=self.box_scores[rows])
