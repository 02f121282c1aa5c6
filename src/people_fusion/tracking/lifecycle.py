"""The contract of all lifecycles: when a track is believed to be a person, and when it ends."""

from __future__ import annotations

import abc
from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np

from people_fusion.core.measurements import Measurement
from people_fusion.core.registry import Registry
from people_fusion.tracking.table import TrackTable


@dataclass(frozen=True, eq=False)
class Evidence:
    """What one measurement says of each track.

    Attributes:
        measurement: the measurement itself, for its cue, modality and period.
        stamp_ns: the tracker's stamp, which a late measurement does not move.
        duration_s: since the measurement before.
        matched: (T,) bool.
        new: (T,) bool, tracks that this measurement started; they count as matched.
        confidences: (T,) of the matched detections, 0 elsewhere.
        log_likelihoods: (T,) log density of the matched innovations in 1/m^m, 0 elsewhere.
        visible: (T,) in [0, 1], share of the person that the sensor could see.
        confirming: (T,) bool, matched in a way that may make a person of a track; None: wherever it is matched.
        testimony: (T,) log odds that a cue which can tell people adds to a person being there; None: nothing.
    """

    measurement: Measurement
    stamp_ns: int
    duration_s: float
    matched: np.ndarray
    new: np.ndarray
    confidences: np.ndarray
    log_likelihoods: np.ndarray
    visible: np.ndarray
    confirming: Optional[np.ndarray] = None
    testimony: Optional[np.ndarray] = None


@dataclass(frozen=True, eq=False)
class Verdict:
    """existence (T,), memory (T, ...), confirmed (T,), alive (T,) and still (T,) after a measurement."""

    existence: np.ndarray
    memory: np.ndarray
    confirmed: np.ndarray
    alive: np.ndarray
    still: np.ndarray


class Lifecycle(abc.ABC):
    """Stateless: all that it remembers of a track is a row of the table's memory, zero when a track begins.

    Attributes:
        memory: shape of that row.
    """

    memory: Tuple[int, ...]

    @abc.abstractmethod
    def judge(self, table: TrackTable, evidence: Evidence) -> Verdict:
        """What becomes of the tracks in `table`, whose states have been updated with the measurement already."""


LIFECYCLES: Registry[Lifecycle] = Registry("lifecycle", "people_fusion.tracking.lifecycles")
