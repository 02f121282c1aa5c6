"""Each thing that can be wrong with a cue, by name: it is counted, and the others are neither stalled nor misled."""

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.stamps import NANOSECONDS, from_seconds, to_seconds
from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.roster import MOST_CUES, REMEMBERED, Roster

NAMES = BUFFERS.names()
START_NS = 1000 * NANOSECONDS
PATIENCE_S = 0.3
SLACK_S = 0.001


def policy(name, **options):
    return BUFFERS.build(parse(BUFFERS.config_of(name, "buffer"), options))


def nobody(stamp_ns, cue, sequence=0):
    none = np.zeros((0, 3))
    return Measurement(stamp_ns, cue, "legs", "odom", none, np.zeros((0, 3, 3)), np.zeros(0), sequence=sequence)


def regular(cue, rate, duration_s, work_s=0.005, phase_s=0.0, announces=True):
    """(arrival in seconds, item) of a cue without fault."""
    events = []
    for sequence in range(int(duration_s * rate)):
        time_s = phase_s + sequence / rate
        stamp_ns = START_NS + from_seconds(time_s)
        if announces:
            events.append((time_s, Announcement(stamp_ns, cue, sequence)))
        events.append((time_s + work_s, nobody(stamp_ns, cue, sequence)))
    return events


class Outcome:
    """What came out of a buffer: cue, stamp and delay of each, in seconds."""

    def __init__(self, name, events, **options):
        self.buffer, self.out, self._now_ns = policy(name, **options), [], START_NS
        for arrival_s, item in sorted(events, key=lambda event: event[0]):
            self._sleep_until(START_NS + from_seconds(arrival_s))
            self._take(self.buffer.push(item, self._now_ns))
        self._sleep_until(self._now_ns + NANOSECONDS)
        self.counters = self.buffer.counters()

    def _sleep_until(self, until_ns):
        while True:
            sleep_ns = self.buffer.sleep_ns(self._now_ns)
            if sleep_ns is None or self._now_ns + sleep_ns > until_ns:
                break
            self._now_ns += sleep_ns
            self._take(self.buffer.poll(self._now_ns))
        self._now_ns = max(self._now_ns, until_ns)

    def _take(self, released):
        for entry in released:
            delay_s, time_s = to_seconds(self._now_ns - entry.stamp_ns), to_seconds(entry.stamp_ns - START_NS)
            self.out.append((entry.cue, time_s, delay_s))

    def delays(self, cue, begin_s=0.0, end_s=np.inf):
        return np.array([delay for name, time_s, delay in self.out if name == cue and begin_s <= time_s < end_s])

    def times(self, cue):
        return np.array([time_s for name, time_s, _ in self.out if name == cue])

    def inversions(self, cues):
        """How many of these cues' measurements came after a newer one."""
        times = np.array([time_s for name, time_s, _ in self.out if name in cues])
        return int(np.sum(times < np.maximum.accumulate(times))) if len(times) else 0


def usual_delay_s(name, begin_s=1.0, end_s=np.inf):
    """Of `front` and `back` among themselves."""
    return max(Outcome(name, pair()).delays(cue, begin_s, end_s).max() for cue in ("front", "back"))


def pair(duration_s=6.0):
    """Two scanners without fault, out of step."""
    return regular("front", 15.0, duration_s) + regular("back", 12.0, duration_s, phase_s=0.013)


def assert_unharmed(outcome, name, faults):
    """Within each (begin, end) the pair waits for no more than the patience; else no more than usual.

    All that the pair delivered comes out, and in order.
    """
    usual_s = usual_delay_s(name)
    for cue in ("front", "back"):
        times, delays = outcome.times(cue), outcome.delays(cue)
        assert delays.max() <= PATIENCE_S + 0.005 + SLACK_S
        calm = times > 1.0
        for begin_s, end_s in faults:
            calm &= (times < begin_s) | (times > end_s)
        assert delays[calm].max() <= usual_s + SLACK_S
        begun = times[-1] - 4.0
        assert np.sum(times > begun) >= 0.95 * 4.0 * {"front": 15, "back": 12}[cue]
    assert outcome.inversions(("front", "back")) == 0


@pytest.mark.parametrize("name", NAMES)
def test_a_cue_that_falls_silent_delays_the_others_once(name):
    outcome = Outcome(name, pair() + regular("cam", 10.0, 3.0, work_s=0.05))
    assert_unharmed(outcome, name, [(0.0, 3.3)])
    assert outcome.buffer.roster.facts(START_NS + from_seconds(6.0))["cam"].startswith("silent")


