"""Heads at all sizes: cells of an image in many scales, the windows that a model takes for heads, the best of them."""

from __future__ import annotations

from typing import List, NamedTuple, Sequence, Tuple

import numpy as np

from people_fusion.cues.heads.boxes import Boxes, overlaps
from people_fusion.cues.heads.detector import Search
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow
from people_fusion.cues.heads.native import Scorer, fhog

LAYERS = 5  # an octave
MARGIN = 2  # cells around a piece, whose gradients or norms its edge alters
OVERLAP = 0.3  # of two windows of which only the better stays (Poschmann 2018, 4.2)


class Layer(NamedTuple):
    """Cells of a piece of the image at one scale.

    Attributes:
        number: of the scale; at 0 the image is as it is, below it is enlarged.
        scale: (2,) the layer's pixels per pixel of the image, across and down.
        row, col: of the piece's first cell, in the layer's cells.
        features: (R, C, D).
    """

    number: int
    scale: np.ndarray
    row: int
    col: int
    features: np.ndarray


class Windows(NamedTuple):
    """Windows of a pyramid.

    Attributes:
        layers: (N,) which entry of the pyramid.
        rows, cols: (N,) upper left cell within that layer's features.
        scores: (N,) of the model.
        corners: (N, 4) the head's box in the image's pixels, as Boxes.corners.
    """

    layers: np.ndarray
    rows: np.ndarray
    cols: np.ndarray
    scores: np.ndarray
    corners: np.ndarray

    def take(self, which: np.ndarray) -> Windows:
        """Some of them, by mask or index."""
        return Windows(*(column[which] for column in self))


class Scales:
    """One image at many scales, each made when it is first asked for.

    Args:
        grey: (H, W) uint8.
    """

    def __init__(self, grey: np.ndarray) -> None:
        self._octaves = [grey]

    def at(self, scale: float) -> Tuple[np.ndarray, np.ndarray]:
        """The image at a scale, and by how much it is so exactly, (2,) across and down."""
        import cv2  # 100 MB: not for those who see no images

        octave = 0
        while scale <= 0.5:
            scale, octave = 2.0 * scale, octave + 1
        while len(self._octaves) <= octave:
            last = self._octaves[-1]
            rows, cols = last.shape[0] // 2, last.shape[1] // 2
            half = last[: 2 * rows, : 2 * cols]
            self._octaves.append(cv2.resize(half, (cols, rows), interpolation=cv2.INTER_AREA) if half.size else half)
        grey = self._octaves[octave]
        rows, cols = (round(scale * edge) for edge in grey.shape)
        if (rows, cols) == grey.shape or not rows or not cols:
            return grey[:rows, :cols], np.full(2, 0.5**octave)
        smaller = cv2.resize(grey, (cols, rows), interpolation=cv2.INTER_LINEAR)
        return smaller, 0.5**octave * np.array([cols / grey.shape[1], rows / grey.shape[0]])


def head_numbers(
    window: HeadWindow, least: float, largest: float, layers: int = LAYERS, enlarge: float = 1.0
) -> np.ndarray:
    """(L,) numbers of the scales at which heads from `least` to `largest` pixels are found, `layers` of them an octave.

    At scale 0 the image is as it is, and heads that fill the window are found; below it is enlarged, by `enlarge` at
    most. Which scales there are does not depend on what is looked for.
    """
    first, last = layers * np.log2(np.maximum([least, largest], 1e-6) / window.head_height)
    lowest = -np.floor(layers * np.log2(enlarge) + 1e-9)
    return np.arange(max(np.ceil(first - 0.5), lowest), np.floor(last + 0.5) + 1, dtype=int)


def pyramid(grey: np.ndarray, window: HeadWindow, least: float, largest: float, layers: int = LAYERS) -> List[Layer]:
    """Cells of the whole image at all scales at which the window fits into it.

    Args:
        grey: (H, W) uint8.
        window: whose cells and size.
        least, largest: height of heads, pixels.
        layers: scales an octave.
    """
    scales, found = Scales(grey), []
    for number in head_numbers(window, least, min(largest, grey.shape[0]), layers).tolist():
        smaller, scale = scales.at(0.5 ** (number / layers))
        features = fhog(smaller, window.features)
        if features.shape[0] >= window.rows and features.shape[1] >= window.cols:
            found.append(Layer(number, scale, 0, 0, features))
    return found


