"""Waits only for what is announced and older (the improved dynamic buffer of Poschmann 2018, 7.4).

As in the thesis the oldest goes when it is ready and every other cue has announced its next. The thesis waits for that
next announcement even from a cue whose sensor cannot speak yet; with `anticipate` such a cue is not waited for.
"""

from __future__ import annotations

from dataclasses import dataclass

from people_fusion.core.config import parameter
from people_fusion.core.measurements import Measurement
from people_fusion.tracking.buffer import BUFFERS, BufferConfig, BufferPolicy


@dataclass(frozen=True)
class AnnouncedConfig(BufferConfig):
    """What is waited for."""

    anticipate: bool = parameter(
        True, "do not wait for a cue's next announcement before its period has passed; false: as in the thesis"
    )


@BUFFERS.register("announced", AnnouncedConfig)
class Announced(BufferPolicy):
    """In order, and no slower than the slowest older message that is being worked on."""

    config: AnnouncedConfig

    def _may_go(self, oldest: Measurement, now_ns: int) -> bool:
        place = oldest.order
        for cue, member in self.roster.members.items():
            if not member.stalled and any(order < place for order in member.pending):
                return False
            if cue != oldest.cue and self.roster.awaited(cue, now_ns):
                told_ns = member.soonest_ns if self.config.anticipate else member.newest_ns
                if told_ns is None or told_ns < oldest.stamp_ns:
                    return False
        return True
