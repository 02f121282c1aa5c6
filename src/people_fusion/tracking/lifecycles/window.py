"""Confidence from the confirmations of the last second (Poschmann 2018, 3.2.2, eq. 3.7)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.stamps import from_seconds
from people_fusion.tracking.lifecycle import LIFECYCLES, Evidence, Lifecycle, Verdict
from people_fusion.tracking.table import TrackTable


@dataclass(frozen=True)
class WindowConfig:
    """Eq. 3.7; the defaults are those of the thesis for laser and camera together."""

    window_s: float = parameter(1.0, "length of the window, and time without observation that ends a track", low=0.01)
    reliabilities: Dict[str, float] = parameter(
        {"legs": 0.1, "face": 0.8, "upper_body": 0.8, "head": 0.8}, "r_o by modality", low=0.0, high=1.0
    )
    confirm_above: float = parameter(0.85, "lambda_h: a track with more confidence is a person", low=0.0)
    lose_below: float = parameter(0.2, "lambda_n: a person with less confidence is none any more", low=0.0)
    capacity: int = parameter(64, "observations remembered per track; at least the rate of all cues", low=1, high=1000)


@LIFECYCLES.register("window", WindowConfig)
class Window(Lifecycle):
    """Memory of a track: stamps (nanoseconds, as doubles, exact to a microsecond) and worths r_o / f_o."""

    def __init__(self, config: WindowConfig) -> None:
        self.config = config
        self.memory = (2, config.capacity)
        self._window_ns = from_seconds(config.window_s)

    def judge(self, table: TrackTable, evidence: Evidence) -> Verdict:
        """See Lifecycle."""
        config, measurement = self.config, evidence.measurement
        memory = table.memory
        hit = evidence.matched
        if hit.any():
            memory = memory.copy()
            memory[hit, :, :-1] = memory[hit, :, 1:]
            memory[hit, 0, -1] = measurement.stamp_ns
            memory[hit, 1, -1] = config.reliabilities.get(measurement.modality, 0.0) * measurement.period_s
        recent = memory[:, 0] > evidence.stamp_ns - self._window_ns
        confidence = np.where(recent, memory[:, 1], 0.0).sum(axis=1)  # eq. 3.7
        confirmed = (confidence > config.confirm_above) | (table.confirmed & (confidence >= config.lose_below))
        alive = evidence.stamp_ns - table.seen_ns < self._window_ns
        return Verdict(np.minimum(confidence, 1.0), memory, confirmed & alive, alive, table.still)