def searched_pyramid(
    grey: np.ndarray, window: HeadWindow, search: Search, layers: int = LAYERS, enlarge: float = 1.0
) -> List[Layer]:
    """Cells of the pieces of the image in which heads are wanted, at the scales at which they are; each cell once.

    What is scored there is as in the whole image's pyramid, but for windows that are not wanted.

    Args:
        grey: (H, W) uint8.
        window: whose cells and size.
        search: where heads may be, by the middle of their boxes, and how high.
        layers: scales an octave.
        enlarge: of the image at most.
    """
    if not len(search.corners):
        return []
    scales, found = Scales(grey), []
    least, largest = search.heights[:, 0].min(), min(search.heights[:, 1].max(), grey.shape[0])
    nearly = 2.0 ** (0.5 / layers)
    for number in head_numbers(window, least, largest, layers, enlarge).tolist():
        height = window.head_height * 2.0 ** (number / layers)
        wanted = (search.heights[:, 0] <= height * nearly) & (search.heights[:, 1] >= height / nearly)
        smaller, scale = scales.at(0.5 ** (number / layers))
        for left, top, right, bottom in _pieces(window, search.corners[wanted] * np.tile(scale, 2), smaller.shape):
            if bottom - top >= window.rows and right - left >= window.cols:
                cell = window.features.cell
                piece = smaller[top * cell : bottom * cell, left * cell : right * cell]
                found.append(Layer(number, scale, top, left, fhog(piece, window.features)))
    return found


def _pieces(window: HeadWindow, regions: np.ndarray, shape: Tuple[int, ...]) -> List[Tuple[int, int, int, int]]:
    """Left, top, right, bottom, in whole cells, of pieces that hold all windows whose head's middle is in a region."""
    middle = 0.5 * (np.array(window.box[:2]) + window.box[2:])
    low = np.floor(regions[:, :2] / window.features.cell - middle) - MARGIN
    high = np.ceil(regions[:, 2:] / window.features.cell - middle) + [window.cols + MARGIN, window.rows + MARGIN]
    limit = np.array([shape[1], shape[0]]) // window.features.cell
    pieces: List[Tuple[int, int, int, int]] = []
    for piece in np.hstack([np.clip(low, 0, limit), np.clip(high, 0, limit)]).astype(int).tolist():
        joined = tuple(piece)
        for other in list(pieces):
            both = (*map(min, joined[:2], other[:2]), *map(max, joined[2:], other[2:]))
            if _area(both) <= _area(joined) + _area(other):  # the windows in two pieces would be looked at twice
                pieces.remove(other)
                joined = both
        pieces.append(joined)
    return pieces


def _area(piece: Tuple[int, ...]) -> int:
    return (piece[2] - piece[0]) * (piece[3] - piece[1])


def score_maps(model: HeadModel, layers: Sequence[Layer]) -> List[np.ndarray]:
    """Of each layer, the model's score of every window (R - rows + 1, C - cols + 1)."""
    scorer = Scorer([model])
    return [scorer.scores(layer.features)[0] for layer in layers]


def candidates(window: HeadWindow, layers: Sequence[Layer], scores: Sequence[np.ndarray], threshold: float) -> Windows:
    """All windows with a score above a threshold, before any of those that overlap is suppressed.

    Args:
        window: of the model.
        layers: a pyramid.
        scores: of its windows (`score_maps`).
        threshold: in the model's scores.
    """
    found = [_no_windows()]
    for index, (layer, here) in enumerate(zip(layers, scores)):
        rows, cols = np.nonzero(here > threshold)
        corners = window_corners(window, layer, rows, cols)
        found.append(Windows(np.full(len(rows), index), rows, cols, here[rows, cols], corners))
    return Windows(*(np.concatenate(columns) for columns in zip(*found)))


def window_corners(window: HeadWindow, layer: Layer, rows: np.ndarray, cols: np.ndarray) -> np.ndarray:
    """(N, 4) boxes of heads in the image's pixels, for windows at cells (N,) of a layer, whole or not."""
    places = np.stack([cols + layer.col, rows + layer.row] * 2, axis=-1) + np.array(window.box)
    return places * window.features.cell / np.tile(layer.scale, 2)


