"""Greedy nearest neighbour: the cheapest pair first (Poschmann 2018, 3.2.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np

from people_fusion.association.method import ASSIGNMENT_METHODS, AssignmentMethod


@dataclass(frozen=True)
class GreedyConfig:
    """Nothing to choose."""


@ASSIGNMENT_METHODS.register("greedy", GreedyConfig)
class Greedy(AssignmentMethod):
    """Takes candidate pairs by rising cost while that is negative and both partners are free; equal costs by order."""

    def __init__(self, config: GreedyConfig) -> None:
        self.config = config

    def assign(
        self, tracks: np.ndarray, detections: np.ndarray, costs: np.ndarray, shape: Tuple[int, int]
    ) -> np.ndarray:
        """See AssignmentMethod."""
        track_free, detection_free = [True] * shape[0], [True] * shape[1]
        chosen = []
        track_list, detection_list = tracks.tolist(), detections.tolist()
        for pair in np.argsort(costs, kind="stable").tolist():
            track, detection = track_list[pair], detection_list[pair]
            if costs[pair] < 0 and track_free[track] and detection_free[detection]:
                track_free[track] = detection_free[detection] = False
                chosen.append(pair)
        return np.array(chosen, dtype=int)
