"""Late measurements are predicted to the tracker's stamp (Volkhardt 2013, III-C 3)."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Dict

from people_fusion.core.config import parameter
from people_fusion.core.measurements import Measurement
from people_fusion.core.stamps import from_seconds
from people_fusion.tracking.buffer import BUFFERS, BufferPolicy
from people_fusion.tracking.tracker import Tracker


@dataclass(frozen=True)
class PredictForwardConfig:
    """How late is too late."""

    horizon_s: float = parameter(1.0, "a measurement later than this is dropped, seconds", low=0.0)


@BUFFERS.register("predict_forward", PredictForwardConfig)
class PredictForward(BufferPolicy):
    """Everything goes to the tracker at once; the tracker predicts what is late."""

    def __init__(self, config: PredictForwardConfig, tracker: Tracker) -> None:
        self.config, self.tracker = config, tracker
        self._horizon_ns = from_seconds(config.horizon_s)
        self._counts: Counter = Counter()

    def push(self, measurement: Measurement, now_ns: int) -> bool:
        """See BufferPolicy."""
        del now_ns
        stamp_ns = self.tracker.stamp_ns
        if stamp_ns is not None and measurement.stamp_ns < stamp_ns - self._horizon_ns:
            self._counts["measurements beyond the horizon dropped"] += 1
            return False
        self.tracker.process(measurement)
        return True

    def reset(self) -> None:
        """See BufferPolicy."""

    def counters(self) -> Dict[str, int]:
        """See BufferPolicy."""
        return dict(self._counts)
