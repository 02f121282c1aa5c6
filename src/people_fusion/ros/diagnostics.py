"""One compact status a node, once a second, through diagnostic_updater (REP-107)."""

from __future__ import annotations

import threading
import time
from collections import Counter
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence

import rospy
from diagnostic_msgs.msg import DiagnosticStatus
from diagnostic_updater import Updater

from people_fusion.ros.transforms import Missing

PERIOD_S = 1.0
SILENT_AFTER_S = 3.0  # an input that is silent for longer is reported
MISSING_AFTER_S = 1.0  # a transform that is missing for longer is reported
COMPLAIN_EVERY_S = 10.0  # of the same bad data in the log
JUMP_SHOWN_S = 5.0

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Status(NamedTuple):
    """What the node is like: the worst level and all complaints."""

    level: int
    message: str


def judge(
    silent: Mapping[str, float],
    missing: Sequence[Missing],
    bad: Mapping[str, int],
    since_jump: float,
    now: float,
) -> Status:
    """The level and message of a node's status.

    Args:
        silent: by expected input: seconds since its last message, infinite before the first.
        missing: transforms that were asked for in vain.
        bad: by reason: messages given up since the last report.
        since_jump: seconds since time last jumped back.
        now: seconds on time.monotonic.
    """
    complaints: List[Status] = []
    for gap in missing:
        if now - gap.since > MISSING_AFTER_S:
            what = f"no transform from {gap.source_frame} to {gap.target_frame}"
            if gap.ever_found:
                complaints.append(Status(WARN, f"{what} for {now - gap.since:.0f} s"))
            else:
                complaints.append(Status(ERROR, f"{what}, never yet: {gap.reason}"))
    for name, seconds in silent.items():
        if seconds > SILENT_AFTER_S:
            told = f"nothing on {name} yet" if seconds == float("inf") else f"nothing on {name} for {seconds:.0f} s"
            complaints.append(Status(WARN, told))
    complaints += [Status(WARN, f"{reason} ({count})") for reason, count in bad.items()]
    if since_jump < JUMP_SHOWN_S:
        complaints.append(Status(WARN, "time jumped back, started anew"))
    if not complaints:
        return Status(OK, "running")
    return Status(max(c.level for c in complaints), "; ".join(c.message for c in complaints))


class Diagnostics:
    """Counts what happens in a node and publishes it.

    Args:
        inputs: topics that should not be silent.
        missing: transforms that were asked for in vain.
    """

    def __init__(self, inputs: Sequence[str], missing: Callable[[], List[Missing]]) -> None:
        self._heard: Dict[str, float] = {name: float("-inf") for name in inputs}
        self._missing = missing
        self._received: Counter = Counter()
        self._bad: Counter = Counter()
        self._lock = threading.Lock()  # bad data is told of by several threads
        self._complained: Dict[str, float] = {}
        self._losses: List[Callable[[], Mapping[str, int]]] = []
        self._events: List[Callable[[], Mapping[str, int]]] = []
        self._facts: List[Callable[[], Mapping[str, Any]]] = []
        self._reported: Counter = Counter()
        self._last = (time.monotonic(), time.process_time(), 0)
        self._jumped_at, self._jumps = float("-inf"), 0
        self._updater = Updater()
        self._updater.setHardwareID("none")
        self._updater.add("people_fusion", self._run)

    def heard(self, name: str) -> None:
        """A message came in on an input."""
        self._heard[name] = time.monotonic()
        self._received[name] += 1

    def bad(self, reason: str, detail: str = "") -> None:
        """A message was given up; the log hears of each reason now and then."""
        with self._lock:
            self._bad[reason] += 1
        now = time.monotonic()
        if now - self._complained.get(reason, float("-inf")) > COMPLAIN_EVERY_S:
            self._complained[reason] = now
            rospy.logwarn("%s", detail or reason)

    def jumped(self, seconds: float) -> None:
        """Time has jumped back."""
        self._jumps += 1
        self._jumped_at = time.monotonic()
        rospy.logwarn("time jumped back by %.1f s: everything is forgotten and starts anew", seconds)

    def add_losses(self, counters: Callable[[], Mapping[str, int]]) -> None:
        """Counters of messages that were given up: an increase is a warning."""
        self._losses.append(counters)

    def add_events(self, counters: Callable[[], Mapping[str, int]]) -> None:
        """Counters of what should not happen, under their own names: an increase is a warning."""
        self._events.append(counters)

    def add_facts(self, facts: Callable[[], Mapping[str, Any]]) -> None:
        """Values that are merely shown."""
        self._facts.append(facts)

    def publish(self) -> None:
        """Publish the status."""
        self._updater.force_update()

    def _run(self, status: Any) -> Any:
        now, cpu, received = time.monotonic(), time.process_time(), sum(self._received.values())
        elapsed, spent, messages = (b - a for a, b in zip(self._last, (now, cpu, received)))
        self._last = (now, cpu, received)
        with self._lock:
            lost = Counter(self._bad)
        for losses in self._losses:
            lost.update(losses())
        events: Counter = Counter()
        for counters in self._events:
            events.update(counters())
        fresh = lost + events - self._reported
        self._reported = lost + events
        silent = {name: now - at for name, at in self._heard.items()}
        level, message = judge(silent, self._missing(), fresh, now - self._jumped_at, now)
        status.summary(level, message)
        for name in self._heard:
            status.add(f"received: {name}", str(self._received[name]))
        status.add("messages a second", f"{messages / elapsed:.1f}" if elapsed else "-")
        status.add("CPU ms a message", f"{1e3 * spent / messages:.2f}" if messages else "-")
        status.add("time jumps", str(self._jumps))
        for facts in self._facts:
            for name, value in facts().items():
                status.add(name, str(value))
        for name, count in sorted(events.items()):
            status.add(name, str(count))
        for reason, count in sorted(lost.items()):
            status.add(f"lost: {reason}", str(count))
        return status
