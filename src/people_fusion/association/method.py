"""The contract of all assignment methods."""

from __future__ import annotations

import abc
from typing import Tuple

import numpy as np

from people_fusion.core.registry import Registry


class AssignmentMethod(abc.ABC):
    """Chooses which track each detection belongs to, one to one."""

    @abc.abstractmethod
    def assign(
        self, tracks: np.ndarray, detections: np.ndarray, costs: np.ndarray, shape: Tuple[int, int]
    ) -> np.ndarray:
        """Chosen pairs as indices (M,) into the candidates; no track and no detection is chosen twice.

        Args:
            tracks: (K,) track of each candidate pair that the gate lets pass.
            detections: (K,) its detection.
            costs: (K,) its cost; leaving both alone costs 0, so that only negative costs are worth a pair.
            shape: how many tracks and detections there are.
        """


ASSIGNMENT_METHODS: Registry[AssignmentMethod] = Registry("assignment method", "people_fusion.association.methods")