def window_features(windows: Windows, layers: Sequence[Layer], window: HeadWindow) -> np.ndarray:
    """(N, rows, cols, D) cells of windows."""
    shape = (window.rows, window.cols, window.features.dimensions)
    cut = [
        layers[layer].features[row : row + window.rows, col : col + window.cols]
        for layer, row, col in zip(windows.layers.tolist(), windows.rows.tolist(), windows.cols.tolist())
    ]
    return np.stack(cut) if cut else np.zeros((0, *shape), dtype=np.float32)


def best(windows: Windows, overlap: float = OVERLAP) -> np.ndarray:
    """Indices of the windows that no better one overlaps by more than `overlap`, the best first."""
    rest, kept = np.argsort(-windows.scores, kind="stable"), []
    while len(rest):
        kept.append(int(rest[0]))
        shared = overlaps(windows.corners[rest[:1]], windows.corners[rest[1:]])[0]
        rest = rest[1:][shared <= overlap]
    return np.array(kept, dtype=int)


def refined(window: HeadWindow, layers: Sequence[Layer], scores: Sequence[np.ndarray], windows: Windows) -> np.ndarray:
    """(N, 4) boxes between cells and between scales: at the peaks of parabolas through the scores around each window.

    A window that is no peak across, down or along the scales stays in that direction as it is.
    """
    corners = windows.corners.copy()
    for n, (index, row, col) in enumerate(zip(*(column.tolist() for column in windows[:3]))):
        layer, here = layers[index], scores[index]
        down = _peak(*(_score(here, row + step, col) for step in (-1, 0, 1)))
        across = _peak(*(_score(here, row, col + step) for step in (-1, 0, 1)))
        corners[n] = window_corners(window, layer, np.array(row + down), np.array(col + across))
        middle = 0.5 * (corners[n, :2] + corners[n, 2:])
        finer, coarser = (_score_at(window, layers, scores, layer.number + step, middle) for step in (-1, 1))
        octaves = _peak(finer[0], float(here[row, col]), coarser[0])
        if octaves:
            other = layers[finer[1] if octaves < 0 else coarser[1]].scale
            corners[n] = np.tile(middle, 2) + (corners[n] - np.tile(middle, 2)) * np.tile(
                (layer.scale / other) ** abs(octaves), 2
            )
    return corners


def detect(
    model: HeadModel, grey: np.ndarray, least: float, largest: float, threshold: float, layers: int = LAYERS
) -> Boxes:
    """Heads in a grey image: the windows above a threshold, of those that overlap the best, between the cells.

    Args:
        model: of heads.
        grey: (H, W) uint8.
        least, largest: height of heads, pixels; the window's height is the least there can be.
        threshold: in the model's scores.
        layers: scales an octave.
    """
    cells = pyramid(grey, model.window, least, largest, layers)
    scores = score_maps(model, cells)
    windows = candidates(model.window, cells, scores, threshold)
    windows = windows.take(best(windows))
    corners = refined(model.window, cells, scores, windows)
    return Boxes(corners, windows.scores.astype(float), model.confidences(windows.scores))


def _peak(before: float, here: float, after: float) -> float:
    """Where between -0.5 and 0.5 the parabola through three scores has its peak; 0 where the middle is no peak."""
    bend = before - 2.0 * here + after
    if not (here >= before and here >= after and -np.inf < bend < 0.0):
        return 0.0
    return 0.5 * (before - after) / bend


def _score(scores: np.ndarray, row: int, col: int) -> float:
    inside = 0 <= row < scores.shape[0] and 0 <= col < scores.shape[1]
    return float(scores[row, col]) if inside else -np.inf


def _score_at(
    window: HeadWindow, layers: Sequence[Layer], scores: Sequence[np.ndarray], scale: int, middle: np.ndarray
) -> Tuple[float, int]:
    """Score of the window of a scale whose head's middle is nearest to a place in the image, and its layer."""
    offset = 0.5 * (np.array(window.box[:2]) + window.box[2:])
    for index, layer in enumerate(layers):
        if layer.number == scale:
            col, row = np.round(middle * layer.scale / window.features.cell - offset).astype(int).tolist()
            score = _score(scores[index], row - layer.row, col - layer.col)
            if score > -np.inf:
                return score, index
    return -np.inf, -1


def _no_windows() -> Windows:
    none = np.zeros(0, dtype=int)
    return Windows(none, none, none, np.zeros(0, dtype=np.float32), np.zeros((0, 4)))
