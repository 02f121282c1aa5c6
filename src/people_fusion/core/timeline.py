"""Whether the stamps of messages can be believed, and when time has jumped; the same for live nodes and recordings.

One scan that is stamped a year ahead is a mistake of that scan. Two of a stream in a row that agree with each other are
a clock that was set, or a recording that begins again.
"""

from __future__ import annotations

from typing import Callable, Dict, NamedTuple

from people_fusion.core.errors import DataError
from people_fusion.core.stamps import from_seconds, to_seconds

CLOCK = "clock"  # the stream of the graph's own clock, which makes no mistakes
DISORDER_NS = from_seconds(1.0)  # what is older than its predecessor by less is merely out of order
PAUSE_NS = from_seconds(10.0)  # what is ahead by less is a pause: recordings are also played faster than real time
GRACE_NS = from_seconds(2.0)  # how long after a jump messages of before may still come

DOUBTED = "stamp far from those before it"
LEFT_OVER = "left over from before a time jump"


class _Seen(NamedTuple):
    stamp_ns: int
    at_ns: int  # on the clock that never jumps


class Timeline:
    """Stamps of several streams, each of which may be on a clock of its own.

    A stamp is ordinary where it follows the newest one of its stream: less than DISORDER_NS before it, and no farther
    ahead than time has passed, give or take DISORDER_NS. Any other waits for the next message of the stream. If that
    agrees with it, it was right, and is a jump where it goes back, or ahead by more than PAUSE_NS; then everything
    starts anew. If not, it was a mistake. Meanwhile it is refused, unless it is but a pause.

    After a jump, what is under way in other streams is refused for GRACE_NS.

    Args:
        jumped: called with the seconds that the clock was set back by, negative where it was set ahead, before the
            message that shows it is admitted.
        elapsed_ns: nanoseconds on a clock that never jumps: of the wall when live, of arrival in a recording.
    """

    def __init__(self, jumped: Callable[[float], None], elapsed_ns: Callable[[], int]) -> None:
        self._jumped, self._elapsed_ns = jumped, elapsed_ns
        self._newest: Dict[str, _Seen] = {}
        self._doubted: Dict[str, _Seen] = {}
        self._moved: Dict[str, int] = {}  # by stream: when it jumped
        self._limits: Dict[str, int] = {}  # by stream that has not jumped yet: half way to the new time
        self._went_back = True
        self._grace_ends_ns = 0

    def admit(self, stream: str, stamp_ns: int, witness: bool = True) -> bool:
        """Whether to take a message; see `require`."""
        try:
            self.require(stream, stamp_ns, witness)
        except DataError:
            return False
        return True

    def require(self, stream: str, stamp_ns: int, witness: bool = True) -> None:
        """Take a message.

        Args:
            stream: messages of one stream are roughly in order.
            stamp_ns: of the message.
            witness: whether this stream is to be believed when it jumps; tf is not, it has many authors, and may go
                back as it likes.

        Raises:
            DataError: the message is left over from before a jump, or its stamp is doubted.
        """
        seen = _Seen(stamp_ns, self._elapsed_ns())
        if self._is_left_over(stream, seen):
            raise DataError(LEFT_OVER, stream)
        newest = self._newest.get(stream, seen)
        step_ns, passed_ns = stamp_ns - newest.stamp_ns, seen.at_ns - newest.at_ns
        may_be_back = not witness
        may_be_ahead = stream == CLOCK
        if (step_ns >= -DISORDER_NS or may_be_back) and (step_ns <= passed_ns + DISORDER_NS or may_be_ahead):
            self._doubted.pop(stream, None)
            self._newest[stream] = _Seen(max(newest.stamp_ns, stamp_ns), seen.at_ns)
            return
        is_jump = step_ns < 0 or step_ns > passed_ns + PAUSE_NS
        if stream != CLOCK and not self._agrees_with_doubted(stream, seen):
            self._doubted[stream] = seen
            if is_jump:
                raise DataError(DOUBTED, f"{stream}: {to_seconds(step_ns):+.3f} s")
            return
        if is_jump:
            self._moved[stream] = seen.at_ns
        if is_jump and witness:
            self._jump(step_ns, seen.at_ns)
            self._jumped(to_seconds(passed_ns - step_ns))
        self._doubted.pop(stream, None)
        self._newest[stream] = seen

    def newest_ns(self, stream: str) -> int:
        """The newest stamp of a stream that is beyond doubt; at least one was admitted."""
        return self._newest[stream].stamp_ns

    def _agrees_with_doubted(self, stream: str, seen: _Seen) -> bool:
        doubted = self._doubted.get(stream)
        if doubted is None:
            return False
        step_ns, passed_ns = seen.stamp_ns - doubted.stamp_ns, seen.at_ns - doubted.at_ns
        return -DISORDER_NS <= step_ns <= passed_ns + PAUSE_NS

    def _jump(self, step_ns: int, at_ns: int) -> None:
        moved = {name for name, since_ns in self._moved.items() if at_ns - since_ns < GRACE_NS}
        self._limits = {name: seen.stamp_ns + step_ns // 2 for name, seen in self._newest.items() if name not in moved}
        self._went_back = step_ns < 0
        self._grace_ends_ns = at_ns + GRACE_NS
        self._newest.clear()
        self._doubted.clear()

    def _is_left_over(self, stream: str, seen: _Seen) -> bool:
        limit_ns = self._limits.get(stream)
        if limit_ns is None:
            return False
        if seen.at_ns < self._grace_ends_ns and (seen.stamp_ns >= limit_ns) == self._went_back:
            return True
        del self._limits[stream]
        return False