@pytest.mark.parametrize("name", NAMES)
def test_a_cue_that_is_listed_and_never_comes_delays_the_others_once(name):
    assert_unharmed(Outcome(name, pair(), cues=("ghost",)), name, [(0.0, 0.35)])


@pytest.mark.parametrize("name", NAMES)
def test_a_cue_that_only_announces_delays_the_others_once(name):
    deaf = [event for event in regular("cam", 10.0, 6.0, phase_s=2.0) if isinstance(event[1], Announcement)]
    outcome = Outcome(name, pair() + deaf)
    assert_unharmed(outcome, name, [(1.65, 2.35)])
    if name in ("announced", "dynamic", "fixed_lag", "revisable"):
        assert outcome.counters["cam: announced without delivering"] >= 35


@pytest.mark.parametrize("name", ["announced", "revisable"])
def test_a_cue_that_skips_most_without_saying_so_hardly_delays_the_others(name):
    skipping = [
        event
        for event in regular("cam", 10.0, 20.0, work_s=0.05)
        if isinstance(event[1], Announcement) or event[1].sequence % 5 == 0
    ]
    outcome = Outcome(name, pair(20.0) + skipping)
    for cue in ("front", "back"):
        assert np.mean(outcome.delays(cue, 1.0) > 0.1) <= 0.02
    assert outcome.counters["cam: announced without delivering"] >= 150


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("announces", [True, False])
@pytest.mark.parametrize("work_s", [0.35, 3.0])
def test_a_cue_slower_than_the_patience_delays_the_others_once(name, announces, work_s):
    """In `dynamic` once more by what it delivers, as it does not know how old the next will be."""
    outcome = Outcome(name, pair() + regular("cam", 10.0, 6.0, work_s=work_s, announces=announces))
    assert_unharmed(outcome, name, [(0.0, 0.8), (work_s - PATIENCE_S - 0.1, work_s + 0.8)])


@pytest.mark.parametrize("name", NAMES)
def test_a_cue_that_announces_late_delays_the_others_once(name):
    late = [(arrival_s + 1.0, item) for arrival_s, item in regular("cam", 10.0, 6.0)]
    assert_unharmed(Outcome(name, pair() + late), name, [(0.6, 1.8)])


@pytest.mark.parametrize("name", ["announced", "revisable"])
def test_a_slow_cue_delays_the_others_only_about_when_it_is_due(name):
    """The two that come just before each of its messages are expected to wait for it."""
    outcome = Outcome(name, pair(30.0) + regular("map", 0.25, 30.0, work_s=0.01, phase_s=0.05))
    times, delays = outcome.times("front"), outcome.delays("front")
    raised = times[delays > usual_delay_s(name) + SLACK_S]
    assert len(raised[raised > 14.0]) <= 4 * PATIENCE_S * 15


@pytest.mark.parametrize("name", ["announced", "revisable"])
def test_a_cue_without_a_period_delays_the_others_no_longer_than_the_patience_each_time(name):
    rng = np.random.default_rng(3)
    events, count = pair(60.0), 30
    for sequence, time_s in enumerate(np.sort(rng.uniform(0.0, 60.0, count))):
        stamp_ns = START_NS + from_seconds(time_s)
        events.append((time_s, Announcement(stamp_ns, "bell", sequence)))
        events.append((time_s, nobody(stamp_ns, "bell", sequence)))
    outcome = Outcome(name, events)
    for cue, rate in (("front", 15), ("back", 12)):
        assert np.sum(outcome.delays(cue) > usual_delay_s(name) + SLACK_S) <= count * (PATIENCE_S * rate + 1)
        assert outcome.delays(cue).max() <= PATIENCE_S + 0.005 + SLACK_S


@pytest.mark.parametrize("name", NAMES)
def test_a_cue_that_withdraws_everything_frees_the_others_at_once(name):
    withdrawn = []
    for arrival_s, item in regular("cam", 10.0, 6.0, work_s=0.02):
        if isinstance(item, Announcement):
            withdrawn += [(arrival_s, item), (arrival_s + 0.02, item._replace(withdrawn=True))]
    outcome = Outcome(name, pair() + withdrawn)
    assert max(outcome.delays(cue, 1.0).max() for cue in ("front", "back")) <= usual_delay_s(name) + 0.021
    assert not any("without delivering" in event for event in outcome.counters)


