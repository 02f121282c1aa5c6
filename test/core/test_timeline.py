"""What a timeline believes: disorder, pauses, stamps that are wrong, and jumps, live and in a recording alike."""

from __future__ import annotations

from typing import List

import pytest

from people_fusion.core.errors import DataError
from people_fusion.core.timeline import CLOCK, DOUBTED, GRACE_NS, LEFT_OVER, Timeline

S = 10**9
YEAR = 365 * 24 * 3600 * S


class Wall:
    now_ns = 0

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def wall() -> Wall:
    return Wall()


@pytest.fixture
def jumps() -> List[float]:
    return []


@pytest.fixture
def timeline(jumps: List[float], wall: Wall) -> Timeline:
    """Scans and tf of a minute, the newest at 159 s."""
    line = Timeline(jumps.append, wall)
    for second in range(100, 160):
        wall.now_ns += S
        assert line.admit("scan", second * S)
        assert line.admit("tf", second * S, witness=False)
    return line


def test_small_disorder_is_no_jump(timeline: Timeline, jumps: List[float]) -> None:
    assert timeline.admit("scan", 159 * S - S // 2)
    assert not jumps


@pytest.mark.parametrize("wrong_by", [YEAR, -YEAR, 30 * S, -30 * S])
def test_one_wrong_stamp_is_refused_and_harms_nothing(timeline: Timeline, jumps: List[float], wrong_by: int) -> None:
    with pytest.raises(DataError, match=DOUBTED):
        timeline.require("scan", 159 * S + wrong_by)
    assert timeline.admit("scan", 160 * S)
    assert timeline.admit("scan", 161 * S)
    assert not jumps and timeline.newest_ns("scan") == 161 * S


def test_wrong_stamps_now_and_then_are_refused_each_time(timeline: Timeline, jumps: List[float]) -> None:
    for step in range(1, 20):
        assert not timeline.admit("scan", 159 * S + YEAR + step * S)
        assert timeline.admit("scan", 159 * S + step * S // 10)
    assert not jumps


def test_a_loop_is_one_jump_as_soon_as_two_stamps_agree(timeline: Timeline, jumps: List[float]) -> None:
    assert not timeline.admit("scan", 100 * S)
    assert not jumps
    assert timeline.admit("scan", 100 * S + S // 10)
    assert timeline.admit("tf", 100 * S, witness=False)
    assert timeline.admit("scan", 101 * S)
    assert jumps == [pytest.approx(58.9)]


def test_a_clock_that_is_set_ahead_is_one_jump(timeline: Timeline, jumps: List[float], wall: Wall) -> None:
    assert not timeline.admit("scan", 159 * S + YEAR)
    wall.now_ns += S
    assert timeline.admit("scan", 160 * S + YEAR)
    assert jumps == [-YEAR / S]
    assert not timeline.admit("tf", 160 * S, witness=False)
    assert timeline.admit("tf", 160 * S + YEAR, witness=False)
    assert timeline.admit("scan", 161 * S + YEAR) and len(jumps) == 1


def test_transforms_that_were_set_ahead_first_are_not_kept_out(timeline: Timeline, wall: Wall) -> None:
    for step in range(2):
        timeline.admit("tf", 160 * S + YEAR + step * S, witness=False)
        timeline.admit("scan", 160 * S + YEAR + step * S)
        wall.now_ns += S
    assert timeline.admit("tf", 162 * S + YEAR, witness=False)


def test_a_sensor_that_was_silent_goes_on(timeline: Timeline, jumps: List[float], wall: Wall) -> None:
    wall.now_ns += 600 * S
    assert timeline.admit("scan", 759 * S)
    assert not jumps


def test_a_pause_in_a_recording_that_is_played_fast_is_no_jump(timeline: Timeline, jumps: List[float]) -> None:
    for step in range(1, 20):
        assert timeline.admit("scan", 159 * S + 3 * step * S)
    assert not jumps


def test_a_stamp_that_is_a_little_ahead_does_not_make_the_next_one_old(
    timeline: Timeline, jumps: List[float]
) -> None:
    assert timeline.admit("scan", 167 * S)
    assert timeline.newest_ns("scan") == 159 * S
    assert timeline.admit("scan", 160 * S) and timeline.admit("scan", 161 * S)
    assert not jumps


def test_the_graph_s_clock_is_believed_at_once(jumps: List[float], wall: Wall) -> None:
    line = Timeline(jumps.append, wall)
    for second in (100, 300, 100):
        assert line.admit(CLOCK, second * S)
    assert jumps == [200.0]


def test_messages_of_before_are_kept_out_and_make_no_second_jump(timeline: Timeline, jumps: List[float]) -> None:
    timeline.admit("scan", 100 * S)
    timeline.admit("scan", 100 * S)
    with pytest.raises(DataError, match=LEFT_OVER):
        timeline.require("tf", 159 * S, witness=False)
    assert timeline.admit("tf", 100 * S, witness=False)
    assert timeline.admit("scan", 101 * S)
    assert len(jumps) == 1


def test_grace_ends(timeline: Timeline, wall: Wall) -> None:
    timeline.admit("scan", 100 * S)
    timeline.admit("scan", 100 * S)
    wall.now_ns += GRACE_NS
    assert timeline.admit("tf", 159 * S, witness=False)


def test_transforms_that_go_back_are_no_jump_and_one_far_ahead_is_refused(
    timeline: Timeline, jumps: List[float]
) -> None:
    assert timeline.admit("tf", 100 * S, witness=False)
    assert not timeline.admit("tf", 159 * S + YEAR, witness=False)
    assert timeline.admit("tf", 160 * S, witness=False)
    assert not jumps


def test_streams_on_clocks_far_apart_are_kept_apart(jumps: List[float], wall: Wall) -> None:
    line = Timeline(jumps.append, wall)
    line.admit(CLOCK, 1000 * S)
    line.admit("scan", 100 * S)
    wall.now_ns += 50 * S
    line.admit(CLOCK, 1050 * S)
    line.admit("scan", 150 * S)
    assert line.admit(CLOCK, 1000 * S)
    assert not line.admit("scan", 150 * S)
    assert line.admit("scan", 100 * S)
    assert jumps == [50.0]
