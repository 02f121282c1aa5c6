"""How often a sensor measures, from the stamps of what it sent."""

from __future__ import annotations

from collections import deque
from typing import Deque, Optional

from people_fusion.core.stamps import to_seconds

REMEMBERED = 11


class Periods:
    """The last times between a sensor's messages."""

    def __init__(self) -> None:
        self._newest_ns: Optional[int] = None
        self._periods_s: Deque[float] = deque(maxlen=REMEMBERED)

    def note(self, stamp_ns: int) -> Optional[float]:
        """Take notice of a stamp, and the median of the last periods, seconds; None where there is none yet.

        Stamps that do not advance say nothing.
        """
        if self._newest_ns is None or stamp_ns > self._newest_ns:
            if self._newest_ns is not None:
                self._periods_s.append(to_seconds(stamp_ns - self._newest_ns))
            self._newest_ns = stamp_ns
        if not self._periods_s:
            return None
        return sorted(self._periods_s)[len(self._periods_s) // 2]

    def reset(self) -> None:
        """Time has jumped."""
        self._newest_ns = None
        self._periods_s.clear()
