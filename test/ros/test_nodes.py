from __future__ import annotations

import dataclasses
from collections import deque
from types import SimpleNamespace
from typing import Any, Dict

import numpy as np
import pytest

pytest.importorskip("people_fusion.msg", reason="the messages are not built; tools/test builds them")

from geometry_msgs.msg import Point
from std_msgs.msg import Header

from people_fusion.core.errors import ConfigError
from people_fusion.core.tracks import Tracks
from people_fusion.ros import adapters
from people_fusion.ros.composed_node import ComposedSettings
from people_fusion.ros.diagnostics import ERROR, OK, WARN, judge
from people_fusion.ros.head_cue_node import HeadCueSettings
from people_fusion.ros.leg_cue_node import LegCueSettings
from people_fusion.ros.node import read_parameters
from people_fusion.ros.people_tracker_node import PeopleTracker, PeopleTrackerSettings, delay_facts
from people_fusion.ros.rgbd_cue_node import RgbdCueSettings
from people_fusion.ros.transforms import Missing
from people_fusion.tracking.fusion import FusionConfig

NOW = 100.0


def test_own_parameters_and_preset_are_told_apart() -> None:
    parameters = {"scans": ["front", "rear"], "compatible": "strands", "frames": {"world": "hall"}}
    settings, config = read_parameters(ComposedSettings, parameters, "/node")
    assert settings.scans == ("front", "rear")
    assert settings.compatible == "strands"
    assert config.frames.world == "hall"


@pytest.mark.parametrize(
    "settings", [LegCueSettings, PeopleTrackerSettings, ComposedSettings, HeadCueSettings, RgbdCueSettings]
)
def test_own_parameters_hide_none_of_the_preset(settings: Any) -> None:
    own = {field.name for field in dataclasses.fields(settings)}
    assert not own & {field.name for field in dataclasses.fields(FusionConfig)}


@pytest.mark.parametrize(
    ("settings", "parameters", "path"),
    [
        (LegCueSettings, {"scans": 3}, "/node/scans"),
        (LegCueSettings, {"scans": []}, "scans"),
        (LegCueSettings, {"scans": ["a", "a"]}, "scans"),
        (LegCueSettings, {"compatible": "strands"}, "/node/compatible"),
        (RgbdCueSettings, {}, "depths, clouds"),
        (RgbdCueSettings, {"depths": ["a"], "clouds": ["a"]}, "depths, clouds"),
        (RgbdCueSettings, {"depths": ["a", "b"], "colours": ["c"]}, "colours"),
        (RgbdCueSettings, {"depths": ["a"], "camera_infos": ["c", "d"]}, "camera_infos"),
        (RgbdCueSettings, {"depths": ["a"], "colour_tolerance_s": -1.0}, "/node/colour_tolerance_s"),
        (PeopleTrackerSettings, {"compatible": "ros2"}, "/node/compatible"),
        (PeopleTrackerSettings, {"tracker": {"type": "kalman", "gate": -1.0}}, "/node/tracker/gate"),
        (PeopleTrackerSettings, [], "/node"),
    ],
)
def test_wrong_parameters_are_named(settings: Any, parameters: Any, path: str) -> None:
    with pytest.raises(ConfigError, match=f"{path}: "):
        read_parameters(settings, parameters, "/node")


def judged(**changes: Any) -> Any:
    healthy: Dict[str, Any] = {"silent": {"scan": 0.1}, "missing": [], "bad": {}, "since_jump": float("inf")}
    healthy["now"] = NOW
    return judge(**{**healthy, **changes})


def test_node_at_work_is_ok() -> None:
    assert judged() == (OK, "running")


def test_frame_that_never_appeared_is_an_error_that_names_it() -> None:
    level, message = judged(missing=[Missing("odom", "laser", NOW - 5.0, False, "no such frame")])
    assert level == ERROR
    assert "from laser to odom" in message
    assert "no such frame" in message


