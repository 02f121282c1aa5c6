"""Random lives of up to six cues against every buffer policy, driven as the nodes drive it: by `sleep_ns`."""

from collections import Counter

import numpy as np
import pytest
from hypothesis import HealthCheck, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule, run_state_machine_as_test

from people_fusion.core.config import parse
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.stamps import NANOSECONDS, from_seconds
from people_fusion.core.tracks import Tracks
from people_fusion.tracking.buffer import BUFFERS, LATE
from people_fusion.tracking.rewind import Rewind
from people_fusion.tracking.roster import MOST_CUES, REMEMBERED
from people_fusion.tracking.tracker import Tracker

START_NS = 1000 * NANOSECONDS
MILLISECOND = 10**6
NOTHING = np.zeros((0, 3))
FREE_TO_CHOOSE = ("announced", "dynamic", "fixed_lag", "revisable")  # what to do with what is late
LOST_BY_BUFFER = ("late measurements dropped", "measurements beyond the horizon dropped", "waited when time jumped")
LOST_BY_REWIND = (
    "late measurements dropped: beyond the memory",
    "late measurements shed: reprocessing is over its budget",
)

cues = st.sampled_from("abcdef")
ages_ms = st.one_of(st.integers(0, 60), st.integers(0, 2500))


class Diary(Tracker):
    """A tracker whose state is what it processed, newest first: (order, what was before)."""

    def __init__(self):
        self.state = None

    @property
    def stamp_ns(self):
        return self.state and self.state[0][0]

    def process(self, measurement):
        self.state = (measurement.order, self.state)

    def tracks(self, stamp_ns=None):
        return Tracks.empty(stamp_ns or 0)

    def snapshot(self):
        return self.state

    def restore(self, snapshot):
        self.state = snapshot

    def reset(self):
        self.state = None

    def entries(self):
        entries, state = [], self.state
        while state is not None:
            order, state = state
            entries.append(order)
        return entries[::-1]


def nobody(stamp_ns, cue, sequence):
    return Measurement(stamp_ns, cue, "legs", "odom", NOTHING, np.zeros((0, 3, 3)), np.zeros(0), sequence=sequence)


