"""The contract of all motion models."""

from __future__ import annotations

import abc
from typing import ClassVar, Tuple

import numpy as np

from people_fusion.core.registry import Registry


class MotionModel(abc.ABC):
    """How people move when nobody looks. The state begins with x y z vx vy; a model may add vz.

    Attributes:
        dimension: number of states D.
        initial_covariance: (D, D) of a new track's state before its first measurement is used. What the first
            measurement does not observe keeps it.
    """

    dimension: ClassVar[int]
    initial_covariance: np.ndarray

    @abc.abstractmethod
    def transition(self, duration_s: float) -> Tuple[np.ndarray, np.ndarray]:
        """Transition matrix (D, D) and process noise (D, D) over a duration, seconds, not negative."""


MOTION_MODELS: Registry[MotionModel] = Registry("motion model", "people_fusion.filtering.motion_models")
