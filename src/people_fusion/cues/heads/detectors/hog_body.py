"""Whole bodies by OpenCV's HOG people detector (Dalal & Triggs 2005), as Volkhardt 2013, III-A 1 does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, List

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import BoxConfig, Boxes, overlaps
from people_fusion.cues.heads.detector import DETECTORS, Crop, Detector, Search, crops, gathered

WINDOW = (64, 128)  # columns and rows that the SVM looks at
PERSON = (40.0, 96.0)  # of those, the ones that a person fills
STRIDE, PADDING = 8, 16  # pixels; the padding is the window's margin above and below a person
SAME = 0.5  # intersection over union from which two windows see the same person
OVERLAP = 0.4


@dataclass(frozen=True)
class HogBodyConfig:
    """Whole standing people."""

    step: float = parameter(1.1, "from one size to the next", low=1.01)
    enlarge: float = parameter(1.0, "of the image at most; people of 96 rows are found without", 1.0, 4.0)
    threshold: float = parameter(0.0, "of the SVM's response, from which a window is a find")
    agree: int = parameter(2, "windows that must see the same", low=1)
    score_at_half: float = parameter(0.7, "response of finds half of which are people")
    score_scale: float = parameter(0.3, "of the responses about that", low=1e-3)
    confidence: float = parameter(0.9, "at most, however high the response", 0.0, 1.0)
    box: BoxConfig = section(
        lambda: BoxConfig(height=1.75, height_std=0.14, head_above=0.78, head_above_std=0.08, across_std=0.08),
        "what a box holds",
    )


@DETECTORS.register("hog_body", HogBodyConfig)
class HogBody(Detector):
    """Histograms of oriented gradients in windows of a pyramid. Its score is the SVM's response.

    Boxes are those of the person within the window. Several windows see each person; the box is their mean, weighted
    by their responses, which says its size better than the coarse pyramid does.
    """

    part: ClassVar[str] = "body"

    def __init__(self, config: HogBodyConfig) -> None:
        import cv2  # 100 MB: not for those who see no images

        self.config, self.box = config, config.box
        self._hog = cv2.HOGDescriptor()
        self._hog.setSVMDetector(cv2.HOGDescriptor.getDefaultPeopleDetector())

    def detect(self, image: Image, search: Search) -> Boxes:
        """See Detector."""
        step = self.config.step
        neighbours_too = search._replace(heights=search.heights * [1.0 / step, step])
        finds = [Boxes.none()]
        for crop in crops(image, neighbours_too, WINDOW[1] / PERSON[1]):
            finds += [self._level(crop, float(scale)) for scale in self._scales(crop)]
        boxes = Boxes(*(np.concatenate(columns) for columns in zip(*finds)))
        return gathered([self._merged(boxes)], image, search, OVERLAP)

    def _scales(self, crop: Crop) -> np.ndarray:
        """Powers of the step, whatever is searched, at which a person is of a size that is wanted."""
        least, largest = crop.heights[0] / PERSON[1], min(crop.heights[1], crop.grey.shape[0]) / PERSON[1]
        sizes = np.array([max(least, 1.0 / self.config.enlarge), max(largest, 1e-6)])
        first, end = np.ceil(np.log(sizes) / np.log(self.config.step) - 1e-9)
        return np.asarray(self.config.step ** np.arange(first, end))

    def _level(self, crop: Crop, scale: float) -> Boxes:
        import cv2

        rows, columns = (max(round(edge / scale), 1) for edge in crop.grey.shape)
        if columns + 2 * PADDING < WINDOW[0] or rows + 2 * PADDING < WINDOW[1]:  # OpenCV would crash
            return Boxes.none()
        grey = crop.grey
        if (rows, columns) != grey.shape:
            grey = cv2.resize(grey, (columns, rows), interpolation=cv2.INTER_LINEAR)
        places, responses = self._hog.detect(grey, self.config.threshold, (STRIDE, STRIDE), (PADDING, PADDING))
        if not len(places):
            return Boxes.none()
        scores = np.ravel(np.asarray(responses, dtype=float))
        ratios = np.array([crop.grey.shape[1] / columns, crop.grey.shape[0] / rows])
        middles = np.asarray(places, dtype=float).reshape(-1, 2) + 0.5 * np.array(WINDOW)
        half = 0.5 * np.array(PERSON)
        corners = np.hstack([(middles - half) * ratios, (middles + half) * ratios])
        return Boxes(corners + [crop.left, crop.top, crop.left, crop.top], scores, np.zeros(len(scores)))

    def _merged(self, boxes: Boxes) -> Boxes:
        """The best of windows that see the same, with the mean of their places."""
        config = self.config
        groups: List[np.ndarray] = []
        same = overlaps(boxes.corners, boxes.corners) > SAME
        free = np.ones(len(boxes.scores), dtype=bool)
        for row in np.argsort(-boxes.scores, kind="stable"):
            if not free[row]:
                continue
            members = np.flatnonzero(same[row] & free)
            free[members] = False
            if len(members) >= config.agree:
                groups.append(members)
        corners: List[np.ndarray] = []
        for members in groups:
            weights = boxes.scores[members] - config.threshold + 1e-3
            corners.append(weights @ boxes.corners[members] / weights.sum())
        scores = np.array([boxes.scores[members].max() for members in groups])
        doubt = 1.0 + np.exp(-np.clip((scores - config.score_at_half) / config.score_scale, -50.0, 50.0))
        return Boxes(np.array(corners).reshape(-1, 4), scores, config.confidence / doubt)
