"""Global nearest neighbour: the assignment of most pairs and, among those, least total cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from people_fusion.association.method import ASSIGNMENT_METHODS, AssignmentMethod


@dataclass(frozen=True)
class OptimalConfig:
    """Nothing to choose."""


@ASSIGNMENT_METHODS.register("optimal", OptimalConfig)
class Optimal(AssignmentMethod):
    """Jonker-Volgenant through SciPy."""

    def __init__(self, config: OptimalConfig) -> None:
        self.config = config

    def assign(
        self, tracks: np.ndarray, detections: np.ndarray, costs: np.ndarray, shape: Tuple[int, int]
    ) -> np.ndarray:
        """See AssignmentMethod."""
        if len(costs) == 0:
            return np.zeros(0, dtype=int)
        # A forbidden pair costs more than any change of the allowed ones can save.
        forbidden = (np.ptp(costs) + 1.0) * (min(shape) + 1) + np.max(costs)
        matrix = np.full(shape, forbidden)
        candidate = np.full(shape, -1)
        matrix[tracks, detections] = costs
        candidate[tracks, detections] = np.arange(len(costs))
        chosen = candidate[linear_sum_assignment(matrix)]
        return chosen[chosen >= 0]
