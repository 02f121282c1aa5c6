"""Late measurements are dropped."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Dict

from people_fusion.core.measurements import Measurement
from people_fusion.tracking.buffer import BUFFERS, BufferPolicy
from people_fusion.tracking.tracker import Tracker


@dataclass(frozen=True)
class DropConfig:
    """Nothing to choose."""


@BUFFERS.register("drop", DropConfig)
class Drop(BufferPolicy):
    """What is older than the tracker's stamp is counted and lost."""

    def __init__(self, config: DropConfig, tracker: Tracker) -> None:
        self.config, self.tracker = config, tracker
        self._counts: Counter = Counter()

    def push(self, measurement: Measurement, now_ns: int) -> bool:
        """See BufferPolicy."""
        del now_ns
        if self.tracker.stamp_ns is not None and measurement.stamp_ns < self.tracker.stamp_ns:
            self._counts["late measurements dropped"] += 1
            return False
        self.tracker.process(measurement)
        return True

    def reset(self) -> None:
        """See BufferPolicy."""

    def counters(self) -> Dict[str, int]:
        """See BufferPolicy."""
        return dict(self._counts)
