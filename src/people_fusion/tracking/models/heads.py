"""Particles weighed by how much like a head the image is where they are (Poschmann 2018, 7.2.3; H2 and H2A)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.association.methods.greedy import Greedy, GreedyConfig
from people_fusion.core.config import parameter, section
from people_fusion.core.head_scores import FEATURES, SCORES, HeadScores
from people_fusion.core.measurements import Measurement
from people_fusion.core.poses import point_jacobians
from people_fusion.cues.heads.appearance import AppearanceConfig, is_learnt, learn, length, scores_of
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.places import Places, Seen, interpolated, places_of, seen
from people_fusion.filtering.particles import root
from people_fusion.tracking.models.gaussian import (
    GaussianModel,
    GaussianModelConfig,
    innovations_of,
    pair_likelihoods,
)
from people_fusion.tracking.weighing import MEASUREMENT_MODELS, Belief, Births, MeasurementModel, Pairing

NEARER_M = 0.3  # by which somebody must be, to hide another
TRUNK = 1.0  # half of its width, heights of a head


@dataclass(frozen=True)
class HeadScoreModelConfig:
    """What an image says of a person, seen or not."""

    visible_probability: float = parameter(0.7, "p(v): that a person is to be seen by the camera", low=0.0, high=1.0)
    hidden_likelihood: float = parameter(
        0.05, "p(z | x, not v): of whoever is not to be seen, as much as where there is no head", low=1e-6, high=1.0
    )
    detections: bool = parameter(
        False, "weigh who is detected by the detection, whose size and error are known, and all others by the scores"
    )
    threshold: float = parameter(-1.0, "score of a track's head from which it is there, detected or not")
    occlusion: bool = parameter(False, "nothing is said of whom a nearer person hides from the camera")
    adaptive: bool = parameter(False, "learn how each person looks, and look for that, too (H2A)")
    testimony_from: float = parameter(-1.4, "best score about a track's place that speaks neither for nor against it")
    testimony_slope: float = parameter(1.0, "log odds by score; looks that follow each other are alike")
    own_threshold: float = parameter(0.0, "`threshold` by a person's own looks, once these are learnt")
    appearance: AppearanceConfig = section(AppearanceConfig, "how looks are learnt")
    overlap: float = parameter(0.2, "of a track's head and a detection's box, from which both may be one", 0.0, 1.0)
    without_scores: GaussianModelConfig = section(GaussianModelConfig, "detections that come without scores")


@MEASUREMENT_MODELS.register("heads", HeadScoreModelConfig)
class HeadScoreModel(MeasurementModel):
    """See the module. Where a cue gives no scores, its detections are taken as Gaussians."""

    after_weighing = True
    starts = confirms = True

    def __init__(self, config: HeadScoreModelConfig) -> None:
        self.config = config
        self.scores = FEATURES if config.adaptive else SCORES
        self._gaussian = GaussianModel(config.without_scores)
        self._assignment = Greedy(GreedyConfig())

    def associate(self, belief: Belief, measurement: Measurement) -> Pairing:
        """By the overlap of the detections' boxes and those in which the tracks' heads are expected."""
        scores = measurement.scores
        if scores is None:
            return self._gaussian.associate(belief, measurement)
        pairing = Pairing.nothing(len(belief), len(measurement))
        if len(belief) == 0 or len(measurement) == 0:
            return pairing
        shared = _overlaps(scores, seen(scores, belief.means[:, :3]))
        tracks, rows = np.nonzero(shared > self.config.overlap)
        chosen = self._assignment.assign(tracks, rows, -shared[tracks, rows], (len(belief), len(measurement)))
        tracks, rows = tracks[chosen], rows[chosen]
        pairing.rows[tracks], pairing.used[rows] = rows, True
        innovations, spreads = innovations_of(belief, measurement)
        pairing.log_likelihoods[tracks] = pair_likelihoods(innovations[tracks, rows], spreads[tracks, rows])
        return pairing

    def weigh(
        self, belief: Belief, measurement: Measurement, pairing: Pairing, rng: np.random.Generator
    ) -> np.ndarray:
        """Log of eq. 7.3: what the image says of who is to be seen, a constant of who is not."""
        scores, config = measurement.scores, self.config
        if scores is None:
            return self._gaussian.weigh(belief, measurement, pairing, rng)
        boxes = seen(scores, _as_seen(scores, belief.states[..., :3].reshape(-1, 3), rng))
        places = Places(*(column.reshape(belief.weights.shape) for column in places_of(scores, boxes)))
        likely = _likelihoods(scores, *self._scores(belief, scores, places))
        if config.detections:
            likely[pairing.detected] = np.exp(self._gaussian.weigh(belief, measurement, pairing, rng))[pairing.detected]
        mixed = config.visible_probability * likely + (1.0 - config.visible_probability) * config.hidden_likelihood
        # Where nobody looked nobody is to be seen, and it is no better than where the person was thought to be.
        looked = np.where(np.isnan(mixed), 0.0, belief.weights)
        usual = (looked * np.nan_to_num(mixed)).sum(axis=1) / np.maximum(looked.sum(axis=1), 1e-300)
        usual = np.where(usual > 0.0, np.minimum(usual, config.hidden_likelihood), config.hidden_likelihood)
        logs = np.log(np.where(np.isnan(mixed), usual[:, None], mixed))
        if config.occlusion:
            logs[_hidden(scores, belief) & ~pairing.detected] = 0.0
        return logs

    def visible(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> np.ndarray:
        """Who is detected, or looks enough like a head where it should be."""
        scores = measurement.scores
        if scores is None:
            return self._gaussian.visible(belief, measurement, pairing)
        of_class, own = self._scores(belief, scores, _places_of_means(belief, scores))
        with np.errstate(invalid="ignore"):
            there = np.where(np.isnan(own), of_class > self.config.threshold, own > self.config.own_threshold)
        return np.asarray(pairing.detected | there[:, 0])

    def testimony(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> np.ndarray:
        """By the best score about a track's place: a head of known distance need not be detected to be one."""
        scores, config = measurement.scores, self.config
        if scores is None:
            return self._gaussian.testimony(belief, measurement, pairing)
        boxes = seen(scores, belief.states[..., :3].reshape(-1, 3))
        values = interpolated([layer.scores for layer in scores.layers], places_of(scores, boxes))
        best = np.nan_to_num(values, nan=-np.inf).reshape(belief.weights.shape).max(axis=1, initial=-np.inf)
        testimony = np.clip(config.testimony_slope * (best - config.testimony_from), -1.0, 1.0)
        testimony[np.isneginf(best) | _hidden(scores, belief)] = 0.0  # nobody looked
        return np.where(pairing.detected, 1.0, testimony)

    def learn(
        self, belief: Belief, measurement: Measurement, visible: np.ndarray, rng: np.random.Generator
    ) -> np.ndarray:
        """How those look who are confirmed and to be seen (7.3)."""
        scores = measurement.scores
        if not self.config.adaptive or scores is None or not scores.has_features or len(belief) == 0:
            return belief.memory
        size, models = _length(scores), belief.memory
        if models.shape[1] != size:  # none yet, or of another detector
            models = np.zeros((len(belief), size), dtype=np.float32)
        places = _places_of_means(belief, scores)
        layers = np.where(visible & belief.confirmed, places.layers[:, 0], -1)
        return learn(models, scores, Places(layers, places.rows[:, 0], places.cols[:, 0]), self.config.appearance, rng)

    def initiate(self, belief: Belief, measurement: Measurement, pairing: Pairing) -> Births:
        """Detections of nobody."""
        return self._gaussian.initiate(belief, measurement, pairing)

    def _scores(self, belief: Belief, scores: HeadScores, places: Places) -> Tuple[np.ndarray, np.ndarray]:
        """(T, N) scores of places by the class and by each person's own model; NaN where there is none."""
        of_class = interpolated([layer.scores for layer in scores.layers], _flat(places)).reshape(places.layers.shape)
        own = np.full(places.layers.shape, np.nan)
        if scores.has_features and belief.memory.shape[1] == _length(scores):  # else none, or of another detector
            known = is_learnt(belief.memory)
            own[known] = scores_of(belief.memory[known], scores, Places(*(column[known] for column in places)))
        return of_class, own


