"""The message of one sensor that was taken nearest to one of another, without waiting for any."""

from __future__ import annotations

import threading
from collections import deque
from typing import Deque, Generic, Optional, Tuple, TypeVar

from people_fusion.core.stamps import from_seconds

T = TypeVar("T")


class NearestInTime(Generic[T]):
    """Keeps the newest messages of a sensor; thread-safe.

    Args:
        tolerance_s: those that were taken farther apart are no pair, seconds.
        capacity: messages that are kept.
    """

    def __init__(self, tolerance_s: float, capacity: int = 4) -> None:
        self._tolerance_ns = from_seconds(tolerance_s)
        self._newest: Deque[Tuple[int, T]] = deque(maxlen=capacity)
        self._lock = threading.Lock()

    def put(self, stamp_ns: int, item: T) -> None:
        """A message came; the oldest goes if there are too many."""
        with self._lock:
            self._newest.append((stamp_ns, item))

    def at(self, stamp_ns: int) -> Optional[T]:
        """That of the nearest stamp, the later one of two; None if none is within the tolerance."""
        with self._lock:
            newest = list(self._newest)
        near = [(abs(stamp - stamp_ns), -stamp, item) for stamp, item in newest]
        gap_ns, _, item = min(near, key=lambda each: each[:2], default=(self._tolerance_ns + 1, 0, None))
        return item if gap_ns <= self._tolerance_ns else None

    def clear(self) -> None:
        """Time has jumped: forget all."""
        with self._lock:
            self._newest.clear()
