"""Annotated people are understood in whatever message they were stored."""

from __future__ import annotations

from pathlib import Path
from typing import Any, List

import numpy as np
import pytest
from bags import START_NS, BagBuilder, person_at

from people_fusion.core.errors import RecordingError, TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import TransformTree
from people_fusion.replay.ground_truth import Instant, read_ground_truth
from people_fusion.replay.recording import Recording


def truth_of(path: Path, topic: str = "/truth") -> List[Instant]:
    with Recording(path) as recording:
        return read_ground_truth(recording, recording.topic(topic), recording.of_kind("LaserScan"))


def tracked(bag: BagBuilder, identity: int, x: float, speed: float, twist_variance: float = 0.0) -> Any:
    pose = bag.make("geometry_msgs/PoseWithCovariance", bag.pose(x, 1.0, 1.7), np.zeros(36))
    linear, angular = (bag.make("geometry_msgs/Vector3", x, 0.0, 0.0) for x in (speed, 0.0))
    twist = bag.make("geometry_msgs/Twist", linear, angular)
    twist = bag.make("geometry_msgs/TwistWithCovariance", twist, np.diag([twist_variance] * 6).ravel())
    age = bag.make("builtin_interfaces/Duration", 0, 0)
    return bag.make("people_fusion/TrackedPerson", identity, False, False, 0, age, 1.0, pose, twist)


def test_tracked_persons_keep_identity_position_and_velocity(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        people = [tracked(bag, 4, 2.0, 0.5), tracked(bag, 9, 3.0, 0.0, twist_variance=1e6)]
        bag.add("/truth", "people_fusion/TrackedPersons", 0.1, bag.header(0.1, "/map"), people)
        bag.add("/truth", "people_fusion/TrackedPersons", 0.2, bag.header(0.2, "/map"), [])
    first, second = truth_of(tmp_path / "a.bag")
    assert (first.stamp_ns, first.frame_id, first.ids.tolist()) == (START_NS + 10**8, "map", [4, 9])
    np.testing.assert_array_equal(first.positions, [[2.0, 1.0, 1.7], [3.0, 1.0, 1.7]])
    np.testing.assert_array_equal(first.velocities, [[0.5, 0.0, 0.0], [np.nan] * 3])
    assert len(second.ids) == 0 and second.positions.shape == (0, 3)


def test_a_person_without_header_belongs_to_the_scan_before_it(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        bag.add("/truth", "leg_tracker/Person", 0.0, bag.pose(9.0, 9.0), 1)  # no scan yet
        bag.scan(0.1, frame_id="/laser", latency_s=0.06)
        bag.add("/truth", "leg_tracker/Person", 0.16, bag.pose(1.0, 2.0, w=0.0), 5)
        bag.add("/truth", "leg_tracker/Person", 0.16, bag.pose(3.0, 4.0, w=0.0), 3)
        bag.scan(0.2, latency_s=0.06)
    (instant,) = truth_of(tmp_path / "a.bag")
    assert (instant.stamp_ns, instant.frame_id) == (START_NS + 10**8, "laser")
    assert dict(zip(instant.ids.tolist(), instant.positions[:, :2].tolist())) == {5: [1.0, 2.0], 3: [3.0, 4.0]}


def test_lists_of_persons_with_ids_names_or_only_an_order_are_read(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        bag.person_array(0.1, topic="/numbers")
        point = bag.make("geometry_msgs/Point", 1.0, 2.0, 0.0)
        rest = bag.make("geometry_msgs/Point", 0.1, 0.2, 0.0)
        people = [bag.make("people_msgs/Person", name, point, rest, 1.0) for name in ("ann", "bob")]
        bag.add("/names", "people_msgs/People", 0.1, bag.header(0.1, "map"), people[:1])
        bag.add("/names", "people_msgs/People", 0.2, bag.header(0.2, "map"), people[::-1])
        poses = [bag.pose(1.0, 0.0), bag.pose(2.0, 0.0)]
        bag.add("/order", "geometry_msgs/PoseArray", 0.1, bag.header(0.1, "map"), poses)
    (numbers,) = truth_of(tmp_path / "a.bag", "/numbers")
    assert numbers.ids.tolist() == [7] and numbers.positions[0, :2].tolist() == list(person_at(0.1))
    ann, both = truth_of(tmp_path / "a.bag", "/names")
    assert ann.ids.tolist() == [0] and both.ids.tolist() == [1, 0] and ann.velocities[0].tolist() == [0.1, 0.2, 0.0]
    (order,) = truth_of(tmp_path / "a.bag", "/order")
    assert order.ids.tolist() == [0, 1] and order.positions[:, 0].tolist() == [1.0, 2.0]


def test_positions_that_are_not_finite_and_doubles_are_left_out(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        people = [bag.make("leg_tracker/Person", bag.pose(x, 0.0), i) for x, i in ((1.0, 1), (np.nan, 2), (3.0, 1))]
        bag.add("/truth", "leg_tracker/PersonArray", 0.1, bag.header(0.1, "map"), people)
    (instant,) = truth_of(tmp_path / "a.bag")
    assert instant.ids.tolist() == [1] and instant.positions[:, 0].tolist() == [1.0]


def test_messages_without_people_are_refused_by_topic(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        bag.add("/truth", "odd_msgs/Nothing", 0.1, bag.header(0.1, "map"), 1.0)
    with pytest.raises(RecordingError, match=r"no people in the messages of /truth \(odd_msgs/Nothing\)"):
        truth_of(tmp_path / "a.bag")


def test_people_move_into_another_frame_at_their_stamp() -> None:
    instant = Instant(
        5, "laser", np.array([1]), np.array([[1.0, 0.0, 0.0]]), np.array([[1.0, 0.0, 0.0]])
    )
    tree = TransformTree()
    tree.add("odom", "laser", 0, Pose.from_xy_yaw(0.0, 0.0, 0.0))
    tree.add("odom", "laser", 10, Pose.from_xy_yaw(2.0, 0.0, np.pi))
    moved = instant.into("odom", tree)
    np.testing.assert_allclose(moved.positions, [[1.0, 1.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(moved.velocities, [[0.0, 1.0, 0.0]], atol=1e-12)
    with pytest.raises(TransformUnavailable):
        instant.into("map", tree)