def _likelihoods(scores: HeadScores, of_class: np.ndarray, own: np.ndarray) -> np.ndarray:
    """p(z | x, v): eq. 7.5 where a person's own looks are known, eq. 7.4 where not; NaN where nothing was scored."""
    p_c, p_i = (1.0 / (1.0 + np.exp(np.clip(scores.platt_slope * each, -500.0, 500.0))) for each in (of_class, own))
    return np.where(np.isnan(p_i), p_c, np.sqrt(p_c * p_i))


def _length(scores: HeadScores) -> int:
    """K of the models of people's looks that go with an image's features."""
    return length(scores.window, scores.layers[0].features.shape[2])


def _places_of_means(belief: Belief, scores: HeadScores) -> Places:
    """(T, 1) where the tracks' heads are expected."""
    return Places(*(column[:, None] for column in places_of(scores, seen(scores, belief.means[:, :3]))))


def _flat(places: Places) -> Places:
    return Places(*(column.ravel() for column in places))


def _as_seen(scores: HeadScores, heads: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Heads (N, 3) where a camera sees them whose pose errs, by another draw of that error for each."""
    if not scores.pose_covariance.any():
        return heads
    errors = rng.standard_normal((len(heads), 6)) @ root(scores.pose_covariance).T
    points = scores.pose.inverse().apply(heads)
    return np.asarray(heads - np.einsum("nij,nj->ni", point_jacobians(scores.pose, points), errors))


def _hidden(scores: HeadScores, belief: Belief) -> np.ndarray:
    """(T,) whom the head or, below it, the trunk of a nearer person hides."""
    middles, heights = seen(scores, belief.means[:, :3])
    distances = np.linalg.norm(belief.means[:, :2] - scores.pose.translation[:2], axis=1)
    nearer = (distances[None, :] < distances[:, None] - NEARER_M) & belief.confirmed[None, :]
    aside, below = np.moveaxis(middles[:, None] - middles[None, :], 2, 0)
    if scores.camera.wraps:
        aside = aside - np.round(aside / scores.camera.width) * scores.camera.width
    with np.errstate(invalid="ignore"):
        half = np.where(below < 0.5 * heights[None, :], 0.5, TRUNK) * heights[None, :]
        covered = nearer & (np.abs(aside) < half) & (below > -0.5 * heights[None, :])
    return np.asarray(covered.any(axis=1))


def _overlaps(scores: HeadScores, boxes: Seen) -> np.ndarray:
    """(T, M) intersection over union of tracks' heads and detections, the seam of a panorama closed."""
    left, top, right, bottom = scores.window.box
    half = 0.5 * boxes.heights[:, None] * np.array([[(right - left) / (bottom - top), 1.0]])
    corners = np.hstack([boxes.middles - half, boxes.middles + half])
    width = scores.camera.width
    turns = (0.0, -width, width) if scores.camera.wraps else (0.0,)
    shared = [overlaps(corners + [turn, 0.0, turn, 0.0], scores.corners) for turn in turns]
    return np.nan_to_num(np.max(shared, axis=0))
