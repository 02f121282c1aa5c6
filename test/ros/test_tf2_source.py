from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import pytest

pytest.importorskip("people_fusion.msg", reason="the messages are not built; tools/test builds them")

from geometry_msgs.msg import TransformStamped

from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import TransformTree
from people_fusion.ros.conversions import header_to_msg
from people_fusion.ros.transforms import Tf2Source

S = 10**9


def transform(parent: str, child: str, stamp_ns: int, pose: Pose) -> Any:
    message = TransformStamped(header=header_to_msg(stamp_ns, parent), child_frame_id=child)
    shift, turn = message.transform.translation, message.transform.rotation
    shift.x, shift.y, shift.z = pose.translation.tolist()
    turn.x, turn.y, turn.z, turn.w = pose.quaternion.tolist()
    return message


@pytest.fixture
def source() -> Tf2Source:
    source = Tf2Source(10.0)
    source.add(transform("base_link", "laser", 0, Pose.from_xy_yaw(0.2, 0.0, math.pi, 0.4)), static=True)
    for second in range(1, 6):
        source.add(transform("odom", "base_link", second * S, Pose.from_xy_yaw(second, 0.0, 0.1 * second)))
    return source


def test_same_frame_is_the_identity_though_nobody_knows_it() -> None:
    pose = Tf2Source(10.0).lookup("laser", "laser", 5)
    np.testing.assert_array_equal(pose.translation, np.zeros(3))


def test_lookup_agrees_with_the_tree_of_replays(source: Tf2Source) -> None:
    tree = TransformTree(10.0)
    tree.add("base_link", "laser", 0, Pose.from_xy_yaw(0.2, 0.0, math.pi, 0.4), static=True)
    for second in range(1, 6):
        tree.add("odom", "base_link", second * S, Pose.from_xy_yaw(second, 0.0, 0.1 * second))
    for target, origin in (("odom", "laser"), ("laser", "odom"), ("base_link", "laser")):
        for stamp_ns in (S, 2 * S + 1, 3_300_000_000, 5 * S):
            live, offline = source.lookup(target, origin, stamp_ns), tree.lookup(target, origin, stamp_ns)
            np.testing.assert_allclose(live.translation, offline.translation, atol=1e-9)
            np.testing.assert_allclose(live.rotation, offline.rotation, atol=1e-9)


@pytest.mark.parametrize(
    ("target", "origin", "stamp_ns", "may_arrive"),
    [
        ("odom", "laser", 6 * S, True),
        ("odom", "laser", S // 2, False),
        ("map", "laser", 2 * S, True),
        ("odom", "nowhere", 2 * S, True),
        ("odom", "", 2 * S, False),
    ],
    ids=["too new", "too old", "unknown target", "unknown source", "no name"],
)
def test_what_is_missing_is_said_and_whether_it_may_arrive(
    source: Tf2Source, target: str, origin: str, stamp_ns: int, may_arrive: bool
) -> None:
    with pytest.raises(TransformUnavailable, match=f"from {origin} to {target}") as raised:
        source.lookup(target, origin, stamp_ns)
    assert raised.value.may_arrive is may_arrive
    (missing,) = source.missing()
    assert (missing.target_frame, missing.source_frame, missing.ever_found) == (target, origin, False)


def test_missing_ends_when_found(source: Tf2Source) -> None:
    with pytest.raises(TransformUnavailable):
        source.lookup("odom", "laser", 6 * S)
    source.add(transform("odom", "base_link", 6 * S, Pose.identity()))
    source.lookup("odom", "laser", 6 * S)
    assert source.missing() == []


def test_missing_remembers_that_it_was_found_once(source: Tf2Source) -> None:
    source.lookup("odom", "laser", 5 * S)
    with pytest.raises(TransformUnavailable):
        source.lookup("odom", "laser", 6 * S)
    (missing,) = source.missing()
    assert missing.ever_found
    assert missing.since <= time.monotonic()


def test_clear_keeps_static_transforms_only(source: Tf2Source) -> None:
    source.lookup("odom", "laser", 5 * S)
    source.clear()
    source.lookup("base_link", "laser", 5 * S)
    with pytest.raises(TransformUnavailable):
        source.lookup("odom", "laser", 5 * S)


def test_older_transforms_are_taken_after_clear(source: Tf2Source) -> None:
    source.add(transform("odom", "base_link", 100 * S, Pose.identity()))
    source.clear()
    source.add(transform("odom", "base_link", S, Pose.from_xy_yaw(7.0, 0.0, 0.0)))
    assert source.lookup("odom", "base_link", S).translation[0] == 7.0


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_transform_that_is_not_finite_is_refused(source: Tf2Source, value: float) -> None:
    message = transform("odom", "base_link", 6 * S, Pose.identity())
    message.transform.translation.x = value
    with pytest.raises(DataError):
        source.add(message)


def test_transform_without_rotation_is_refused(source: Tf2Source) -> None:
    message = transform("odom", "base_link", 6 * S, Pose.identity())
    message.transform.rotation.w = 0.0
    with pytest.raises(DataError):
        source.add(message)


def test_leading_slashes_do_not_matter(source: Tf2Source) -> None:
    source.add(transform("/odom", "/base_link", 6 * S, Pose.from_xy_yaw(9.0, 0.0, 0.0)))
    assert source.lookup("odom", "base_link", 6 * S).translation[0] == 9.0


@pytest.mark.parametrize(("parent", "child"), [("", "laser"), ("odom", ""), ("laser", "/laser"), ("/", "laser")])
def test_a_transform_without_two_frames_is_refused(parent: str, child: str) -> None:
    with pytest.raises(DataError, match="without two frames"):
        Tf2Source(10.0).add(transform(parent, child, S, Pose.identity()))
