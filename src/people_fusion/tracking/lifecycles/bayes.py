"""Probability of existence by Bayes' rule (integrated probabilistic data association, Musicki, Evans & Stankovic 1994).

A detection speaks for a track by the ratio of its likelihood to that of a false alarm. A missing one speaks against it
only as far as the sensor could see the person: who stands behind a pillar or beside the field of view is not forgotten.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.tracking.lifecycle import LIFECYCLES, Evidence, Lifecycle, Verdict
from people_fusion.tracking.table import TrackTable


@dataclass(frozen=True)
class BayesConfig:
    """Probabilities of the sensors and of people."""

    detection_probability: float = parameter(0.6, "that a visible person is detected", low=0.01, high=0.999)
    clutter_density: float = parameter(0.3, "false detections per square metre and measurement, near people", low=1e-9)
    birth_existence: float = parameter(0.3, "existence of a new track", low=0.0, high=1.0)
    mean_stay_s: float = parameter(60.0, "after which an unseen person has left, on average, seconds", low=0.1)
    largest_ratio: float = parameter(4.0, "bound of what one detection may say, as errors come in runs", low=1.0)
    confirm_above: float = parameter(0.8, "existence from which a track is a person", low=0.0, high=1.0)
    lose_below: float = parameter(0.4, "existence below which a person is none any more", low=0.0, high=1.0)
    end_below: float = parameter(0.02, "existence below which a track ends", low=0.0, high=1.0)
    longest_unseen_s: float = parameter(3.0, "time without detection that ends a track, seconds", low=0.0)
    largest_position_std: float = parameter(1.5, "a track with more uncertain position ends, metres", low=0.0)
    confidence_resting: float = parameter(
        0.5, "what rests is a person from this confidence of its detections, on average", low=0.0, high=1.0
    )
    confidence_moving: float = parameter(0.2, "the same to begin with for what moves", low=0.0, high=1.0)
    rest_after_s: float = parameter(
        5.0, "what stays at a place that long rests, as does what never moved, seconds", low=0.0
    )
    confidence_time_s: float = parameter(3.0, "over which that average is taken, seconds", low=0.01)
    furniture_after_s: float = parameter(
        90.0, "who rests this long is furniture and not reported until it moves, seconds; .inf: off", 0.0, math.inf
    )
    furniture_unmoved_after_s: float = parameter(
        30.0, "the same for what has never been seen to move, seconds; .inf: off", 0.0, math.inf
    )
    longest_unseen_furniture_s: float = parameter(60.0, "`longest_unseen_s` of furniture, seconds", low=0.0)


@LIFECYCLES.register("bayes", BayesConfig)
class Bayes(Lifecycle):
    """Remembers how confident the cues were of a track's detections, and with what weight."""

    memory = (2,)

    def __init__(self, config: BayesConfig) -> None:
        self.config = config

    def judge(self, table: TrackTable, evidence: Evidence) -> Verdict:
        """See Lifecycle."""
        config = self.config
        existence = table.existence * math.exp(-evidence.duration_s / config.mean_stay_s)
        missed = 1.0 - config.detection_probability * evidence.visible
        log_ratio = evidence.log_likelihoods + math.log(config.detection_probability / config.clutter_density)
        bound = math.log(config.largest_ratio)
        # A detection that is hardly a person's says hardly anything, for or against.
        hit = np.exp(np.clip(log_ratio, -bound, bound) * evidence.confidences)
        ratio = np.where(evidence.matched, hit, missed)
        existence = np.where(
            evidence.new, config.birth_existence, existence * ratio / (1.0 - existence + existence * ratio)
        )
        unseen_s = (evidence.stamp_ns - table.seen_ns) / 1e9
        never_moved = table.resting_since_ns == table.born_ns
        memory, confidence = self._confidence(table, evidence)
        patience_s = np.where(never_moved, config.furniture_unmoved_after_s, config.furniture_after_s)
        rests_s = (evidence.stamp_ns - table.resting_since_ns) / 1e9
        furniture = rests_s > patience_s
        # The same doubt about the same thing, look after look, is one doubt: it does not average out as noise does.
        rests = never_moved | (rests_s > config.rest_after_s)
        begins = confidence >= np.where(rests, config.confidence_resting, config.confidence_moving)
        stays = table.confirmed & (begins | ~rests)
        confirmed = (begins & (existence >= config.confirm_above)) | (stays & (existence >= config.lose_below))
        confirmed &= ~furniture
        position_std = np.sqrt((table.covariances[:, 0, 0] + table.covariances[:, 1, 1]) / 2)
        alive = (
            (existence >= config.end_below)
            & (unseen_s <= np.where(furniture, config.longest_unseen_furniture_s, config.longest_unseen_s))
            & (position_std <= config.largest_position_std)
        )
        return Verdict(existence, memory, confirmed & alive, alive, furniture)

    def _confidence(self, table: TrackTable, evidence: Evidence) -> Tuple[np.ndarray, np.ndarray]:
        """The memory (T, 2) with the measurement in it, and the average (T,) of the detections' confidences."""
        fading = math.exp(-evidence.duration_s / self.config.confidence_time_s)
        seen = np.column_stack([evidence.confidences, np.ones(len(table))])
        memory = np.where((evidence.matched & ~evidence.new)[:, None], table.memory * fading + seen, table.memory)
        return memory, memory[:, 0] / np.maximum(memory[:, 1], 1e-9)