class BufferMachine(RuleBasedStateMachine):
    """Cues announce, deliver, withdraw, die, start again, flood and lie; time passes and jumps."""

    @initialize(
        name=st.sampled_from(BUFFERS.names()),
        late=st.sampled_from(LATE),
        patience_ms=st.sampled_from([0, 50, 300]),
        capacity=st.sampled_from([4, 64, 256]),
        replays_per_s=st.sampled_from([10, 1000]),
        listed=st.sets(st.sampled_from(["a", "b", "never"])),
    )
    def start(self, name, late, patience_ms, capacity, replays_per_s, listed):
        options = {"late": late} if name in FREE_TO_CHOOSE else {}
        options.update(patience_s=patience_ms / 1e3, capacity=capacity, replays_per_s=replays_per_s)
        config = parse(BUFFERS.config_of(name, "buffer"), dict(options, cues=sorted(listed)))
        self.buffer, self.diary = BUFFERS.build(config), Diary()
        self.past = Rewind(self.diary, config)
        self.patience_ns = from_seconds(config.patience_s)
        self.now_ns = START_NS
        self.sequences = Counter()
        self.announced = []  # that may still be delivered or withdrawn
        self.delivered = self.handed_out = self.refused_by_past = 0
        self.waiting = {}  # id of what was delivered -> when, and whether it came too late
        self.newest_ns = None
        self.processed = []

    # What the driver does

    def push(self, item):
        if isinstance(item, Measurement):
            self.delivered += 1
            self.waiting[id(item)] = (item, self.now_ns, self.newest_ns is not None and item.stamp_ns < self.newest_ns)
        self.take(self.buffer.push(item, self.now_ns))

    def take(self, released):
        for entry in released:
            self.handed_out += 1
            _, _, came_late = self.waiting.pop(id(entry))  # fails where something is handed out twice
            overtaken = self.newest_ns is not None and entry.stamp_ns < self.newest_ns
            assert overtaken == came_late
            self.newest_ns = entry.stamp_ns if self.newest_ns is None else max(self.newest_ns, entry.stamp_ns)
            if self.past.process(entry):
                self.processed.append(entry.order)
            else:
                self.refused_by_past += 1
        held = {id(entry) for entry in self.buffer.held}
        self.waiting = {key: value for key, value in self.waiting.items() if key in held}
        assert not held or self.newest_ns is None or self.buffer.held[0].stamp_ns >= self.newest_ns
        assert self.buffer.poll(self.now_ns) == []

    def pass_time(self, until_ns):
        members = self.buffer.roster.members.values()
        most = 2 * len(self.buffer.held) + len(members) + sum(len(member.pending) for member in members)
        wakes = 0
        while True:
            sleep_ns = self.buffer.sleep_ns(self.now_ns)
            if sleep_ns is None or self.now_ns + sleep_ns > until_ns:
                break
            assert sleep_ns > 0
            assert self.buffer.poll(self.now_ns + sleep_ns - 1) == [], "could have been had before"
            wakes += 1
            assert wakes <= most, "wakes more often than anything can change"
            self.now_ns += sleep_ns
            self.take(self.buffer.poll(self.now_ns))
            self.nothing_waits_beyond_the_patience()
        self.now_ns = max(self.now_ns, until_ns)

    # What happens

    @rule(cue=cues, age_ms=ages_ms, skipped=st.integers(0, 2))
    def announce(self, cue, age_ms, skipped):
        self.sequences[cue] += 1 + skipped
        announcement = Announcement(self.now_ns - age_ms * MILLISECOND, cue, self.sequences[cue])
        self.announced.append(announcement)
        self.push(announcement)

    @rule(draw=st.integers(0), again=st.booleans())
    def deliver(self, draw, again):
        if self.announced:
            place = draw % len(self.announced)
            announcement = self.announced[place] if again else self.announced.pop(place)
            self.push(nobody(*announcement[:3]))

    @rule(draw=st.integers(0))
    def withdraw(self, draw):
        if self.announced:
            self.push(self.announced.pop(draw % len(self.announced))._replace(withdrawn=True))

    @rule(draw=st.integers(0))
    def announce_again(self, draw):
        if self.announced:
            self.push(self.announced[draw % len(self.announced)])

    @rule(cue=cues, age_ms=ages_ms)
    def deliver_without_announcing(self, cue, age_ms):
        self.sequences[cue] += 1
        self.push(nobody(self.now_ns - age_ms * MILLISECOND, cue, self.sequences[cue]))

    @rule(cue=cues, age_ms=ages_ms, numbered=st.booleans())
    def repeat_a_stamp(self, cue, age_ms, numbered):
        for sequence in (1, 2):
            self.push(nobody(self.now_ns - age_ms * MILLISECOND, cue, sequence if numbered else 0))

    @rule(cue=cues, ahead_ms=st.sampled_from([1, 100, 299, 301, 999, 1001, 365 * 24 * 3600 * 1000]))
    def stamp_from_the_future(self, cue, ahead_ms):
        self.sequences[cue] += 1
        announcement = Announcement(self.now_ns + ahead_ms * MILLISECOND, cue, self.sequences[cue])
        self.push(announcement)
        self.push(nobody(*announcement[:3]))

    @rule(cue=cues, announces=st.booleans(), delivers=st.booleans(), apart_ms=st.integers(1, 10))
    def flood(self, cue, announces, delivers, apart_ms):
        for age in range(200, 0, -1):
            self.sequences[cue] += 1
            announcement = Announcement(self.now_ns - age * apart_ms * MILLISECOND, cue, self.sequences[cue])
            if announces:
                self.push(announcement)
            if delivers:
                self.push(nobody(*announcement[:3]))

    @rule(cues=st.lists(cues, min_size=1, max_size=3), steps=st.integers(2, 20), late_ms=st.integers(0, 120))
    def run_regularly(self, cues, steps, late_ms):
        """The usual: a rate each, the first one in the list takes its time."""
        working = None
        for _ in range(steps):
            self.pass_time(self.now_ns + 50 * MILLISECOND)
            for cue in cues:
                self.sequences[cue] += 1
                announcement = Announcement(self.now_ns, cue, self.sequences[cue])
                self.push(announcement)
                if cue == cues[0] and working is None:
                    working = (announcement, self.now_ns + late_ms * MILLISECOND)
                else:
                    self.push(nobody(*announcement[:3]))
            if working is not None and working[1] <= self.now_ns:
                self.push(nobody(*working[0][:3]))
                working = None

    @rule(cue=cues)
    def die_and_restart(self, cue):
        self.announced = [announcement for announcement in self.announced if announcement.cue != cue]
        self.sequences[cue] = 0

    @rule(duration_ms=st.one_of(st.integers(1, 50), st.integers(1, 1000)))
    def let_time_pass(self, duration_ms):
        self.pass_time(self.now_ns + duration_ms * MILLISECOND)

    @rule(share=st.floats(0.0, 1.0))
    def sleep_to_the_deadline_or_less(self, share):
        sleep_ns = self.buffer.sleep_ns(self.now_ns)
        if sleep_ns is not None:
            self.now_ns += int(share * sleep_ns)
            self.take(self.buffer.poll(self.now_ns))

    @rule(duration_s=st.sampled_from([0.5, 3.0, 3600.0]))
    def oversleep(self, duration_s):
        self.now_ns += from_seconds(duration_s)
        self.take(self.buffer.poll(self.now_ns))

    @rule(back_ms=st.integers(1, 20))
    def clock_goes_back_a_little(self, back_ms):
        self.now_ns -= back_ms * MILLISECOND
        self.take(self.buffer.poll(self.now_ns))

    @rule(jump_s=st.sampled_from([-60.0, -3.0, 10.0, 3600.0]))
    def time_jumps(self, jump_s):
        self.buffer.reset()
        self.past.reset()
        self.now_ns += from_seconds(jump_s)
        self.waiting.clear()
        self.processed.clear()
        self.newest_ns = None

    # What must hold

    @invariant()
    def what_was_delivered_came_out_or_waits_or_is_counted(self):
        counts = self.buffer.counters()
        lost = sum(counts.get(reason, 0) for reason in LOST_BY_BUFFER)
        lost += sum(count for event, count in counts.items() if "lost: " in event)
        assert self.handed_out + len(self.buffer.held) + lost == self.delivered
        assert sum(self.past.counters().get(reason, 0) for reason in LOST_BY_REWIND) == self.refused_by_past

    @invariant()
    def nothing_waits_beyond_the_patience(self):
        assert len(self.waiting) == len(self.buffer.held)
        assert all(self.now_ns - since_ns <= self.patience_ns for _, since_ns, _ in self.waiting.values())

    @invariant()
    def what_was_processed_is_in_order_where_it_can_be_put_in_order(self):
        entries = self.past.tracker.entries()
        assert sorted(entries) == sorted(self.processed)
        if self.buffer.config.late == "reprocess":
            assert entries == sorted(entries)

    @invariant()
    def memory_is_bounded(self):
        capacity = self.buffer.config.capacity
        assert len(self.buffer.held) == len(self.buffer._orders) == len(self.buffer._since_ns) <= capacity
        assert len(self.buffer.roster.members) <= MOST_CUES
        for member in self.buffer.roster.members.values():
            assert len(member.pending) <= capacity
            assert max(len(member.delivered), len(member.expired)) <= REMEMBERED
        assert len(self.past._orders) == len(self.past._history) <= capacity
        assert len(self.past._before) <= capacity
        assert len(self.past._replayed) <= self.buffer.config.replays_per_s

    def teardown(self):
        """Silence: whatever waits, waits no longer than the patience."""
        if hasattr(self, "buffer"):
            newest_ns = max((since_ns for _, since_ns, _ in self.waiting.values()), default=0)
            self.pass_time(max(self.now_ns, newest_ns) + self.patience_ns + 1)
            assert not self.buffer.held


def test_lives_of_cues():
    run_state_machine_as_test(
        BufferMachine,
        settings=settings(
            max_examples=500, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck)
        ),
    )


@pytest.mark.slow
def test_many_lives_of_cues():
    run_state_machine_as_test(
        BufferMachine,
        settings=settings(
            max_examples=10000, stateful_step_count=30, deadline=None, suppress_health_check=list(HealthCheck)
        ),
    )
