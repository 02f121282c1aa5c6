from __future__ import annotations

import threading
import time
from typing import List

import pytest

pytest.importorskip("people_fusion.msg", reason="the messages are not built; tools/test builds them")

from people_fusion.ros.intake import SHED, Intake


def items(intake: Intake) -> List[str]:
    return [entry.item for entry in intake.take(0.0)]


def test_all_sources_come_out_in_order_of_arrival_once() -> None:
    intake = Intake(10, 10)
    for item in ("a1", "b1", "a2", "c1", "b2"):
        assert intake.put(item[0], item, 0) is None
    assert items(intake) == ["a1", "b1", "a2", "c1", "b2"]
    assert items(intake) == []


def test_oldest_of_a_flooding_source_is_shed_and_counted_and_others_are_spared() -> None:
    intake = Intake(3, 10)
    intake.put("calm", "calm", 0)
    shed = [intake.put("flood", f"{number}", 0) for number in range(200)]
    assert shed == [None] * 3 + [f"{number}" for number in range(197)]
    assert items(intake) == ["calm", "197", "198", "199"]
    assert intake.counters() == {f"flood: lost: {SHED}": 197}


def test_sources_without_end_do_not_fill_it() -> None:
    intake = Intake(3, 5)
    for number in range(100):
        intake.put(f"source {number}", "item", 0)
    assert len(items(intake)) == 5
    assert sum(intake.counters().values()) == 95


def test_it_sleeps_until_something_comes_or_it_is_woken() -> None:
    intake = Intake(3, 5)
    began = time.monotonic()
    assert intake.take(0.05) == []
    assert time.monotonic() - began >= 0.05
    for rouse in (lambda: intake.put("a", "item", 0), intake.wake):
        timer = threading.Timer(0.02, rouse)
        timer.start()
        began = time.monotonic()
        intake.take(5.0)
        assert time.monotonic() - began < 1.0
        timer.join()


def test_waking_is_not_forgotten_by_who_is_not_asleep() -> None:
    intake = Intake(3, 5)
    intake.wake()
    began = time.monotonic()
    assert intake.take(5.0) == []
    assert time.monotonic() - began < 1.0
