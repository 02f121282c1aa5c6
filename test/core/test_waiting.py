"""The waiting room: bounded in time and number, nothing lost uncounted, no cue held up by another."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from people_fusion.core.errors import TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import TransformTree
from people_fusion.core.waiting import FULL, JUMPED, LATE, NEVER, WaitingRoom, transforms_ready

PATIENCE_NS = 300
PATIENCE_S = PATIENCE_NS * 1e-9


class World:
    """Items are (name, ready_at); those that are never ready raise."""

    def __init__(self, capacity=50):
        self.now_ns = 0
        self.room = WaitingRoom(self.is_ready, PATIENCE_S, capacity)

    def is_ready(self, item):
        if item[1] is None:
            raise TransformUnavailable("gone", may_arrive=False)
        return item[1] <= self.now_ns

    def push(self, name, ready_at, cue="front", stamp_ns=0):
        self.room.push(cue, stamp_ns, (name, ready_at), self.now_ns)

    def poll(self, now_ns):
        self.now_ns = now_ns
        return [name for name, _ in self.room.poll(now_ns)]


def test_item_waits_until_it_is_ready():
    world = World()
    world.push("scan", 100)
    assert world.poll(99) == []
    assert world.poll(100) == ["scan"]
    assert world.poll(101) == []
    assert world.room.counters() == {}


def test_item_is_given_up_when_patience_runs_out():
    world = World()
    world.push("scan", 1000)
    assert world.poll(PATIENCE_NS) == []
    assert len(world.room) == 1
    assert world.poll(PATIENCE_NS + 1) == []
    assert len(world.room) == 0
    assert world.room.counters() == {LATE: 1}


def test_item_that_becomes_ready_at_the_last_moment_is_released():
    world = World()
    world.push("scan", 1000)
    assert world.poll(1000) == ["scan"]


def test_item_for_which_waiting_cannot_help_is_given_up_at_once():
    world = World()
    world.push("scan", None)
    world.push("next", 0, stamp_ns=1)
    assert world.poll(0) == ["next"]
    assert world.room.counters() == {NEVER: 1}


def test_cue_is_not_held_up_by_another():
    world = World()
    world.push("stuck", 1000, cue="rear", stamp_ns=1)
    world.push("free", 0, cue="front", stamp_ns=2)
    assert world.poll(0) == ["free"]


def test_items_of_a_cue_leave_in_order_of_stamps():
    world = World()
    world.push("second", 0, stamp_ns=2)
    world.push("first", 50, stamp_ns=1)
    assert world.poll(0) == []
    assert world.poll(50) == ["first", "second"]


def test_equal_stamps_leave_in_order_of_arrival():
    world = World()
    for name in "cab":
        world.push(name, 0)
    assert world.poll(0) == ["c", "a", "b"]


def test_flood_of_one_cue_costs_its_own_oldest_only():
    world = World(capacity=2)
    world.push("other", 10, cue="rear")
    for stamp in range(5):
        world.push(stamp, 10, stamp_ns=stamp)
    assert sorted(map(str, world.poll(10))) == ["3", "4", "other"]
    assert world.room.counters() == {FULL: 3}


def test_reset_forgets_who_waits_and_counts_them():
    world = World()
    world.push("scan", 1000)
    world.room.reset()
    assert world.poll(5000) == []
    assert world.room.counters() == {JUMPED: 1}


events = st.lists(
    st.tuples(
        st.sampled_from(["front", "rear"]),
        st.integers(0, 20),  # stamp
        st.one_of(st.none(), st.integers(0, 2000)),  # ready at
        st.integers(0, 200),  # time that passes before
        st.booleans(),  # poll after
    ),
    max_size=40,
)


@given(events, st.integers(1, 5))
def test_nothing_is_lost_uncounted_and_nobody_waits_too_long(arrivals, capacity):
    world = World(capacity)
    since, left = {}, Counter()
    for name, (cue, stamp, ready_at, pause, polls) in enumerate(arrivals):
        world.now_ns += pause
        world.push(name, ready_at, cue, stamp)
        since[name] = world.now_ns
        assert max(map(len, world.room._queues.values())) <= capacity
        if polls:
            released = world.poll(world.now_ns)
            left.update(released)
            assert all(arrivals[name][2] <= world.now_ns for name in released)
            assert [arrivals[name][1] for name in released] == sorted(arrivals[name][1] for name in released)
            waiting = [guest.item[0] for queue in world.room._queues.values() for guest in queue]
            assert all(world.now_ns - since[name] <= PATIENCE_NS for name in waiting)
        assert sum(left.values()) + sum(world.room.counters().values()) + len(world.room) == name + 1
    left.update(world.poll(world.now_ns + PATIENCE_NS + 1))
    assert len(world.room) == 0
    assert max(left.values(), default=0) <= 1
    assert len(left) + sum(world.room.counters().values()) == len(arrivals)


def test_transforms_are_ready_when_all_stamps_can_be_looked_up():
    tree = TransformTree()
    for stamp in (10, 20):
        tree.add("odom", "base", stamp, Pose.identity())
    assert transforms_ready(tree, "odom", "base", (10, 20))
    assert not transforms_ready(tree, "odom", "base", (10, 21))
    assert not transforms_ready(tree, "odom", "nowhere", (10,))
    with pytest.raises(TransformUnavailable):
        transforms_ready(tree, "odom", "base", (9, 20))