def test_frame_that_was_there_before_is_a_warning() -> None:
    assert judged(missing=[Missing("odom", "laser", NOW - 5.0, True, "")]).level == WARN


def test_transform_that_is_merely_late_is_no_complaint() -> None:
    assert judged(missing=[Missing("odom", "laser", NOW - 0.1, True, "")]).level == OK


def test_silent_input_is_a_warning_that_names_it() -> None:
    assert judged(silent={"scan": 10.0}) == (WARN, "nothing on scan for 10 s")
    assert judged(silent={"scan": float("inf")}) == (WARN, "nothing on scan yet")


def test_bad_data_and_jumps_are_warnings() -> None:
    assert judged(bad={"scan without beams": 3}) == (WARN, "scan without beams (3)")
    assert judged(since_jump=1.0).level == WARN


def test_worst_complaint_sets_the_level() -> None:
    status = judged(bad={"x": 1}, missing=[Missing("odom", "laser", NOW - 5.0, False, "")])
    assert status.level == ERROR
    assert "x (1)" in status.message


def test_output_delay_is_that_of_the_last_second() -> None:
    delays = deque([(10**9, 9 * 10**8), (3 * 10**9, 10**7), (3 * 10**9 + 10**8, 3 * 10**7)])
    facts = delay_facts(delays, 3 * 10**9 + 5 * 10**8)
    assert facts == {"outputs a second": "2", "output delay, mean ms": "20.0", "output delay, max ms": "30.0"}
    assert len(delays) == 2
    assert delay_facts(delays, 9 * 10**9)["output delay, mean ms"] == "-"


def test_what_the_tracker_failed_on_is_not_tried_again_and_keeps_nobody_waiting() -> None:
    """A thread goes on after an exception: with the next measurement, not with the same one for ever."""
    processed, published = [], []

    def process(measurement: Any) -> bool:
        processed.append(measurement.stamp_ns)
        return 1 // (measurement.stamp_ns - 2) is not None

    node = SimpleNamespace(_processed_ns=None, _fusion=SimpleNamespace(process=process))
    node._released, node._publish = [SimpleNamespace(stamp_ns=n) for n in (1, 2, 3)], lambda: published.append(0)
    with pytest.raises(ZeroDivisionError):
        PeopleTracker._process(node)  # type: ignore[arg-type]
    node._released.append(SimpleNamespace(stamp_ns=4))
    PeopleTracker._process(node)  # type: ignore[arg-type]
    assert processed == [1, 2, 3, 4] and len(published) == 3
    assert not node._released


def one_track() -> Tracks:
    flag = np.array([True])
    return Tracks(
        7 * 10**9, "map", np.array([12]), np.array([[1.0, 2.0, 1.7, 0.5, -0.5]]), np.eye(5)[None], np.array([0.9]),
        flag, flag, ~flag, np.array([3.5]),
    )  # fmt: skip


def test_people_msgs_are_plain_copies() -> None:
    messages = SimpleNamespace(
        People=lambda header: SimpleNamespace(header=header, people=[]),
        Person=lambda name, reliability: SimpleNamespace(name=name, reliability=reliability, velocity=Point()),
    )
    message = adapters.people_to_msg(one_track(), messages)
    (person,) = message.people
    assert isinstance(message.header, Header)
    assert (person.name, person.reliability) == ("12", 0.9)
    assert (person.position.x, person.position.y, person.velocity.y) == (1.0, 2.0, -0.5)


def test_spencer_messages_are_plain_copies() -> None:
    messages = SimpleNamespace(
        TrackedPersons=lambda header: SimpleNamespace(header=header, tracks=[]), TrackedPerson=SimpleNamespace
    )
    (person,) = adapters.spencer_to_msg(one_track(), messages).tracks
    assert (person.track_id, person.is_matched, person.is_occluded) == (12, True, False)
    assert person.age.to_sec() == 3.5
    assert person.twist.twist.linear.x == 0.5


def test_adapters_stay_away_where_their_packages_are_not_installed() -> None:
    assert adapters._messages("surely_not_installed_msgs") is None
