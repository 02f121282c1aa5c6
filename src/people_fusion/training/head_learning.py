"""Learning a head model from photographs: random negatives, then rounds of hard ones (Poschmann 2018, 4.4, 4.5.2).

Photographs are not mirrored. A model that has learned from all examples and their mirror images is its own mirror
image, so each example is folded along the window's middle instead: the same model from a quarter of the numbers.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Callable, Iterable, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.errors import DataError
from people_fusion.cues.heads.boxes import Boxes, overlaps
from people_fusion.cues.heads.fhog import FhogConfig
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow
from people_fusion.cues.heads.pyramid import (
    Layer,
    Windows,
    best,
    candidates,
    pyramid,
    refined,
    score_maps,
    window_corners,
    window_features,
)
from people_fusion.training.head_sources import Photograph, considered, squares
from people_fusion.training.head_svm import Svm, train_svm

UNCALIBRATED = -1.0  # Platt slope of a model that is not finished
NOWHERE = np.zeros(4)


@dataclass(frozen=True)
class LearningConfig:
    """How a model is learned."""

    penalty: float = parameter(10.0, "C of the support vector machine", low=1e-9)
    rounds: int = parameter(3, "of hard negatives", low=0, high=20)
    random_negatives: int = parameter(20, "of an image, before the first round", low=1)
    hard_negatives: int = parameter(100, "of an image and round, at most", low=1)
    hard_score: float = parameter(-1.0, "least score of a hard negative")
    apart: float = parameter(0.3, "largest overlap of a negative with anything that is marked", 0.0, 1.0)
    doubtful: float = parameter(
        0.9, "what scores higher than this share of the positives may be a head that nobody has marked", 0.0, 1.0
    )
    near: float = parameter(0.75, "least overlap of a positive window with the head's box", 0.1, 1.0)


class Example(NamedTuple):
    """A photograph as a detector sees it.

    Attributes:
        layers: its pyramid.
        truth: (N, 4) squares about all heads that are marked.
        considered: (N,) which of them count.
    """

    layers: List[Layer]
    truth: np.ndarray
    considered: np.ndarray


def example(image: Photograph, window: HeadWindow, classes: Sequence[str], least: float) -> Example:
    """A photograph's cells, and which of its heads count: of these classes and of at least so many pixels."""
    layers = pyramid(image.grey, window, least, float(image.grey.shape[0]))
    return Example(layers, squares(image.boxes), considered(image, classes, least))


def found(model: HeadModel, seen: Example, threshold: float) -> Tuple[Windows, Boxes]:
    """A model's detections in a photograph: the windows, the best first, and their refined boxes."""
    scores = score_maps(model, seen.layers)
    windows = candidates(model.window, seen.layers, scores, threshold)
    windows = windows.take(best(windows))
    corners = refined(model.window, seen.layers, scores, windows)
    return windows, Boxes(corners, windows.scores.astype(float), model.confidences(windows.scores))


class Mirror:
    """Examples folded along the middle of a window, and weights unfolded again.

    Args:
        window: symmetric.
    """

    def __init__(self, window: HeadWindow) -> None:
        self._shape = (window.rows, window.cols, window.features.dimensions)
        here = np.arange(int(np.prod(self._shape))).reshape(self._shape)
        there = here[:, ::-1][:, :, mirrored_cell(window.features)].ravel()
        self._here = here.ravel()[here.ravel() <= there]
        self._there = there[self._here]
        self._share = np.where(self._here == self._there, 0.5, np.sqrt(0.5)).astype(np.float32)

    def fold(self, cells: np.ndarray) -> np.ndarray:
        """(N, E) of windows' cells (N, rows, cols, D)."""
        flat = cells.reshape(len(cells), int(np.prod(self._shape)))
        return np.asarray((flat[:, self._here] + flat[:, self._there]) * self._share)

    def unfold(self, weights: np.ndarray) -> np.ndarray:
        """(rows, cols, D) weights that give the same scores as these (E,) on folded examples."""
        flat = np.zeros(int(np.prod(self._shape)))
        for half in (self._here, self._there):
            flat[half] += weights * self._share
        return flat.reshape(self._shape).astype(np.float32)


def mirrored_cell(features: FhogConfig) -> np.ndarray:
    """(D,) which entry of a cell's descriptor stands where when the image is mirrored."""
    directions, bins = np.arange(2 * features.bins), features.bins
    parts = [(bins - directions) % (2 * bins)] if features.signed else []
    if features.unsigned:
        parts.append(2 * bins * features.signed + (bins - directions[:bins]) % bins)
    return np.concatenate([*parts, features.dimensions - 4 + np.array([1, 0, 3, 2])])


