"""The oldest goes when every cue has delivered (the naive dynamic buffer of Poschmann 2018, 7.4)."""

from __future__ import annotations

from dataclasses import dataclass

from people_fusion.core.measurements import Measurement
from people_fusion.tracking.buffer import BUFFERS, BufferConfig, BufferPolicy


@dataclass(frozen=True)
class DynamicConfig(BufferConfig):
    """Only patience."""


@BUFFERS.register("dynamic", DynamicConfig)
class Dynamic(BufferPolicy):
    """Waits for a measurement of every cue that is alive; as slow as the slowest cue, and in order."""

    def _may_go(self, oldest: Measurement, now_ns: int) -> bool:  # noqa: ARG002
        waiting = {measurement.cue for measurement in self._held}
        return all(
            cue in waiting or member.withdrew or not self.roster.awaited(cue, now_ns)
            for cue, member in self.roster.members.items()
        )