@pytest.mark.parametrize("name", NAMES)
def test_a_cue_that_starts_again_misleads_nobody(name):
    again = [
        (arrival_s, item)
        for arrival_s, item in regular("cam", 10.0, 4.0, work_s=0.05, phase_s=3.0)
        if arrival_s < 6.0
    ]  # fmt: skip
    outcome = Outcome(name, pair() + regular("cam", 10.0, 2.0, work_s=0.05) + again)
    assert outcome.counters["cam: restarted"] == 1
    assert len(outcome.times("cam")) == 50 - outcome.counters.get("late measurements dropped", 0)
    for cue in ("front", "back"):
        assert outcome.delays(cue, 1.0).max() <= PATIENCE_S + SLACK_S


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("announces", [True, False])
def test_a_flood_delays_the_others_once_and_all_of_it_comes_out(name, announces):
    flood = []
    for sequence in range(200):
        stamp_ns = START_NS + from_seconds(3.0 - 0.01 * (200 - sequence))
        if announces:
            flood.append((3.0, Announcement(stamp_ns, "cam", sequence)))
        flood.append((3.0, nobody(stamp_ns, "cam", sequence)))
    outcome = Outcome(name, pair() + flood, **({} if name == "drop" else {"horizon_s": 3.0}))
    assert_unharmed(outcome, name, [(2.65, 3.65)])
    if name != "drop":
        assert len(outcome.times("cam")) == 200


@pytest.mark.parametrize("name", NAMES)
def test_a_stamp_that_comes_twice_is_counted_and_lost(name):
    twice = [event for event in regular("cam", 10.0, 6.0) for _ in range(2) if isinstance(event[1], Measurement)]
    outcome = Outcome(name, pair() + twice)
    assert outcome.counters["cam: lost: stamp delivered before"] == 60
    assert len(outcome.times("cam")) == 60
    assert outcome.inversions(("front", "back")) == 0


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("ahead_s", [0.1, 0.25, 0.9, 365 * 24 * 3600.0])
def test_a_stamp_from_the_future_misleads_nobody(name, ahead_s):
    stamp_ns = START_NS + from_seconds(3.0 + ahead_s)
    wrong = [(3.0, Announcement(stamp_ns, "cam", 7)), (3.01, nobody(stamp_ns, "cam", 7))]
    outcome = Outcome(name, pair() + wrong)
    assert_unharmed(outcome, name, [(2.65, 3.4)])
    assert len(outcome.times("cam")) == (ahead_s <= PATIENCE_S)
    assert outcome.counters.get("cam: lost: stamp from the future", 0) == (ahead_s > PATIENCE_S)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_left_over_from_before_a_jump_back_is_refused(name):
    buffer = policy(name)
    for _, item in pair(1.0):
        buffer.push(item, START_NS + from_seconds(1.0))
    buffer.reset()
    left_over = nobody(START_NS + from_seconds(1.0), "front", 16)
    assert buffer.push(left_over, START_NS - from_seconds(10.0)) == []
    assert buffer.held == ()
    assert buffer.counters()["front: lost: stamp from the future"] == 1


@pytest.mark.parametrize("name", NAMES)
def test_the_others_go_on_when_a_cue_dies_after_announcing(name):
    dying = regular("cam", 10.0, 3.0, work_s=0.1)[:-1]
    assert isinstance(dying[-1][1], Announcement)
    outcome = Outcome(name, pair() + dying)
    out_at_s = np.sort([time_s + delay_s for cue, time_s, delay_s in outcome.out if cue != "cam"])
    for begin_s in (3.0 + 1.0, 3.0 + 1.5, 3.0 + 2.0):
        assert np.sum((out_at_s > begin_s - 0.5) & (out_at_s <= begin_s)) >= 0.9 * 0.5 * 27
    assert_unharmed(outcome, name, [(0.0, 3.3)])


@pytest.mark.parametrize("name", ["announced", "revisable"])
def test_what_is_withdrawn_frees_the_others_at_once(name):
    buffer = policy(name)
    buffer.push(Announcement(START_NS, "cam", 1), START_NS)
    assert buffer.push(nobody(START_NS, "scan", 1), START_NS) == []
    assert len(buffer.push(Announcement(START_NS, "cam", 1, withdrawn=True), START_NS + 1)) == 1