def learn(
    examples: Sequence[Example],
    window: HeadWindow,
    config: LearningConfig,
    generator: np.random.Generator,
    told: Optional[Callable[[int, HeadModel], None]] = None,
) -> HeadModel:
    """A model of the heads that count in some photographs; its sigmoid is still to be calibrated.

    Args:
        examples: the photographs.
        window: what the model looks at; symmetric.
        config: how.
        generator: of the random negatives.
        told: called with the number of hard rounds and the model after each.

    Raises:
        DataError: there are no heads, or nothing else.
    """
    mirror = Mirror(window)

    def folded(windows: Callable[[Example], Windows]) -> np.ndarray:
        cells = (window_features(windows(entry), entry.layers, window) for entry in examples)
        return np.concatenate([mirror.fold(part) for part in cells])

    if not examples:
        raise DataError("no photographs to learn from")
    positives = folded(lambda entry: near_heads(entry, window, config.near))
    negatives = folded(lambda entry: random_negatives(entry, window, config, generator))
    svm: Optional[Svm] = None
    for number in range(config.rounds + 1):
        svm = train_svm(positives, negatives, config.penalty, svm)
        model = HeadModel(window, mirror.unfold(svm.weights), svm.bias, UNCALIBRATED, {})
        if told is not None:
            told(number, model)
        if number < config.rounds:
            doubtful = float(np.quantile(svm.scores(positives), config.doubtful))
            negatives = np.concatenate([negatives, folded(partial(hard_negatives, model, config, doubtful))])
    return model


def near_heads(seen: Example, window: HeadWindow, near: float) -> Windows:
    """Positives: of each head that counts the window that overlaps it most, and all that overlap it by `near`.

    They come from the pyramid, as those do that the detector will see, not from the head's own scale and place.
    """
    chosen = [nothing()]
    middle_cell = 0.5 * (np.array(window.box[:2]) + window.box[2:])
    steps = np.arange(-1, 2)
    for box in seen.truth[seen.considered]:
        several = [nothing()]
        for index, layer in enumerate(seen.layers):
            place = 0.5 * (box[:2] + box[2:]) * layer.scale / window.features.cell - middle_cell
            col, row = np.round(place).astype(int).tolist()
            rows, cols = (grid.ravel() for grid in np.meshgrid(row + steps, col + steps, indexing="ij"))
            height, width = layer.features.shape[:2]
            inside = (rows >= 0) & (cols >= 0) & (rows <= height - window.rows) & (cols <= width - window.cols)
            several.append(windows_at(window, seen.layers, index, rows[inside], cols[inside], box))
        here = joined(several)
        if len(here.scores):
            chosen.append(here.take((here.scores >= near) | (np.arange(len(here.scores)) == np.argmax(here.scores))))
    return joined(chosen)


def random_negatives(
    seen: Example, window: HeadWindow, config: LearningConfig, generator: np.random.Generator
) -> Windows:
    """Windows anywhere in the pyramid that do not overlap what is marked, all sizes alike."""
    if not seen.layers:
        return nothing()
    chosen = [nothing()]
    for index in generator.integers(len(seen.layers), size=2 * config.random_negatives).tolist():
        height, width = seen.layers[index].features.shape[:2]
        row, col = generator.integers([height - window.rows + 1, width - window.cols + 1])
        chosen.append(windows_at(window, seen.layers, index, np.array([row]), np.array([col])))
    several = joined(chosen)
    return several.take(np.flatnonzero(_apart(several.corners, seen, config.apart))[: config.random_negatives])


def hard_negatives(model: HeadModel, config: LearningConfig, doubtful: float, seen: Example) -> Windows:
    """The model's best detections that overlap nothing marked and do not score so high that they may be heads."""
    windows, _ = found(model, seen, config.hard_score)
    false = _apart(windows.corners, seen, config.apart) & (windows.scores < doubtful)
    return windows.take(np.flatnonzero(false)[: config.hard_negatives])


def windows_at(
    window: HeadWindow,
    layers: Sequence[Layer],
    index: int,
    rows: np.ndarray,
    cols: np.ndarray,
    box: np.ndarray = NOWHERE,
) -> Windows:
    """Windows at cells (N,) of a layer; their scores are the overlap with a box."""
    corners = window_corners(window, layers[index], rows, cols)
    return Windows(np.full(len(rows), index), rows, cols, overlaps(corners, box[None])[:, 0], corners)


def joined(several: Iterable[Windows]) -> Windows:
    """Windows of one pyramid as one."""
    return Windows(*(np.concatenate(columns) for columns in zip(*several)))


def nothing() -> Windows:
    """No windows."""
    none = np.zeros(0, dtype=int)
    return Windows(none, none, none, np.zeros(0), np.zeros((0, 4)))


def _apart(corners: np.ndarray, seen: Example, apart: float) -> np.ndarray:
    """(N,) which boxes overlap nothing by more than `apart`."""
    return np.asarray((overlaps(corners, seen.truth) <= apart).all(axis=1))
