"""A tracker that can go back: late measurements are put in their place and all later ones are processed again.

Poschmann 2018, 3.2. Association is replayed too, so that a late measurement changes what it would have changed.
"""

from __future__ import annotations

import bisect
from collections import Counter, deque
from contextlib import contextmanager
from typing import Any, Deque, Dict, Iterable, Iterator, List, Optional, Tuple

from people_fusion.core.measurements import Measurement, Order
from people_fusion.core.stamps import NANOSECONDS, from_seconds
from people_fusion.tracking.buffer import BufferConfig
from people_fusion.tracking.tracker import Tracker

_Mark = Tuple[Any, Dict[str, int]]  # the tracker's snapshot and counters


class Rewind:
    """Keeps each measurement of the horizon with the tracker's state before it.

    Measurements are ordered by stamp, cue and sequence, so that any order of arrival gives the sorted run's result.
    The tracker is brought up to date when it is asked for: several late measurements in a row cost one replay.
    """

    def __init__(self, tracker: Tracker, config: BufferConfig) -> None:
        self._tracker, self._config = tracker, config
        self._horizon_ns = from_seconds(config.horizon_s)
        self._counts: Counter = Counter()
        self._undone: Counter = Counter()  # what the tracker counted in what it went back from
        self._start()

    @property
    def tracker(self) -> Tracker:
        """The tracker with everything processed."""
        self._settle(len(self._history))
        return self._tracker

    def process(self, measurement: Measurement) -> bool:
        """Process a measurement in its place; False where it comes too late even for that."""
        if self._config.late != "reprocess":
            self._tracker.process(measurement)
            return True
        place = bisect.bisect_right(self._orders, measurement.order)
        if self._forgotten is not None and measurement.order < self._forgotten:
            self._counts["late measurements dropped: beyond the memory"] += 1
            return False
        if place < self._settled:
            if not self._affordable(self._settled - place):
                self._counts["late measurements shed: reprocessing is over its budget"] += 1
                return False
            self._counts["late measurements reprocessed"] += 1
            self._go_back(self._before[place])
            del self._before[place:]
        self._orders.insert(place, measurement.order)
        self._history.insert(place, measurement)
        self._forget()
        return True

    @contextmanager
    def ahead(self, measurements: Iterable[Measurement]) -> Iterator[None]:
        """Within it the tracker has processed these, too; afterwards nothing but the identities they began is left."""
        tracker = self.tracker
        now = self._mark()
        try:
            for measurement in measurements:
                tracker.process(measurement)
            yield
        finally:
            self._go_back(now)

    def reset(self) -> None:
        """Forget the past; the tracker is reset, too."""
        self._tracker.reset()
        self._start()

    def counters(self) -> Dict[str, int]:
        """Events since the start, by name; of what is processed again the last time counts."""
        tracked = Counter(self._tracker.counters())
        tracked.subtract(self._undone)
        return {**self._counts, **{event: times for event, times in tracked.items() if times}}

    def _start(self) -> None:
        self._orders: List[Order] = []
        self._history: List[Measurement] = []
        self._before: List[_Mark] = []  # the tracker before those entries of the history that are processed
        self._forgotten: Optional[Order] = None  # the newest that was processed for good
        self._replayed: Deque[Tuple[int, int]] = deque()  # newest stamp then, measurements processed again

    @property
    def _settled(self) -> int:
        return len(self._before)

    def _settle(self, count: int) -> None:
        for measurement in self._history[self._settled : count]:
            self._before.append(self._mark())
            self._tracker.process(measurement)

    def _mark(self) -> _Mark:
        return self._tracker.snapshot(), self._tracker.counters()

    def _go_back(self, mark: _Mark) -> None:
        snapshot, counts = mark
        self._undone.update(self._tracker.counters())
        self._undone.subtract(counts)
        self._tracker.restore(snapshot)

    def _affordable(self, replays: int) -> bool:
        newest_ns = self._orders[-1][0]
        while self._replayed and self._replayed[0][0] < newest_ns - NANOSECONDS:
            self._replayed.popleft()
        if replays + sum(count for _, count in self._replayed) > self._config.replays_per_s:
            return False
        self._replayed.append((newest_ns, replays))
        return True

    def _forget(self) -> None:
        keep_from = bisect.bisect_left(self._orders, (self._orders[-1][0] - self._horizon_ns, "", -1))
        keep_from = max(keep_from, len(self._orders) - self._config.capacity)
        if keep_from > 0:
            self._settle(keep_from)
            self._forgotten = self._orders[keep_from - 1]
            del self._orders[:keep_from], self._history[:keep_from], self._before[:keep_from]
