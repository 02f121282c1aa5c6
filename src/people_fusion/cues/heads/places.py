"""From heads in space to windows of a scored image: how well a head would be there (Poschmann 2018, 7.2.3).

`seen` is the inverse of people.heads_of_boxes: exact for a level camera; towards the corners of one that looks down by
20 degrees, where what is upright is seen slanted, distances differ by 2 %.
"""

from __future__ import annotations

from typing import NamedTuple, Sequence, Tuple

import numpy as np

from people_fusion.core.head_scores import HeadScores, ScoreLayer

OCTAVES = 0.25  # most by which a head may be larger or smaller than those that a layer's windows hold
BEYOND = 0.5  # cells by which a window may lie outside of those that were scored


class Seen(NamedTuple):
    """The boxes in which heads (N,) are seen.

    Attributes:
        middles: (N, 2) of the boxes, pixels, as Boxes.corners (the image begins at 0); NaN where not seen.
        heights: (N,) of the boxes, pixels; NaN where not seen.
    """

    middles: np.ndarray
    heights: np.ndarray


class Places(NamedTuple):
    """Windows (N,) between the cells.

    Attributes:
        layers: (N,) index into HeadScores.layers; -1 where nothing was scored.
        rows, cols: (N,) upper left cell of the window, as the layer's scores count, not whole.
    """

    layers: np.ndarray
    rows: np.ndarray
    cols: np.ndarray


def seen(scores: HeadScores, heads: np.ndarray) -> Seen:
    """Where in the image heads (N, 3) are, in the frame that `scores.pose` leads to, whose z is up.

    A head is seen if its box's middle is in the image.
    """
    camera, pose, count = scores.camera, scores.pose, len(heads)
    middles = heads - pose.translation - [0.0, 0.0, scores.head_above]
    up = np.array([0.0, 0.0, 0.5 * scores.height])
    ends = camera.project(np.concatenate([middles + up, middles - up]) @ pose.rotation)
    top, bottom = ends[:count], ends[count:]
    if camera.wraps:  # a rolled panorama may show the ends on two sides of the seam
        turns = np.round((bottom[:, 0] - top[:, 0]) / camera.width)
        bottom[:, 0] -= turns * camera.width
    pixels, heights = 0.5 * (top + bottom) + 0.5, bottom[:, 1] - top[:, 1]
    if camera.wraps:
        pixels[:, 0] %= camera.width
    with np.errstate(invalid="ignore"):
        inside = ((pixels >= 0.0) & (pixels <= [camera.width, camera.height])).all(axis=1) & (heights > 0.0)
    return Seen(np.where(inside[:, None], pixels, np.nan), np.where(inside, heights, np.nan))


def places_of(scores: HeadScores, boxes: Seen, octaves: float = OCTAVES) -> Places:
    """The windows in which heads of boxes (N,) belong: of the layers that cover a place that of the nearest size."""
    layers, window, camera = scores.layers, scores.window, scores.camera
    best = np.full(len(boxes.heights), octaves)
    found = Places(np.full(len(best), -1), np.zeros(len(best)), np.zeros(len(best)))
    with np.errstate(divide="ignore", invalid="ignore"):
        sizes = np.log2(boxes.heights / window.head_height)
    for number, layer in enumerate(layers):
        distances = np.abs(sizes + np.log2(layer.scale[1]))
        with np.errstate(invalid="ignore"):
            (near,) = np.nonzero(distances <= best)
        for turn in (0, -camera.width, camera.width) if camera.wraps else (0,):
            cols, rows = upper_left(scores, layer, boxes.middles[near] + [turn, 0.0])
            limits = np.array(layer.scores.shape) - 1 + BEYOND
            inside = (rows >= -BEYOND) & (rows <= limits[0]) & (cols >= -BEYOND) & (cols <= limits[1])
            fits = near[inside]
            found.layers[fits], found.rows[fits], found.cols[fits] = number, rows[inside], cols[inside]
            best[fits] = distances[fits]
    return found


def upper_left(scores: HeadScores, layer: ScoreLayer, middles: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Columns and rows (N,), as the layer's scores count, of windows whose boxes have their middles (N, 2) there."""
    box = np.array(scores.window.box)
    first = 0.5 * (box[:2] + box[2:]) + [layer.col, layer.row]
    cols, rows = ((middles + [scores.beyond, 0.0]) * layer.scale / scores.window.cell - first).T
    return cols, rows


def corners_of(scores: HeadScores, places: Places) -> np.ndarray:
    """(N, 4) boxes in the image, as Boxes.corners, of windows; NaN where a place is none."""
    if not scores.layers:
        return np.full((len(places.layers), 4), np.nan)
    scales = np.stack([layer.scale for layer in scores.layers])[places.layers]
    first = np.array([[layer.col, layer.row] for layer in scores.layers])[places.layers]
    cells = np.tile(first + np.column_stack([places.cols, places.rows]), 2) + np.array(scores.window.box)
    corners = cells * scores.window.cell / np.tile(scales, 2) - np.array([1.0, 0.0, 1.0, 0.0]) * scores.beyond
    return np.where(places.layers[:, None] < 0, np.nan, corners)


def neighbours(shapes: Sequence[Tuple[int, ...]], places: Places) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The four whole windows around each place and their shares: bilinear, on the edge that of what is there.

    Args:
        shapes: (rows, columns) of the windows of each layer.
        places: none of them of layer -1.

    Returns:
        rows, columns and shares (4, N) each.
    """
    last = np.array([shape[:2] for shape in shapes])[places.layers] - 1
    rows, cols = np.clip(places.rows, 0.0, last[:, 0]), np.clip(places.cols, 0.0, last[:, 1])
    row, col = rows.astype(int), cols.astype(int)
    below, right = np.minimum(row + 1, last[:, 0]), np.minimum(col + 1, last[:, 1])
    down, across = rows - row, cols - col
    shares = [(1 - down) * (1 - across), (1 - down) * across, down * (1 - across), down * across]
    return np.stack([row, row, below, below]), np.stack([col, right, col, right]), np.stack(shares)


def interpolated(maps: Sequence[np.ndarray], places: Places) -> np.ndarray:
    """(N,) values of a map per layer between its cells; NaN where a place is none."""
    values = np.full(len(places.layers), np.nan)
    known = places.layers >= 0
    if known.any():
        within = Places(*(column[known] for column in places))
        rows, cols, shares = neighbours([each.shape for each in maps], within)
        starts = np.cumsum([0, *(each.size for each in maps)])[within.layers]
        widths = np.array([each.shape[1] for each in maps])[within.layers]
        flat = np.concatenate([each.ravel() for each in maps])
        values[known] = (shares * flat[starts + rows * widths + cols]).sum(axis=0)
    return values


def scores_at(scores: HeadScores, middles: np.ndarray, heights: np.ndarray) -> np.ndarray:
    """(N,) the model's scores of heads whose boxes have these middles (N, 2) and heights (N,), see Seen.

    NaN where nothing was scored: outside of the image, where the window does not fit into it, where the cue did not
    look, and at sizes that no layer has. It says nothing about a head there, for or against.
    """
    return interpolated([layer.scores for layer in scores.layers], places_of(scores, Seen(middles, heights)))