@pytest.mark.parametrize("name", NAMES)
def test_with_no_patience_nothing_waits(name):
    outcome = Outcome(name, pair() + regular("cam", 10.0, 6.0, work_s=0.1), patience_s=0.0)
    assert max(outcome.delays(cue).max() for cue in ("front", "back")) <= 0.005 + 1e-6


@pytest.mark.parametrize("name", NAMES)
def test_a_pause_of_the_clock_does_no_harm_after_it(name):
    """A recording is paused, or the machine slept: the clock goes on and the stamps after it."""
    after = [
        (arrival_s + 3606.0, item._replace(stamp_ns=item.stamp_ns + from_seconds(3606.0)))
        if isinstance(item, Announcement)
        else (arrival_s + 3606.0, nobody(item.stamp_ns + from_seconds(3606.0), item.cue, item.sequence))
        for arrival_s, item in pair()
    ]
    outcome = Outcome(name, pair() + after)
    for cue in ("front", "back"):
        assert outcome.delays(cue, 3607.0).max() <= usual_delay_s(name) + SLACK_S
    assert outcome.inversions(("front", "back")) == 0


def roster(**options):
    return Roster(**{"patience_s": PATIENCE_S, "ahead_s": 0.3, "capacity": 256, **options})


def test_a_cue_that_numbers_nothing_is_not_taken_for_one_that_starts_again():
    each = roster()
    for step in range(10):
        stamp_ns = START_NS + step * 10**8
        each.announce(Announcement(stamp_ns, "cam", 0), stamp_ns)
    assert each.counters() == {}
    assert len(each.members["cam"].pending) == 10


def test_the_period_outlives_lost_messages_jitter_and_disorder():
    rng = np.random.default_rng(1)
    each = roster()
    for step in range(200):
        stamp_ns = START_NS + step * 10**8 + int(rng.normal(0.0, 2e6))
        if rng.random() > 0.2:
            each.deliver(nobody(stamp_ns, "cam", step), stamp_ns)
        if rng.random() < 0.1:
            each.deliver(nobody(stamp_ns - 3 * 10**7, "cam", step), stamp_ns)
    assert abs(each.members["cam"].period_ns - 10**8) < 10**7


def test_the_next_stamp_is_expected_too_late_at_most_as_often_as_stamps_jitter():
    rng = np.random.default_rng(1)
    each, wrong = roster(), 0
    for step in range(2000):
        stamp_ns = START_NS + step * 10**8 + int(rng.uniform(-1e7, 1e7))
        if step > 10:
            wrong += stamp_ns < each.members["cam"].soonest_ns
        each.announce(Announcement(stamp_ns, "cam", step), stamp_ns)
        each.deliver(nobody(stamp_ns, "cam", step), stamp_ns)
    assert wrong == 0


def test_lost_announcements_are_counted():
    each = roster()
    for sequence in (0, 1, 5, 6):
        each.announce(Announcement(START_NS + sequence * 10**8, "cam", sequence), START_NS + sequence * 10**8)
    assert each.counters() == {"cam: messages lost on the way": 3}


def test_an_announcement_that_comes_after_its_measurement_is_not_waited_for():
    each = roster()
    assert each.deliver(nobody(START_NS, "cam", 1), START_NS)
    each.announce(Announcement(START_NS, "cam", 1), START_NS)
    assert not each.members["cam"].pending
    each.expire(START_NS + NANOSECONDS)
    assert not each.members["cam"].stalled


@pytest.mark.parametrize("capacity, event", [(20, "too many announcements"), (256, "announced without delivering")])
def test_announcements_that_are_never_kept_are_given_up_and_memory_does_not_grow(capacity, event):
    each = roster(capacity=capacity)
    for sequence in range(1000):
        now_ns = START_NS + sequence * 10**7
        each.announce(Announcement(now_ns, "cam", sequence), now_ns)
        each.expire(now_ns)
        assert len(each.members["cam"].pending) <= min(capacity, 31)
        assert each.awaited("cam", now_ns) == (sequence < min(capacity, 31))
    assert len(each.members["cam"].expired) <= REMEMBERED
    assert each.counters()[f"cam: {event}"] >= 900


def test_no_more_cues_are_known_than_there_can_be():
    each = roster()
    taken = [each.deliver(nobody(START_NS, f"cue_{index}"), START_NS) for index in range(MOST_CUES + 10)]
    assert sum(taken) == len(each.members) == MOST_CUES
    assert each.counters() == {"lost: of too many cues": 10}
