"""Which cues there are, what each has announced, and which of them are worth waiting for.

A cue that is silent or slow, announces without delivering, delivers without announcing, restarts, floods, repeats
itself or stamps into the future neither stalls nor misleads the others; each such event is counted under its name.
"""

from __future__ import annotations

import statistics
from collections import Counter, OrderedDict, deque
from typing import Deque, Dict, Iterable, List, Optional

from people_fusion.core.measurements import Announcement, Measurement, Order
from people_fusion.core.stamps import from_seconds, to_seconds

INTERVALS = 9  # of stamps, by which a cue's period is estimated
KNOWN_AFTER = 3  # intervals
SOONEST = 0.8  # of the shortest interval, and half the patience less at most: the next stamp is not nearer
OVERDUE = 1.5  # periods, and the patience after the soonest at most: then a cue is not waited for until heard again
MOST_CUES = 64
REMEMBERED = 256  # stamps a cue, to know what it repeats


class Member:
    """What is known of one cue.

    Args:
        patience_ns: it delays others for no longer after each of its messages.
        heard_ns: now, if it was heard of.

    Attributes:
        newest_ns: newest stamp that it told of; None before the first.
        soonest_ns: its next stamp is not expected before this; None before the first.
        period_ns: median interval of its stamps; None while it is not known.
        heard_ns: when it was last heard of.
        silence_ns: after which it is not waited for any more.
        lag_ns: how old its last message was when it told of it.
        pending: announced and neither delivered nor withdrawn: order -> when it was announced.
        stalled: it has let an announcement expire, and not delivered in time since, owing nothing older.
        withdrew: nothing comes of the last message that it told of.
    """

    def __init__(self, patience_ns: int, heard_ns: Optional[int] = None) -> None:
        self._patience_ns = patience_ns
        self.newest_ns: Optional[int] = None
        self.soonest_ns: Optional[int] = None
        self.period_ns: Optional[int] = None
        self.heard_ns = heard_ns
        self.silence_ns = patience_ns
        self.lag_ns = 0
        self.pending: OrderedDict[Order, int] = OrderedDict()
        self.stalled = False
        self.withdrew = False
        self.announces = False
        self.sequence = -1
        self.delivered: OrderedDict[int, None] = OrderedDict()
        self.expired: OrderedDict[Order, None] = OrderedDict()
        self._intervals: Deque[int] = deque(maxlen=INTERVALS)

    def tell(self, stamp_ns: int, now_ns: int) -> None:
        """It announced or delivered a message of this stamp."""
        self.heard_ns, self.lag_ns, self.withdrew = now_ns, now_ns - stamp_ns, False
        if self.newest_ns is None:
            self.newest_ns = self.soonest_ns = stamp_ns
        elif stamp_ns > self.newest_ns:
            self._intervals.append(stamp_ns - self.newest_ns)
            self.newest_ns = self.soonest_ns = stamp_ns
            if len(self._intervals) >= KNOWN_AFTER:
                shortest_ns = min(self._intervals)
                soonest_ns = max(int(SOONEST * shortest_ns), shortest_ns - self._patience_ns // 2)
                self.soonest_ns += soonest_ns
                self.period_ns = statistics.median_low(self._intervals)
                self.silence_ns = min(int(OVERDUE * self.period_ns), soonest_ns + self._patience_ns)


class Roster:
    """All cues by name. Reads no clock; not thread-safe.

    Args:
        patience_s: an announcement is waited for no longer, and an unknown cue no longer, seconds.
        ahead_s: a stamp farther ahead of the clock is refused, seconds.
        capacity: announcements a cue that are remembered.
        cues: names of cues that are expected from the start.
    """

    def __init__(self, patience_s: float, ahead_s: float, capacity: int, cues: Iterable[str] = ()) -> None:
        self._patience_ns, self._ahead_ns = from_seconds(patience_s), from_seconds(ahead_s)
        self._capacity = capacity
        self._expected = tuple(cues)
        self._counts: Counter = Counter()
        self.members: Dict[str, Member] = {}
        self.reset()

    def reset(self) -> None:
        """Time has jumped: learn the cues anew; the counters stay."""
        self.members = {name: Member(self._patience_ns) for name in self._expected}

    def announce(self, announcement: Announcement, now_ns: int) -> None:
        """A cue has begun to work on a message, or withdraws it."""
        cue, order = announcement.cue, announcement.order
        if announcement.withdrawn:
            if cue in self.members:
                self.members[cue].pending.pop(order, None)
                self.members[cue].withdrew = not self.members[cue].pending
            return
        if not self._plausible(cue, announcement.stamp_ns, now_ns):
            return
        member = self._member(cue, now_ns)
        if order in member.pending or announcement.stamp_ns in member.delivered:
            self._count(cue, "announced twice" if order in member.pending else "announced after it was delivered")
            return
        self._watch_sequence(cue, member, announcement)
        member.announces = True
        self._tell(cue, member, announcement.stamp_ns, now_ns)
        member.pending[order] = now_ns
        if len(member.pending) > self._capacity:
            self._give_up(cue, member, "too many announcements")

    def deliver(self, measurement: Measurement, now_ns: int) -> bool:
        """A cue delivers; whether to take it. What is not taken is counted as lost."""
        cue = measurement.cue
        if not self._plausible(cue, measurement.stamp_ns, now_ns, "lost: "):
            return False
        member = self._member(cue, now_ns)
        if measurement.stamp_ns in member.delivered:
            member.pending.pop(measurement.order, None)
            self._count(cue, "lost: stamp delivered before")
            return False
        if member.pending.pop(measurement.order, None) is not None:
            owes_older = bool(member.pending) and next(iter(member.pending)) < measurement.order
            member.stalled = member.stalled and owes_older
            member.heard_ns = now_ns
        elif measurement.order in member.expired:
            del member.expired[measurement.order]
            self._count(cue, "delivered after its announcement expired")
        else:
            if member.announces:
                self._count(cue, "delivered without announcing")
            self._tell(cue, member, measurement.stamp_ns, now_ns)
        _remember(member.delivered, measurement.stamp_ns)
        return True

    def expire(self, now_ns: int) -> None:
        """Give up announcements that were not kept, and the hope of cues that never came."""
        for cue, member in self.members.items():
            if member.heard_ns is None:
                member.heard_ns = now_ns
            while member.pending and now_ns - next(iter(member.pending.values())) > self._patience_ns:
                self._give_up(cue, member, "announced without delivering")

    def awaited(self, cue: str, now_ns: int) -> bool:
        """Whether this cue's next message is worth waiting for."""
        member = self.members[cue]
        return not member.stalled and member.lag_ns <= self._patience_ns and now_ns <= self._overdue_ns(member)

    def changes_ns(self) -> List[int]:
        """Times at which an announcement expires or a cue ceases to be waited for."""
        ends = [self._overdue_ns(member) for member in self.members.values() if member.heard_ns is not None]
        pending = (member.pending for member in self.members.values() if member.pending)
        return ends + [next(iter(entries.values())) + self._patience_ns for entries in pending]

    def facts(self, now_ns: int) -> Dict[str, str]:
        """What each cue is like, for diagnostics."""
        described = {}
        for name, member in sorted(self.members.items()):
            period_ns = member.period_ns
            rate = "unknown rate" if period_ns is None else f"{1.0 / to_seconds(max(period_ns, 1)):.1f} Hz"
            state = "stalled" if member.stalled else "alive" if self.awaited(name, now_ns) else "silent"
            described[name] = f"{state}, {rate}, {len(member.pending)} announced"
        return described

    def counters(self) -> Dict[str, int]:
        """Events since the start, by cue and name."""
        return dict(self._counts)

    def _overdue_ns(self, member: Member) -> int:
        assert member.heard_ns is not None
        return member.heard_ns + member.silence_ns

    def _tell(self, cue: str, member: Member, stamp_ns: int, now_ns: int) -> None:
        member.tell(stamp_ns, now_ns)
        if member.lag_ns > self._patience_ns:
            self._count(cue, "older than the patience when first heard of")

    def _give_up(self, cue: str, member: Member, event: str) -> None:
        order, _ = member.pending.popitem(last=False)
        _remember(member.expired, order)
        member.stalled = True
        self._count(cue, event)

    def _member(self, cue: str, now_ns: int) -> Member:
        if cue not in self.members:
            self.members[cue] = Member(self._patience_ns, now_ns)
        return self.members[cue]

    def _plausible(self, cue: str, stamp_ns: int, now_ns: int, prefix: str = "") -> bool:
        if cue not in self.members and len(self.members) >= MOST_CUES:
            self._counts[prefix + "of too many cues"] += 1
            return False
        if stamp_ns > now_ns + self._ahead_ns:
            self._count(cue, prefix + "stamp from the future")
            return False
        return True

    def _watch_sequence(self, cue: str, member: Member, announcement: Announcement) -> None:
        newer = member.newest_ns is None or announcement.stamp_ns > member.newest_ns
        if newer and announcement.sequence < member.sequence:
            self._count(cue, "restarted")
            member.pending.clear()
        elif newer and member.sequence >= 0 and announcement.sequence > member.sequence + 1:
            self._count(cue, "messages lost on the way", announcement.sequence - member.sequence - 1)
        if newer:
            member.sequence = announcement.sequence

    def _count(self, cue: str, event: str, times: int = 1) -> None:
        self._counts[f"{cue}: {event}"] += times


def _remember(entries: OrderedDict, key: object) -> None:
    entries[key] = None
    if len(entries) > REMEMBERED:
        entries.popitem(last=False)
