"""Where callbacks leave what they were told and one worker takes it: bounded, so that no queue grows unseen."""

from __future__ import annotations

import threading
from collections import Counter, deque
from typing import Any, Deque, Dict, List, NamedTuple, Optional

SHED = "shed: tracker too slow"


class Entry(NamedTuple):
    """What was put.

    Attributes:
        item: as put.
        at_ns: arrival.
        turn: counts the entries.
    """

    item: Any
    at_ns: int
    turn: int


class Intake:
    """A queue for each source; its oldest is shed when there are too many. Thread-safe.

    Args:
        capacity: of each queue.
        sources: most queues; what comes of a source beyond them is shed.
    """

    def __init__(self, capacity: int, sources: int) -> None:
        self._capacity, self._sources = capacity, sources
        self._queues: Dict[str, Deque[Entry]] = {}
        self._shed: Counter = Counter()
        self._turns = 0
        self._woken = False
        self._changed = threading.Condition()

    def put(self, source: str, item: Any, at_ns: int) -> Optional[Any]:
        """Leave an item; returns what was shed for it, if anything."""
        with self._changed:
            if source not in self._queues and len(self._queues) >= self._sources:
                self._shed[f"lost: {SHED}, of too many sources"] += 1
                return item
            queue = self._queues.setdefault(source, deque())
            queue.append(Entry(item, at_ns, self._turns))
            self._turns += 1
            self._changed.notify()
            if len(queue) <= self._capacity:
                return None
            self._shed[f"{source}: lost: {SHED}"] += 1
            return queue.popleft().item

    def take(self, timeout_s: Optional[float]) -> List[Entry]:
        """All that is there in order of arrival; waits until there is something, `wake` is called or time is over."""
        with self._changed:
            self._changed.wait_for(lambda: self._woken or self._queues, timeout_s)
            self._woken = False
            entries = [entry for queue in self._queues.values() for entry in queue]
            self._queues.clear()
        return sorted(entries, key=lambda entry: entry.turn)

    def wake(self) -> None:
        """Let `take` return."""
        with self._changed:
            self._woken = True
            self._changed.notify()

    def counters(self) -> Dict[str, int]:
        """What was shed since the start, by source."""
        with self._changed:
            return dict(self._shed)
