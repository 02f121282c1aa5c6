"""Heads followed in the image alone, by particles over place and size (Poschmann 2018, chapter 6).

A state is (x, y, s): the middle of a head's box and its height, pixels as Boxes.corners.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, NamedTuple, Tuple

import numpy as np

from people_fusion.association.methods.greedy import Greedy, GreedyConfig
from people_fusion.core.config import parameter, section
from people_fusion.core.head_scores import HeadScores
from people_fusion.core.resampling import systematic
from people_fusion.cues.heads.appearance import AppearanceConfig, learn, length, scores_of
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.places import Places, Seen, interpolated, places_of
from people_fusion.filtering.particles import draw, summary, weighed


@dataclass(frozen=True)
class ImageHeadsConfig:
    """How heads are followed in the image (Poschmann 2018, table 6.1)."""

    particles: int = parameter(500, "of each head", low=2, high=100000)
    place_std: float = parameter(0.2, "of a head's movement from image to image, its heights", low=1e-3)
    size_std: float = parameter(0.05, "of the change of its size from image to image, its heights", 1e-3, 0.5)
    start_place_std: float = parameter(0.1, "of a detection's place, its heights", low=1e-3)
    start_size_std: float = parameter(0.1, "of a detection's size, its heights", 1e-3, 0.5)
    adaptive: bool = parameter(True, "learn how each head looks, and look for that, too")
    lost: float = parameter(-1.0, "score of the detector's model below which a head that is not detected is gone")
    own_lost: float = parameter(0.0, "`lost` by a head's own looks, where these are learnt")
    overlap: float = parameter(0.2, "of a head and a detection, from which both may be one", 0.0, 1.0)
    double: float = parameter(0.4, "of two heads, from which the one that scores less is hidden by the other", 0.0, 1.0)
    appearance: AppearanceConfig = section(AppearanceConfig, "how looks are learnt")


class ImageHead(NamedTuple):
    """A head in the newest image.

    Attributes:
        track: its number, from 1; never given again.
        box: (4,) left, top, right, bottom, pixels.
        score: of its own looks before the image was learnt, of the detector's model where these are not learnt.
        detected: whether a detection was its.
    """

    track: int
    box: np.ndarray
    score: float
    detected: bool


class ImageHeads:
    """See the module. Deterministic, given the generator.

    Args:
        config: how is followed.
        rng: draws particles and negatives.
    """

    def __init__(self, config: ImageHeadsConfig, rng: np.random.Generator) -> None:
        self.config, self._rng = config, rng
        self._assignment, self._started = Greedy(GreedyConfig()), 0
        self._states, self._weights = np.zeros((0, config.particles, 3)), np.zeros((0, config.particles))
        self._models = np.zeros((0, 0), dtype=np.float32)
        self._tracks, self._confirmed = np.zeros(0, dtype=int), np.zeros(0, dtype=bool)
        self._scores, self._detected = np.zeros(0), np.zeros(0, dtype=bool)
        self._aspect = 1.0

    @property
    def heads(self) -> List[ImageHead]:
        """Those that have been confirmed (two detections, or `add`), in order of their numbers."""
        columns = self._tracks.tolist(), self._boxes(), self._scores.tolist(), self._detected.tolist()
        return [ImageHead(*each) for each, confirmed in zip(zip(*columns), self._confirmed) if confirmed]

    def particles(self) -> Tuple[np.ndarray, np.ndarray]:
        """States (T, N, 3) and weights (T, N) of the confirmed heads."""
        return self._states[self._confirmed], self._weights[self._confirmed]

    def update(self, scores: HeadScores, starts: bool = True) -> None:
        """Follow all heads into the next image.

        Args:
            scores: of the whole image, with features if looks are to be learnt.
            starts: whether detections that are nobody's start new tracks.
        """
        self._aspect = _aspect(scores)
        self._resample_and_move()
        self._weights = weighed(self._weights, self._log_likelihoods(scores))
        rows = self._associate(scores)
        self._detected = rows >= 0
        self._confirmed = self._confirmed | self._detected
        self._keep(self._detected | (self._confirmed & self._seen(scores)))
        self._keep(~self._hidden())
        if starts:
            self._start(scores, np.setdiff1d(np.arange(len(scores.corners)), rows))
        self._learn(scores, np.ones(len(self._tracks), dtype=bool))

    def add(self, scores: HeadScores, box: np.ndarray) -> None:
        """Follow one more head, which needs no confirmation, from the image of the last update on.

        Args:
            scores: of that image.
            box: (4,) corners; its height counts, its width is that of a head.
        """
        self._append(scores, np.asarray(box, dtype=float)[None], np.ones(1), np.ones(1, dtype=bool))
        self._learn(scores, np.arange(len(self._tracks)) == len(self._tracks) - 1)

    def _resample_and_move(self) -> None:
        """Equations 6.2 and 6.4."""
        tracks, count = self._weights.shape
        chosen = systematic(self._weights, self._rng.random(tracks))
        states = np.take_along_axis(self._states, chosen[..., None], axis=1)
        noise = self._rng.standard_normal(states.shape)
        stds = np.array([self.config.place_std, self.config.place_std, self.config.size_std])
        self._states = states + states[..., 2:] * stds * noise
        self._states[..., 2] = np.maximum(self._states[..., 2], 1.0)
        self._weights = np.full((tracks, count), 1.0 / count)

    def _log_likelihoods(self, scores: HeadScores) -> np.ndarray:
        """(T, N) logs of equations 6.5 and 6.6; -inf where nothing was scored."""
        of_class, own = self._looked_up(scores, self._states)
        with np.errstate(invalid="ignore"):
            logs = [-np.logaddexp(0.0, scores.platt_slope * each) for each in (of_class, own)]
        return np.nan_to_num(np.where(np.isnan(own), logs[0], 0.5 * logs[0] + 0.5 * logs[1]), nan=-np.inf)

    def _seen(self, scores: HeadScores) -> np.ndarray:
        """(T,) who still looks like a head, or like himself; notes the scores, -inf where nothing was scored."""
        of_class, own = (each[:, 0] for each in self._looked_up(scores, self._means()[:, None]))
        self._scores = np.nan_to_num(np.where(np.isnan(own), of_class, own), nan=-np.inf)
        return np.asarray(self._scores >= np.where(np.isnan(own), self.config.lost, self.config.own_lost))

    def _looked_up(self, scores: HeadScores, states: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """(T, M) scores of states (T, M, 3) by the class and by each head's own model; NaN where there is none."""
        flat = states.reshape(-1, 3)
        places = places_of(scores, Seen(flat[:, :2], flat[:, 2]))
        of_class = interpolated([layer.scores for layer in scores.layers], places).reshape(states.shape[:2])
        own = np.full(states.shape[:2], np.nan)
        learnt = self._models.any(axis=1)
        if learnt.any() and scores.layers and scores.has_features:
            here = Places(*(column.reshape(states.shape[:2])[learnt] for column in places))
            own[learnt] = scores_of(self._models[learnt], scores, here)
        return of_class, own

    def _associate(self, scores: HeadScores) -> np.ndarray:
        """(T,) each head's detection, -1 for none."""
        rows = np.full(len(self._tracks), -1)
        shared = overlaps(self._boxes(), scores.corners)
        tracks, detections = np.nonzero(shared > self.config.overlap)
        shape = len(rows), len(scores.corners)
        chosen = self._assignment.assign(tracks, detections, -shared[tracks, detections], shape)
        rows[tracks[chosen]] = detections[chosen]
        return rows

    def _hidden(self) -> np.ndarray:
        """(T,) who overlaps somebody that scores more."""
        boxes = self._boxes()
        order = np.lexsort((self._tracks, -self._scores))
        rank = np.empty(len(order), dtype=int)
        rank[order] = np.arange(len(order))
        better = rank[None, :] < rank[:, None]
        return np.asarray(((overlaps(boxes, boxes) > self.config.double) & better).any(axis=1))

    def _start(self, scores: HeadScores, rows: np.ndarray) -> None:
        self._append(scores, scores.corners[rows], scores.box_scores[rows], np.zeros(len(rows), dtype=bool))

    def _append(self, scores: HeadScores, corners: np.ndarray, values: np.ndarray, confirmed: np.ndarray) -> None:
        config, count = self.config, len(corners)
        heights = corners[:, 3] - corners[:, 1]
        means = np.column_stack([0.5 * (corners[:, :2] + corners[:, 2:]), heights])
        stds = np.array([config.start_place_std, config.start_place_std, config.start_size_std])
        covariances = np.eye(3) * (heights[:, None, None] * stds) ** 2
        states = draw(means, covariances, config.particles, self._rng)
        states[..., 2] = np.maximum(states[..., 2], 1.0)
        size = length(scores.window, scores.layers[0].features.shape[2]) if scores.layers else self._models.shape[1]
        models = self._models if self._models.shape[1] == size else np.zeros((len(self._models), size), np.float32)
        self._states = np.concatenate([self._states, states])
        self._weights = np.concatenate([self._weights, np.full((count, config.particles), 1.0 / config.particles)])
        self._models = np.concatenate([models, np.zeros((count, size), dtype=np.float32)])
        self._tracks = np.concatenate([self._tracks, self._started + 1 + np.arange(count)])
        self._confirmed = np.concatenate([self._confirmed, confirmed])
        self._scores = np.concatenate([self._scores, values])
        self._detected = np.concatenate([self._detected, np.ones(count, dtype=bool)])
        self._started += count

    def _keep(self, which: np.ndarray) -> None:
        self._states, self._weights, self._models = self._states[which], self._weights[which], self._models[which]
        self._tracks, self._confirmed = self._tracks[which], self._confirmed[which]
        self._scores, self._detected = self._scores[which], self._detected[which]

    def _learn(self, scores: HeadScores, which: np.ndarray) -> None:
        if not (self.config.adaptive and scores.layers and scores.has_features and len(self._tracks)):
            return
        means = self._means()
        places = places_of(scores, Seen(means[:, :2], means[:, 2]))
        places = places._replace(layers=np.where(which, places.layers, -1))
        self._models = learn(self._models, scores, places, self.config.appearance, self._rng)

    def _means(self) -> np.ndarray:
        return summary(self._states, self._weights)[0]

    def _boxes(self) -> np.ndarray:
        """(T, 4) corners."""
        means = self._means()
        half = 0.5 * means[:, 2:] * [self._aspect, 1.0]
        return np.hstack([means[:, :2] - half, means[:, :2] + half])


def _aspect(scores: HeadScores) -> float:
    left, top, right, bottom = scores.window.box
    return (right - left) / (bottom - top)
