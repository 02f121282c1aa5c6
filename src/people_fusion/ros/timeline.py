"""Notices that time has jumped back, as in a bag that loops, and keeps out what was still under way before the jump."""

from __future__ import annotations

import time
from typing import Callable, Dict

from people_fusion.core.stamps import from_seconds, to_seconds

THRESHOLD_S = 1.0  # what is older than its predecessor by less is merely out of order
GRACE_S = 2.0  # by the wall: how long after a jump messages of before may still come


class Timeline:
    """Stamps of several streams on one clock.

    Args:
        jumped: called with the seconds that time went back by, before the message that shows it is admitted.
        monotonic: seconds on a clock that never jumps.
    """

    def __init__(self, jumped: Callable[[float], None], monotonic: Callable[[], float] = time.monotonic) -> None:
        self._jumped, self._monotonic = jumped, monotonic
        self._newest: Dict[str, int] = {}
        self._limits: Dict[str, int] = {}  # by stream that has not jumped yet: half way back
        self._grace_ends = 0.0

    def admit(self, stream: str, stamp_ns: int, witness: bool = True) -> bool:
        """Whether to take a message; False where it is left over from before a jump.

        Args:
            stream: messages of one stream are roughly in order.
            stamp_ns: of the message.
            witness: whether this stream is to be believed when it goes back; tf is not, it has many authors.
        """
        limit = self._limits.pop(stream, None)
        if limit is not None and stamp_ns >= limit and self._monotonic() < self._grace_ends:
            self._limits[stream] = limit
            return False
        newest = self._newest.get(stream, stamp_ns)
        if witness and stamp_ns < newest - from_seconds(THRESHOLD_S):
            back_ns = newest - stamp_ns
            self._limits = {name: last - back_ns // 2 for name, last in self._newest.items() if name != stream}
            self._grace_ends = self._monotonic() + GRACE_S
            self._newest = {}
            newest = stamp_ns
            self._jumped(to_seconds(back_ns))
        self._newest[stream] = max(newest, stamp_ns)
        return True
