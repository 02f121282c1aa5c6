from __future__ import annotations

from typing import List

import pytest

pytest.importorskip("rospy", reason="ROS is not installed")

from people_fusion.ros.timeline import GRACE_S, Timeline

S = 10**9


class Wall:
    seconds = 0.0

    def __call__(self) -> float:
        return self.seconds


@pytest.fixture
def wall() -> Wall:
    return Wall()


@pytest.fixture
def jumps() -> List[float]:
    return []


@pytest.fixture
def timeline(jumps: List[float], wall: Wall) -> Timeline:
    line = Timeline(jumps.append, wall)
    for second in range(100, 160):
        assert line.admit("scan", second * S)
        assert line.admit("tf", second * S, witness=False)
    return line


def test_small_disorder_is_no_jump(timeline: Timeline, jumps: List[float]) -> None:
    assert timeline.admit("scan", 159 * S - S // 2)
    assert not jumps


def test_loop_is_one_jump(timeline: Timeline, jumps: List[float]) -> None:
    assert timeline.admit("scan", 100 * S)
    assert timeline.admit("tf", 100 * S, witness=False)
    assert timeline.admit("scan", 101 * S)
    assert jumps == [59.0]


def test_messages_of_before_are_kept_out_and_make_no_second_jump(timeline: Timeline, jumps: List[float]) -> None:
    timeline.admit("scan", 100 * S)
    assert not timeline.admit("tf", 159 * S, witness=False)
    assert timeline.admit("tf", 100 * S, witness=False)
    assert timeline.admit("scan", 101 * S)
    assert len(jumps) == 1


def test_grace_ends(timeline: Timeline, wall: Wall) -> None:
    timeline.admit("scan", 100 * S)
    wall.seconds += GRACE_S
    assert timeline.admit("tf", 159 * S, witness=False)


def test_transforms_that_go_back_are_no_jump(timeline: Timeline, jumps: List[float]) -> None:
    assert timeline.admit("tf", 100 * S, witness=False)
    assert not jumps


def test_streams_on_clocks_far_apart_are_kept_apart(jumps: List[float], wall: Wall) -> None:
    line = Timeline(jumps.append, wall)
    line.admit("clock", 1000 * S)
    line.admit("scan", 100 * S)
    line.admit("clock", 1050 * S)
    line.admit("scan", 150 * S)
    assert line.admit("clock", 1000 * S)
    assert not line.admit("scan", 150 * S)
    assert line.admit("scan", 100 * S)
    assert jumps == [50.0]
