"""A single target followed from image to image by how it looks: HST (Poschmann 2018, 5.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.config import parameter, section
from people_fusion.core.errors import DataError
from people_fusion.core.head_scores import HeadScores, ScoreLayer, ScoreWindow
from people_fusion.cues.heads.appearance import AppearanceConfig, learn, length
from people_fusion.cues.heads.fhog import FhogConfig
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow
from people_fusion.cues.heads.native import fhog
from people_fusion.cues.heads.places import Places
from people_fusion.cues.heads.pyramid import Layer, Scales, Windows, refined, score_maps, window_corners

CELLS = 8  # of the window's longer side
SHORTEST = 2  # cells of its shorter side
AGAIN = 1  # cells around what was found, on cells that lie there: parabolas lean towards the cells
EDGE = 1  # cells around the surroundings whose norms the edge alters


@dataclass(frozen=True)
class ShortTermConfig:
    """How a target is followed."""

    reach: float = parameter(1.0, "of the search, in each direction, longer sides of the target", 0.1, 4.0)
    scale_step: float = parameter(1.07, "of the larger and of the smaller search window", 1.001, 2.0)
    appearance: AppearanceConfig = section(lambda: AppearanceConfig(rate=0.1, reach=1.0), "how its looks are learnt")


class ShortTermTracker:
    """See the module. Its window has the target's aspect, which does not change.

    Args:
        config: how is followed.
        grey: (H, W) uint8, the first image.
        box: left, top, right, bottom of the target in it, pixels, as Boxes.corners.
        rng: draws negatives.

    Attributes:
        box: (4,) of the target in the newest image.
        score: of the target in the newest image, before its looks were learnt from that; 1 in the first.

    Raises:
        DataError: the box is empty or not in the image.
    """

    def __init__(self, config: ShortTermConfig, grey: np.ndarray, box: np.ndarray, rng: np.random.Generator) -> None:
        self.config, self._rng = config, rng
        self.box, self.score = np.array(box, dtype=float), 1.0
        width, height = self.box[2:] - self.box[:2]
        rows, cols = grey.shape
        if not (np.isfinite(self.box).all() and min(width, height) >= 1.0):
            raise DataError("target without a size", f"{self.box.tolist()}")
        if self.box[2] <= 0.0 or self.box[3] <= 0.0 or self.box[0] >= cols or self.box[1] >= rows:
            raise DataError("target outside of the image", f"{self.box.tolist()} in {cols} x {rows}")
        sides = np.array([width, height]) / max(width, height) * CELLS
        across, down = np.maximum(np.round(sides), SHORTEST).astype(int).tolist()
        half = 0.5 * across, 0.5 * down  # coordinates are pixels of the window from the target's middle
        self._window = HeadWindow(FhogConfig(), down, across, (-half[0], -half[1], *half))
        self._margin = int(np.ceil(config.reach * CELLS))
        self._camera = Pinhole(width=1, height=1, K=np.eye(3))  # of no meaning here
        self._score_window = ScoreWindow(down, across, self._window.features.cell, self._window.box)
        self._model = np.zeros((1, length(self._score_window, self._window.features.dimensions)), dtype=np.float32)
        self._learn(Scales(grey))

    def update(self, grey: np.ndarray) -> None:
        """Find the target in the next image and learn how it looks there."""
        scales = Scales(grey)
        self._look(scales, self._margin)
        self._look(scales, AGAIN)
        self._learn(scales)

    def _look(self, scales: Scales, margin: int) -> None:
        """Move to the best window at most `margin` cells away, and from there between cells and scales."""
        steps = (1.0 / self.config.scale_step, 1.0, self.config.scale_step)
        layers = [self._layer(scales, number, step, margin) for number, step in enumerate(steps)]
        weights = self._model[0, :-1].reshape(self._window.rows, self._window.cols, -1)
        maps = score_maps(HeadModel(self._window, weights, float(self._model[0, -1]), -1.0, {}), layers)
        best = int(np.argmax([scores.max() for scores in maps]))
        row, col = (int(index) for index in np.unravel_index(np.argmax(maps[best]), maps[best].shape))
        self.score = float(maps[best][row, col])
        places = np.array([best]), np.array([row]), np.array([col])
        corners = window_corners(self._window, layers[best], *places[1:])
        (found,) = refined(self._window, layers, maps, Windows(*places, np.array([self.score]), corners))
        self.box = np.tile(self._middle(), 2) + found * np.tile(self._per_pixel(), 2)

    def _learn(self, scales: Scales) -> None:
        layer = self._layer(scales, 0, 1.0, self._margin)
        windows = np.zeros((2 * self._margin + 1, 2 * self._margin + 1), dtype=np.float32)
        scored = ScoreLayer(layer.scale, layer.row, layer.col, windows, layer.features)
        nobody = np.zeros((0, 4)), np.zeros(0)
        scores = HeadScores(self._camera, self._score_window, -1.0, 1.0, 0.0, 0, (scored,), *nobody)
        here = Places(np.array([0]), np.array([self._margin]), np.array([self._margin]))
        self._model = learn(self._model, scores, here, self.config.appearance, self._rng)

    def _layer(self, scales: Scales, number: int, step: float, margin: int) -> Layer:
        """Cells of the surroundings, in which a target that is `step` times as large as it was fills a window.

        The window where the target was is of whole cells.
        """
        import cv2  # 100 MB: not for those who see no images

        per_pixel = step * self._per_pixel()
        image, shrunk = scales.at(0.5 ** max(int(np.floor(np.log2(per_pixel.max()))), 0))
        cells = np.array([self._window.cols, self._window.rows]) + 2 * (margin + EDGE)
        size, stride = cells * self._window.features.cell, per_pixel * shrunk
        # The middles of pixels are at halves.
        start = self._middle() * shrunk - 0.5 * size * stride + 0.5 * stride - 0.5
        affine, flags = np.column_stack([np.diag(stride), start]), cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        pixels = cv2.warpAffine(image, affine, tuple(size.tolist()), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        features = np.ascontiguousarray(fhog(pixels, self._window.features)[EDGE:-EDGE, EDGE:-EDGE])
        return Layer(number, np.full(2, 1.0 / step), -margin, -margin, features)

    def _middle(self) -> np.ndarray:
        return 0.5 * (self.box[:2] + self.box[2:])

    def _per_pixel(self) -> np.ndarray:
        """(2,) pixels of the image of one of the window, across and down."""
        window = np.array([self._window.cols, self._window.rows]) * self._window.features.cell
        return np.asarray((self.box[2:] - self.box[:2]) / window)
