"""Late measurements are put in their place and all later ones are processed again (Poschmann 2018, 3.2)."""

from __future__ import annotations

import bisect
from collections import Counter
from dataclasses import dataclass
from typing import Any, Dict, List, Tuple

from people_fusion.core.config import parameter
from people_fusion.core.measurements import Measurement
from people_fusion.core.stamps import from_seconds
from people_fusion.tracking.buffer import BUFFERS, BufferPolicy
from people_fusion.tracking.tracker import Tracker


@dataclass(frozen=True)
class ReprocessConfig:
    """How far back, and how much memory that may take."""

    horizon_s: float = parameter(1.0, "a measurement later than this is dropped, seconds", low=0.0)
    capacity: int = parameter(256, "most measurements and snapshots that are kept", low=1)


@BUFFERS.register("reprocess", ReprocessConfig)
class Reprocess(BufferPolicy):
    """Keeps each measurement of the horizon with the tracker's state before it.

    Measurements are ordered by stamp, cue and sequence, so that any order of arrival gives the sorted run's result.
    """

    def __init__(self, config: ReprocessConfig, tracker: Tracker) -> None:
        self.config, self.tracker = config, tracker
        self._horizon_ns = from_seconds(config.horizon_s)
        self._orders: List[Tuple[int, str, int]] = []
        self._history: List[Tuple[Measurement, Any]] = []
        self._forgot = False
        self._counts: Counter = Counter()

    def push(self, measurement: Measurement, now_ns: int) -> bool:
        """See BufferPolicy."""
        del now_ns
        place = bisect.bisect_right(self._orders, measurement.order)
        newest = self._orders[-1][0] if self._orders else measurement.stamp_ns
        too_late = measurement.stamp_ns < newest - self._horizon_ns
        if too_late or (place == 0 and self._forgot):
            self._counts["measurements beyond the horizon dropped"] += 1
            return False
        again = [entry for entry, _ in self._history[place:]]
        if again:
            self._counts["late measurements reprocessed"] += 1
            self.tracker.restore(self._history[place][1])
            del self._orders[place:], self._history[place:]
        for entry in [measurement, *again]:
            self._orders.append(entry.order)
            self._history.append((entry, self.tracker.snapshot()))
            self.tracker.process(entry)
        self._forget()
        return True

    def reset(self) -> None:
        """See BufferPolicy."""
        self._orders.clear()
        self._history.clear()
        self._forgot = False

    def counters(self) -> Dict[str, int]:
        """See BufferPolicy."""
        return dict(self._counts)

    def _forget(self) -> None:
        keep_from = bisect.bisect_left(self._orders, (self._orders[-1][0] - self._horizon_ns, "", -1))
        keep_from = max(keep_from, len(self._orders) - self.config.capacity)
        if keep_from > 0:
            del self._orders[:keep_from], self._history[:keep_from]
            self._forgot = True
