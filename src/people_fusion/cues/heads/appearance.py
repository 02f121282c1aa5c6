"""How single people's heads look: a linear SVM of each, on the cells of the detector (Poschmann 2018, 5.2 and 6.2.2).

Of T people the models are rows (T, K) float32: the weights of a window's cells, then the bias. A row of zeros has not
been learnt yet.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.head_scores import HeadScores, ScoreWindow
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.head_model import LinearModels
from people_fusion.cues.heads.native import scores_at
from people_fusion.cues.heads.places import Places, Seen, corners_of, neighbours, places_of

SIZES = 0.3  # octaves by which negatives may be larger or smaller
TOLERANCE = 1e-3  # of the dual's projected gradient, as of libsvm
STEPS = 1000


@dataclass(frozen=True)
class AppearanceConfig:
    """How appearance is learnt (Poschmann 2018, table 6.1)."""

    rate: float = parameter(0.5, "share of what the newest image says, lambda of eq. 5.1", 0.0, 1.0)
    penalty: float = parameter(10.0, "C of the SVM", low=1e-6)
    negatives: int = parameter(10, "windows beside the head that a model is trained against", low=1)
    pool: int = parameter(60, "windows drawn at random in the surroundings, of which those are the likeliest", low=1)
    reach: float = parameter(1.5, "of the surroundings around the head's middle, heights of its box", low=0.5)
    overlap: float = parameter(0.3, "most of a negative with the head, intersection over union", 0.0, 1.0)


def length(window: ScoreWindow, dimensions: int) -> int:
    """K of models of a window of cells with so many dimensions."""
    return window.rows * window.cols * dimensions + 1


def is_learnt(models: np.ndarray) -> np.ndarray:
    """(T,) which of the models (T, K) have seen anybody."""
    return np.asarray(models.any(axis=1))


def learn(
    models: np.ndarray, scores: HeadScores, places: Places, config: AppearanceConfig, rng: np.random.Generator
) -> np.ndarray:
    """Models (T, K) after another image (5.2.3).

    Who has no place, or nothing beside it that was scored, stays as he is.

    Args:
        models: as they were.
        scores: of the image, with features.
        places: (T,) where each head is.
        config: how is learnt.
        rng: draws `pool` windows for each head.
    """
    learnt, here = is_learnt(models), _whole(scores, places)
    around = _surroundings(scores, here, config, rng)
    some = (here.layers >= 0) & (around.layers >= 0).any(axis=1)
    current = models.copy()
    fresh = some & ~learnt
    if fresh.any():  # its sole purpose is to find hard negatives
        by_chance = np.argsort(around.layers[fresh] < 0, axis=1, kind="stable")[:, : config.negatives]
        current[fresh] = _trained(scores, _some(here, fresh), _chosen(_some(around, fresh), by_chance), config.penalty)
    if some.any():
        positives, negatives = _some(here, some), _some(around, some)
        likeness = scores_of(current[some], scores, negatives)
        hardest = np.argsort(-np.nan_to_num(likeness, nan=-np.inf), axis=1, kind="stable")[:, : config.negatives]
        current[some] = _trained(scores, positives, _chosen(negatives, hardest), config.penalty)
    rates = np.where(some & learnt, config.rate, 1.0)[:, None].astype(np.float32)
    return np.asarray(rates * current + (1.0 - rates) * models)  # eq. 5.1


def scores_of(models: np.ndarray, scores: HeadScores, places: Places) -> np.ndarray:
    """(T, N) scores of windows, each by its person's model, between the cells; NaN where a place is none.

    Args:
        models: (T, K).
        scores: with features.
        places: (T, N) in all its columns.
    """
    values = np.full(places.layers.shape, np.nan)
    people, numbers = np.nonzero(places.layers >= 0)
    if not len(people):
        return values
    shapes = np.array([layer.scores.shape for layer in scores.layers])
    starts = np.cumsum([0, *shapes.prod(axis=1)])
    within = Places(*(column[people, numbers] for column in places))
    rows, cols, shares = neighbours([layer.scores.shape for layer in scores.layers], within)
    windows = people * starts[-1] + starts[within.layers] + rows * shapes[within.layers, 1] + cols
    wanted, which = np.unique(windows, return_inverse=True)  # neighbours share their windows
    person, window = np.divmod(wanted, starts[-1])
    layers = np.searchsorted(starts, window, side="right") - 1
    row, col = np.divmod(window - starts[layers], shapes[layers, 1])
    found = _whole_scores(models, scores, person, Places(np.asarray(layers), row, col))
    values[people, numbers] = (shares * found[which.reshape(shares.shape)]).sum(axis=0)
    return values


def train(positives: np.ndarray, negatives: np.ndarray, valid: np.ndarray, penalty: float) -> np.ndarray:
    """Models (T, D + 1) float32 of T people: the least of |w|^2 / 2 + rho^2 / 2 + C sum_i max(0, 1 - y_i f(x_i)).

    By dual coordinate descent (Hsieh et al. 2008) of all at once, in each the coordinate that gains most; the bias is
    the weight of one more feature, which is 1.

    Args:
        positives: (T, D), one each.
        negatives: (T, M, D).
        valid: (T, M) which of the negatives there are.
        penalty: C.
    """
    examples = np.concatenate([positives[:, None], negatives], axis=1)
    signs = np.where(np.arange(examples.shape[1]) > 0, -1.0, 1.0)
    gram = (examples @ examples.swapaxes(1, 2) + 1.0) * signs[:, None] * signs
    curvature = np.maximum(np.diagonal(gram, axis1=1, axis2=2), 1e-12)
    upper = np.hstack([np.full((len(valid), 1), penalty), np.where(valid, penalty, 0.0)])
    alpha, gradient = np.zeros(upper.shape), -np.ones(upper.shape)
    everybody = np.arange(len(alpha))
    for _ in range(STEPS):
        steps = np.minimum(np.maximum(alpha - gradient / curvature, 0.0), upper) - alpha
        if np.abs(steps * curvature).max(initial=0.0) < TOLERANCE:
            break
        best = np.argmax(-steps * (gradient + 0.5 * steps * curvature), axis=1)
        step = steps[everybody, best]
        alpha[everybody, best] += step
        gradient += step[:, None] * gram[everybody, best]
    shares = alpha * signs
    weights = (shares[:, None] @ examples)[:, 0]
    return np.hstack([weights, shares.sum(axis=1, keepdims=True)]).astype(np.float32)


def _surroundings(scores: HeadScores, heads: Places, config: AppearanceConfig, rng: np.random.Generator) -> Places:
    """(T, pool) whole windows beside heads (T,), of nearly their size; of layer -1 those that overlap too much."""
    corners = corners_of(scores, heads)
    heights = corners[:, 3] - corners[:, 1]
    drawn = rng.uniform(-1.0, 1.0, (len(heights), config.pool, 3))
    offsets, sizes = config.reach * drawn[..., :2], 2.0 ** (SIZES * drawn[..., 2])
    left, top, right, bottom = scores.window.box
    half = 0.5 * np.array([(right - left) / (bottom - top), 1.0])
    there = np.concatenate([offsets - sizes[..., None] * half, offsets + sizes[..., None] * half], axis=2)
    beside = overlaps(there.reshape(-1, 4), np.concatenate([-half, half])[None])[:, 0] <= config.overlap
    middles = 0.5 * (corners[:, None, :2] + corners[:, None, 2:]) + heights[:, None, None] * offsets
    boxes = Seen(middles.reshape(-1, 2), (heights[:, None] * sizes).ravel())
    places = _whole(scores, places_of(scores, boxes))
    places = places._replace(layers=np.where(beside, places.layers, -1))
    return Places(*(column.reshape(sizes.shape) for column in places))


def _whole(scores: HeadScores, places: Places) -> Places:
    """The nearest windows of whole cells."""
    if not scores.layers:
        return places
    last = np.array([layer.scores.shape for layer in scores.layers])[places.layers] - 1
    rows, cols = (np.round(column).astype(int) for column in places[1:])
    return Places(places.layers, np.clip(rows, 0, last[..., 0]), np.clip(cols, 0, last[..., 1]))


def _some(places: Places, which: np.ndarray) -> Places:
    return Places(*(column[which] for column in places))


def _chosen(places: Places, columns: np.ndarray) -> Places:
    """(T, M) of (T, N)."""
    return Places(*(np.take_along_axis(column, columns, axis=1) for column in places))


def _trained(scores: HeadScores, heads: Places, negatives: Places, penalty: float) -> np.ndarray:
    cells = _cells(scores, negatives).reshape(*negatives.layers.shape, -1)
    return train(_cells(scores, heads), cells, negatives.layers >= 0, penalty)


def _cells(scores: HeadScores, places: Places) -> np.ndarray:
    """(N, rows * cols * D) cells of whole windows; zero where a place is none."""
    rows, cols, dimensions = _window_shape(scores)
    found = np.zeros((places.layers.size, rows, cols, dimensions), dtype=np.float32)
    columns = (column.ravel().tolist() for column in places)
    for n, (layer, row, col) in enumerate(zip(*columns)):
        if layer >= 0:
            found[n] = scores.layers[layer].features[row : row + rows, col : col + cols]
    return found.reshape(len(found), -1)


def _whole_scores(models: np.ndarray, scores: HeadScores, people: np.ndarray, places: Places) -> np.ndarray:
    """(N,) scores of whole windows by people's models, (N,) rows of `models`."""
    several = LinearModels(models[:, :-1].reshape(len(models), *_window_shape(scores)), models[:, -1])
    found = np.empty(len(people), dtype=np.float32)
    for number, layer in enumerate(scores.layers):
        (here,) = np.nonzero(places.layers == number)
        if len(here):
            found[here] = scores_at(layer.features, places.rows[here], places.cols[here], people[here], several)
    return found


def _window_shape(scores: HeadScores) -> Tuple[int, int, int]:
    return scores.window.rows, scores.window.cols, scores.layers[0].features.shape[2]
