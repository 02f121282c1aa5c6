"""Every measurement waits until it is of a fixed age (the buffer that Poschmann 2018, 7.4 begins with)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List

from people_fusion.core.config import parameter
from people_fusion.core.measurements import Measurement
from people_fusion.core.stamps import from_seconds
from people_fusion.tracking.buffer import BUFFERS, BufferConfig, BufferPolicy


@dataclass(frozen=True)
class FixedLagConfig(BufferConfig):
    """How long."""

    lag_s: float = parameter(0.2, "age at which a measurement is processed, seconds", low=0.0, high=10.0)


@BUFFERS.register("fixed_lag", FixedLagConfig)
class FixedLag(BufferPolicy):
    """Simple, steady and rarely right: too short for one cue, too long for the others.

    The age is by the stamp, so clocks have to agree.
    """

    def __init__(self, config: FixedLagConfig) -> None:
        super().__init__(config)
        self._lag_ns = from_seconds(config.lag_s)

    def _may_go(self, oldest: Measurement, now_ns: int) -> bool:
        return now_ns - oldest.stamp_ns >= self._lag_ns

    def _changes_ns(self) -> List[int]:
        return [self._held[0].stamp_ns + self._lag_ns - 1]
