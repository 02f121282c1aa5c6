"""The contract of all policies for measurements that arrive late and out of order.

A policy decides when a measurement may be processed; it knows no tracker and reads no clock. Cues announce sensor
messages the moment they arrive (Poschmann 2018, 7.4), and deliver the measurements when they are ready. What a policy
hands out is in order of stamps, but for what came too late for its place: that is handed out at once, to be put in its
place by whoever keeps the tracker's past (tracking.rewind), or dropped and counted.
"""

from __future__ import annotations

import bisect
from collections import Counter
from dataclasses import dataclass
from typing import ClassVar, Dict, List, Optional, Tuple, Union

from people_fusion.core.config import parameter
from people_fusion.core.measurements import Announcement, Measurement, Order
from people_fusion.core.registry import Registry
from people_fusion.core.stamps import from_seconds
from people_fusion.tracking.roster import Roster

LATE = ("drop", "predict_forward", "reprocess")


@dataclass(frozen=True)
class BufferConfig:
    """What all policies have in common."""

    patience_s: float = parameter(0.3, "nothing waits for longer, seconds", low=0.0, high=10.0)
    late: str = parameter(
        "reprocess",
        "what came too late for its place: `drop` it, `predict_forward` (Volkhardt 2013, III-C 3), or `reprocess`: go "
        "back and process it and all later ones again (Poschmann 2018, 3.2)",
        choices=LATE,
    )
    horizon_s: float = parameter(1.0, "what is later than this is dropped, seconds", low=0.0)
    capacity: int = parameter(256, "most measurements that wait, and most snapshots that are kept", low=1)
    replays_per_s: int = parameter(1000, "reprocessing more measurements than this in a second is shed", low=1)
    ahead_s: float = parameter(
        0.3, "a stamp that is farther ahead of the clock is refused; nearer, it waits for its time, seconds", low=0.0
    )
    cues: Tuple[str, ...] = parameter((), "cues that are waited for from the start; others by their first message")


class BufferPolicy:
    """Stands between cues and tracker. Built as ``cls(config)``; called from one thread.

    Attributes:
        revisable: whether users shall also get a guess at once, made of what still waits.
    """

    revisable: ClassVar[bool] = False

    def __init__(self, config: BufferConfig) -> None:
        self.config = config
        self.roster = Roster(config.patience_s, config.ahead_s, config.capacity, config.cues)
        self._patience_ns = from_seconds(config.patience_s)
        self._horizon_ns = from_seconds(config.horizon_s)
        self._orders: List[Order] = []
        self._held: List[Measurement] = []
        self._since_ns: List[int] = []
        self._newest_ns: Optional[int] = None
        self._counts: Counter = Counter()

    def push(self, item: Union[Announcement, Measurement], now_ns: int) -> List[Measurement]:
        """Take an announcement or a measurement that arrived at `now_ns`, on the clock of the stamps.

        Returns:
            What may be processed now, in order; what is older than anything handed out before came too late.
        """
        if isinstance(item, Announcement):
            self.roster.announce(item, now_ns)
        elif self.roster.deliver(item, now_ns):
            place = bisect.bisect_right(self._orders, item.order)
            self._orders.insert(place, item.order)
            self._held.insert(place, item)
            self._since_ns.insert(place, now_ns)
        return self.poll(now_ns)

    def poll(self, now_ns: int) -> List[Measurement]:
        """What may be processed now that time has passed; see `push`."""
        self.roster.expire(now_ns)
        released: List[Measurement] = []
        forced = self._forced(now_ns)
        while self._held and (forced > 0 or self._is_late() or self._is_due(now_ns)):
            forced -= 1
            released += self._release()
        return released

    def sleep_ns(self, now_ns: int) -> Optional[int]:
        """Nanoseconds after which `poll` should be called unless something arrives before; None: no need."""
        if not self._held:
            return None
        ends = [min(self._since_ns) + self._patience_ns, *self.roster.changes_ns(), *self._changes_ns()]
        ends.append(self._held[0].stamp_ns - 1)
        return min((end + 1 - now_ns for end in ends if end >= now_ns), default=0)

    @property
    def held(self) -> Tuple[Measurement, ...]:
        """What was delivered and waits, in order."""
        return tuple(self._held)

    def reset(self) -> None:
        """Time has jumped: what waits is lost and counted, cues are learned anew."""
        self._count("waited when time jumped", len(self._held))
        self._orders.clear()
        self._held.clear()
        self._since_ns.clear()
        self._newest_ns = None
        self.roster.reset()

    def counters(self) -> Dict[str, int]:
        """Events since the start, by name, for diagnostics."""
        return {**self._counts, **self.roster.counters()}

    def _may_go(self, oldest: Measurement, now_ns: int) -> bool:  # noqa: ARG002
        """Whether the oldest that waits may be processed before its patience is at its end."""
        return True

    def _changes_ns(self) -> List[int]:
        """Times after which `_may_go` may change without the roster's doing."""
        return []

    def _forced(self, now_ns: int) -> int:
        """How many must go: patience is at its end for one of them, or there are too many."""
        impatient = [place for place, since in enumerate(self._since_ns) if now_ns - since > self._patience_ns]
        too_many = len(self._held) - self.config.capacity
        if too_many > 0:
            self._count("released early: too many waited", too_many)
        return max(impatient[-1] + 1 if impatient else 0, too_many)

    def _is_due(self, now_ns: int) -> bool:
        oldest = self._held[0]
        return oldest.stamp_ns <= now_ns and self._may_go(oldest, now_ns)

    def _is_late(self) -> bool:
        return self._newest_ns is not None and self._orders[0][0] < self._newest_ns

    def _release(self) -> List[Measurement]:
        late = self._is_late()
        measurement = self._held.pop(0)
        self._orders.pop(0)
        self._since_ns.pop(0)
        if not late:
            self._newest_ns = measurement.stamp_ns
            return [measurement]
        assert self._newest_ns is not None
        if self.config.late == "drop":
            self._count("late measurements dropped")
            return []
        if measurement.stamp_ns < self._newest_ns - self._horizon_ns:
            self._count("measurements beyond the horizon dropped")
            return []
        self._count("late measurements")
        return [measurement]

    def _count(self, event: str, times: int = 1) -> None:
        if times:
            self._counts[event] += times


BUFFERS: Registry[BufferPolicy] = Registry("buffer policy", "people_fusion.tracking.buffers")
