"""The contract of all policies for measurements that arrive late and out of order."""

from __future__ import annotations

import abc
from typing import Dict

from people_fusion.core.measurements import Measurement
from people_fusion.core.registry import Registry
from people_fusion.tracking.tracker import Tracker


class BufferPolicy(abc.ABC):
    """Stands between cues and tracker. Built as ``cls(config, tracker=tracker)``; called from one thread."""

    tracker: Tracker

    @abc.abstractmethod
    def push(self, measurement: Measurement, now_ns: int) -> bool:
        """Take a measurement that arrived at `now_ns`; True if the tracker's state changed."""

    @abc.abstractmethod
    def reset(self) -> None:
        """Time has jumped: forget what is buffered (the tracker is reset by the caller)."""

    def counters(self) -> Dict[str, int]:
        """Events since the start, by name, for diagnostics."""
        return {}


BUFFERS: Registry[BufferPolicy] = Registry("buffer policy", "people_fusion.tracking.buffers")
