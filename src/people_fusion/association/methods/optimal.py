"""Global nearest neighbour: the assignment of least total cost."""

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
        # Zero stands for leaving alone: any set of pairs can be filled up with zeros to a full assignment.
        matrix = np.zeros(shape)
        candidate = np.full(shape, -1)
        matrix[tracks, detections] = np.minimum(costs, 0.0)
        candidate[tracks, detections] = np.arange(len(costs))
        chosen = candidate[linear_sum_assignment(matrix)]
        chosen = chosen[chosen >= 0]
        return chosen[costs[chosen] < 0]
