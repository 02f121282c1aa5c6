"""A bounded room where sensor messages wait for what they need, without one cue holding up another."""

from __future__ import annotations

import bisect
from collections import Counter
from dataclasses import dataclass
from typing import Callable, Dict, Generic, Iterable, List, Tuple, TypeVar

from people_fusion.core.errors import TransformUnavailable
from people_fusion.core.stamps import from_seconds
from people_fusion.core.transforms import TransformSource

T = TypeVar("T")

NEVER = "transform will not arrive"
LATE = "transform did not arrive in time"
FULL = "too many messages waited for a transform"
JUMPED = "time jumped while waiting for a transform"


@dataclass(frozen=True, eq=False)
class _Guest(Generic[T]):
    item: T
    stamp_ns: int
    since_ns: int
    turn: int

    def __lt__(self, other: _Guest[T]) -> bool:
        return (self.stamp_ns, self.turn) < (other.stamp_ns, other.turn)


class WaitingRoom(Generic[T]):
    """Items wait, cue by cue in order of stamps, until they are ready or patience has run out.

    Reads no clock: `now_ns` is an argument and should not go back; if time jumps, call `reset`. Not thread-safe.

    Args:
        ready: whether an item's needs are met by now. May raise TransformUnavailable with `may_arrive` false: then the
            item is given up at once.
        patience_s: an item that has waited longer is given up, seconds.
        capacity: items that may wait per cue; beyond it the oldest is given up.
        gave_up: told of each item that is given up, but for those of a reset.
    """

    def __init__(
        self,
        ready: Callable[[T], bool],
        patience_s: float,
        capacity: int = 50,
        gave_up: Callable[[T], None] = lambda _item: None,
    ) -> None:
        self._ready, self._gave_up = ready, gave_up
        self._patience_ns = from_seconds(patience_s)
        self._capacity = capacity
        self._queues: Dict[str, List[_Guest[T]]] = {}
        self._turns = 0
        self._lost: Counter[str] = Counter()

    def __len__(self) -> int:
        return sum(map(len, self._queues.values()))

    def push(self, cue: str, stamp_ns: int, item: T, now_ns: int) -> None:
        """Let an item of `cue` wait from `now_ns` on."""
        queue = self._queues.setdefault(cue, [])
        bisect.insort(queue, _Guest(item, stamp_ns, now_ns, self._turns))
        self._turns += 1
        if len(queue) > self._capacity:
            self._lose(queue.pop(0), FULL)

    def poll(self, now_ns: int) -> List[T]:
        """The items that are ready, ordered by stamp.

        An item overtakes an older one of its own cue only when its patience is at its end.

        Afterwards nobody is left who has waited longer than the patience.
        """
        released: List[Tuple[int, str, T]] = []
        for cue, queue in self._queues.items():
            waiting: List[_Guest[T]] = []
            for guest in queue:
                impatient = now_ns - guest.since_ns > self._patience_ns
                if waiting and not impatient:  # does not overtake
                    waiting.append(guest)
                    continue
                try:
                    if self._ready(guest.item):
                        released.append((guest.stamp_ns, cue, guest.item))
                    elif impatient:
                        self._lose(guest, LATE)
                    else:
                        waiting.append(guest)
                except TransformUnavailable:
                    self._lose(guest, NEVER)
            self._queues[cue] = waiting
        released.sort(key=lambda entry: entry[:2])
        return [item for _, _, item in released]

    def counters(self) -> Dict[str, int]:
        """Items that were given up since the start, by reason."""
        return dict(self._lost)

    def reset(self) -> None:
        """Time has jumped: whoever waits is given up; the counters stay."""
        if self:
            self._lost[JUMPED] += len(self)
        self._queues.clear()

    def _lose(self, guest: _Guest[T], reason: str) -> None:
        self._lost[reason] += 1
        self._gave_up(guest.item)


def transforms_ready(source: TransformSource, target_frame: str, source_frame: str, stamps_ns: Iterable[int]) -> bool:
    """Whether target_from_source can be looked up at all stamps, e.g. those of a scan's first and last beam.

    Raises:
        TransformUnavailable: with `may_arrive` false, where waiting cannot help.
    """
    for stamp_ns in stamps_ns:
        try:
            source.lookup(target_frame, source_frame, stamp_ns)
        except TransformUnavailable as unavailable:
            if not unavailable.may_arrive:
                raise
            return False
    return True
