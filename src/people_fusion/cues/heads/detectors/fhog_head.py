"""Heads by a linear SVM on FHOG cells (Poschmann 2018, chapter 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, List, Optional, Tuple

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.head_scores import FEATURES, NO_SCORES, HeadScores, ScoreLayer, ScoreWindow
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import BoxConfig, Boxes
from people_fusion.cues.heads.detector import DETECTORS, Detector, Search, gathered
from people_fusion.cues.heads.head_model import load_head_model
from people_fusion.cues.heads.native import Scorer, is_native
from people_fusion.cues.heads.pyramid import LAYERS, OVERLAP, Layer, best, candidates, refined, searched_pyramid

INSIDE = 0.5  # of a find within a better, larger one: a face, an ear, not another head


@dataclass(frozen=True)
class FhogHeadConfig:
    """Heads, whole, from all sides that the model was trained on."""

    model: str = parameter("heads", "of config/models, or an npz file that train_heads wrote")
    threshold: float = parameter(-0.25, "of scores; 0 is as likely a head as not", -10.0, 10.0)
    enlarge: float = parameter(1.0, "of the image at most, for heads of fewer rows than the model has", 1.0, 4.0)
    layers: int = parameter(LAYERS, "scales an octave; more find sizes between at more cost", 1, 16)
    box: BoxConfig = section(
        lambda: BoxConfig(
            height=0.245, height_std=0.018, head_above=-0.01, head_above_std=0.01, across_std=0.008, doubt=4.0
        ),
        "what a box holds",
    )


@DETECTORS.register("fhog_head", FhogHeadConfig)
class FhogHead(Detector):
    """Heads as high as the model's window and higher, and lower ones in enlarged images.

    Attributes:
        is_native: whether the kernel is built; without it NumPy is many times slower.
    """

    part: ClassVar[str] = "head"

    def __init__(self, config: FhogHeadConfig) -> None:
        self.config, self.box = config, config.box
        self.model = load_head_model(config.model)
        self.is_native = is_native()
        self._scorer = Scorer([self.model])
        self._seen: Optional[Tuple[int, List[Layer], List[np.ndarray]]] = None

    def detect(self, image: Image, search: Search) -> Boxes:
        """See Detector."""
        window, grey, beyond = self.model.window, image.grey, 0
        if image.camera.wraps and len(search.heights):  # the way round goes on beyond both ends of the image
            highest = min(float(search.heights[:, 1].max()), float(grey.shape[0]))
            beyond = math.ceil(highest / window.head_height * max(window.cols, window.rows) * window.features.cell)
            grey = grey.take(np.arange(-beyond, grey.shape[1] + beyond), axis=1, mode="wrap")
        shift = np.array([beyond, 0.0, beyond, 0.0])
        wanted = search._replace(corners=search.corners + shift)
        cells = searched_pyramid(grey, window, wanted, self.config.layers, self.config.enlarge)
        scores = [self._scorer.scores(layer.features)[0] for layer in cells]
        self._seen = (beyond, cells, scores) if self.wanted_scores != NO_SCORES else None
        windows = candidates(window, cells, scores, self.config.threshold)
        windows = windows.take(best(windows))
        corners = refined(window, cells, scores, windows) - shift
        rows, cols = image.grey.shape
        corners[:, [1, 3]] = np.clip(corners[:, [1, 3]], 0.0, rows)
        if not image.camera.wraps:
            corners[:, [0, 2]] = np.clip(corners[:, [0, 2]], 0.0, cols)
        finds = Boxes(corners, windows.scores.astype(float), self.model.confidences(windows.scores))
        return gathered([finds], image, search, OVERLAP, INSIDE)

    def scores(self, image: Image, boxes: Boxes) -> Optional[HeadScores]:
        """See Detector."""
        if self._seen is None:
            return None
        beyond, cells, scores = self._seen
        window, with_features = self.model.window, self.wanted_scores == FEATURES
        nothing = np.zeros((0, 0, window.features.dimensions), dtype=np.float32)
        return HeadScores(
            camera=image.camera,
            window=ScoreWindow(window.rows, window.cols, window.features.cell, window.box),
            platt_slope=self.model.platt_slope,
            height=self.box.height,
            head_above=self.box.head_above,
            beyond=beyond,
            layers=tuple(
                ScoreLayer(layer.scale, layer.row, layer.col, here, layer.features if with_features else nothing)
                for layer, here in zip(cells, scores)
                if here.size
            ),
            corners=boxes.corners,
            box_scores=boxes.scores,
        )

    def reset(self) -> None:
        """See Detector."""
        self._seen = None
