"""The transform tree, beside tf2's own buffer and under what odd recordings hold."""

import numpy as np
import pytest
from poses_at_random import random_pose

from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.stamps import split
from people_fusion.core.transforms import TransformTree

SECOND = 1_000_000_000


def x(metres):
    return Pose.from_xy_yaw(metres, 0.0, 0.0)


def x_of(tree, target, source, stamp_ns):
    return tree.lookup(target, source, stamp_ns).translation[0]


@pytest.fixture
def robot():
    """map -> odom (future-dated, slow) -> base -> laser (static)."""
    tree = TransformTree(history_s=5.0)
    for k in range(11):
        tree.add("map", "odom", k * SECOND + 300_000_000, x(10.0 * k))
    for k in range(101):
        tree.add("odom", "base", k * SECOND // 10, x(0.1 * k))
    tree.add("base", "laser", 0, x(0.25), static=True)
    return tree


def test_chain_is_interpolated_link_by_link(robot):
    stamp = 8 * SECOND + 50_000_000
    assert x_of(robot, "map", "laser", stamp) == pytest.approx(77.5 + 8.05 + 0.25)
    assert x_of(robot, "laser", "map", stamp) == pytest.approx(-(77.5 + 8.05 + 0.25))
    assert x_of(robot, "odom", "laser", stamp) == pytest.approx(8.3)
    assert x_of(robot, "base", "base", 0) == 0.0


def test_leading_slashes_are_of_no_account(robot):
    robot.add("/base", "/camera", 0, x(1.0), static=True)
    assert x_of(robot, "/laser", "camera", 3 * SECOND) == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("target", "source", "stamp_ns", "may_arrive"),
    [
        ("map", "laser", 10 * SECOND + 1, True),  # base is not there yet
        ("map", "laser", 3 * SECOND, False),  # forgotten
        ("nowhere", "laser", 8 * SECOND, True),
        ("map", "nowhere", 8 * SECOND, True),
        ("island", "laser", 8 * SECOND, True),
        ("laser", "island", 8 * SECOND, True),
    ],
)
def test_what_cannot_be_given_says_whether_to_wait(robot, target, source, stamp_ns, may_arrive):
    robot.add("island", "palm", 8 * SECOND, x(1.0))
    with pytest.raises(TransformUnavailable) as caught:
        robot.lookup(target, source, stamp_ns)
    assert caught.value.may_arrive is may_arrive


def test_waiting_is_no_use_when_one_link_has_forgotten_and_another_is_late(robot):
    robot.add("base", "arm", SECOND, x(0.0))
    robot.add("laser", "tip", 20 * SECOND, x(0.0))
    with pytest.raises(TransformUnavailable) as caught:
        robot.lookup("arm", "tip", 10 * SECOND)
    assert not caught.value.may_arrive


def test_frames_that_connect_later_are_found(robot):
    with pytest.raises(TransformUnavailable):
        robot.lookup("map", "camera", 8 * SECOND)
    robot.add("mast", "camera", 0, x(0.5), static=True)
    with pytest.raises(TransformUnavailable):
        robot.lookup("map", "camera", 8 * SECOND)
    robot.add("base", "mast", 0, x(1.0), static=True)
    assert x_of(robot, "base", "camera", 8 * SECOND) == pytest.approx(1.5)


def test_transforms_out_of_order_are_sorted_in():
    tree = TransformTree()
    for k in (0, 4, 2, 1, 3):
        tree.add("odom", "base", k * SECOND, x(float(k * k)))
    assert x_of(tree, "odom", "base", 2 * SECOND) == pytest.approx(4.0)
    assert x_of(tree, "odom", "base", 5 * SECOND // 2) == pytest.approx(6.5)


def test_first_of_two_transforms_with_one_stamp_counts():
    tree = TransformTree()
    for metres in (1.0, 2.0):
        tree.add("odom", "base", SECOND, x(metres))
    tree.add("odom", "base", 2 * SECOND, x(3.0))
    tree.add("odom", "base", SECOND, x(9.0))
    assert x_of(tree, "odom", "base", SECOND) == pytest.approx(1.0)
    assert x_of(tree, "odom", "base", 3 * SECOND // 2) == pytest.approx(2.0)


def test_static_frame_that_tf_repeats_stays_static(robot):
    robot.add("base", "laser", 9 * SECOND, x(0.35))
    assert x_of(robot, "base", "laser", 0) == pytest.approx(0.35)
    assert x_of(robot, "base", "laser", 99 * SECOND) == pytest.approx(0.35)


def test_dynamic_frame_becomes_static_when_tf_static_names_it(robot):
    robot.add("odom", "base", 0, x(7.0), static=True)
    assert x_of(robot, "odom", "laser", 99 * SECOND) == pytest.approx(7.25)


def test_frame_with_a_new_parent_starts_anew(robot):
    robot.add("base", "mast", 0, x(1.0), static=True)
    assert x_of(robot, "base", "laser", 8 * SECOND) == pytest.approx(0.25)
    robot.add("mast", "laser", 9 * SECOND, x(0.5))
    assert x_of(robot, "base", "laser", 9 * SECOND) == pytest.approx(1.5)
    with pytest.raises(DataError, match="former parent"):
        robot.add("base", "laser", 8 * SECOND, x(0.0))


@pytest.mark.parametrize(
    ("parent", "child", "stamp_ns", "pose", "reason"),
    [
        ("laser", "map", 8 * SECOND, x(0.0), "cycle"),
        ("base", "base", 8 * SECOND, x(0.0), "cycle"),
        ("", "base", 8 * SECOND, x(0.0), "without frame"),
        ("base", "/", 8 * SECOND, x(0.0), "without frame"),
        ("odom", "base", 11 * SECOND, x(np.nan), "not finite"),
        ("odom", "base", 11 * SECOND, x(np.inf), "not finite"),
        ("odom", "base", 11 * SECOND, Pose(np.full((3, 3), np.nan), np.zeros(3)), "not finite"),
        ("odom", "base", 3 * SECOND, x(0.0), "older than the history"),
    ],
)
def test_transform_without_sense_is_refused_and_nothing_is_lost(robot, parent, child, stamp_ns, pose, reason):
    before, frames = robot.lookup("map", "laser", 8 * SECOND), robot.frames
    with pytest.raises(DataError, match=reason):
        robot.add(parent, child, stamp_ns, pose)
    np.testing.assert_array_equal(robot.lookup("map", "laser", 8 * SECOND).translation, before.translation)
    assert robot.frames == frames


YEAR = 365 * 24 * 3600 * SECOND


@pytest.mark.parametrize("parent", ["odom", "elsewhere"])
def test_one_transform_stamped_far_ahead_takes_nothing_away(robot, parent):
    for k in range(101, 200):
        if k % 10 == 1:
            try:
                robot.add(parent, "base", YEAR, x(77.0))
            except DataError:
                assert parent == "elsewhere"
            assert x_of(robot, "odom", "base", k * SECOND // 10 - 2 * SECOND) == pytest.approx(0.1 * k - 2.0)
            with pytest.raises(TransformUnavailable) as caught:
                robot.lookup("odom", "base", k * SECOND // 10)
            assert caught.value.may_arrive
        robot.add("odom", "base", k * SECOND // 10, x(0.1 * k))
        assert x_of(robot, "odom", "base", k * SECOND // 10 - 50_000_000) == pytest.approx(0.1 * k - 0.05)
    assert len(robot._links["base"].stamps_ns) == 51


def test_first_transform_stamped_far_ahead_gives_way():
    tree = TransformTree()
    for stamp_ns in (YEAR, SECOND, 2 * SECOND):
        tree.add("odom", "base", stamp_ns, x(float(stamp_ns // SECOND)))
    assert x_of(tree, "odom", "base", 3 * SECOND // 2) == pytest.approx(1.5)


@pytest.mark.parametrize("parent", ["odom", "elsewhere"])
def test_link_that_goes_on_after_a_long_pause_is_taken_up(robot, parent):
    for second in (60, 61):
        try:
            robot.add(parent, "base", second * SECOND, x(float(second)))
        except DataError:
            assert second == 60 and parent == "elsewhere"
    assert x_of(robot, parent, "base", 61 * SECOND) == pytest.approx(61.0)
    with pytest.raises(TransformUnavailable) as caught:
        robot.lookup("odom", "laser", 9 * SECOND)
    assert parent == "elsewhere" or not caught.value.may_arrive


def test_nothing_is_made_up_across_a_pause_longer_than_the_history(robot):
    robot.add("odom", "base", 60 * SECOND, x(60.0))
    assert x_of(robot, "odom", "base", 60 * SECOND) == pytest.approx(60.0)
    with pytest.raises(TransformUnavailable):
        robot.lookup("odom", "base", 30 * SECOND)


def test_history_is_bounded():
    tree = TransformTree(history_s=2.0)
    for k in range(5000):
        tree.add("odom", "base", k * SECOND // 50, x(0.0))
    assert len(tree._links["base"].stamps_ns) == 101


def test_reset_forgets_everything(robot):
    robot.reset()
    assert robot.frames == frozenset()
    robot.add("odom", "base", 0, x(1.0))
    assert x_of(robot, "odom", "base", 0) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", range(5))
def test_random_trees_are_looked_up_as_by_tf2(seed):
    """Random trees, links static or with their own rates, a few transforms out of order or repeated."""
    tf2_py = pytest.importorskip("tf2_py", reason="tf2 is not installed: the tree is not compared with it")
    import genpy
    from geometry_msgs.msg import TransformStamped

    rng = np.random.default_rng(seed)
    tree, buffer = TransformTree(history_s=10.0), tf2_py.BufferCore(genpy.Duration(10))

    def add(parent, child, stamp_ns, pose, static):
        message = TransformStamped()
        message.header.frame_id, message.child_frame_id = parent, child
        message.header.stamp = genpy.Time(*split(stamp_ns))
        t, q = message.transform.translation, message.transform.rotation
        t.x, t.y, t.z = pose.translation
        q.x, q.y, q.z, q.w = pose.quaternion
        (buffer.set_transform_static if static else buffer.set_transform)(message, "test")
        tree.add(parent, child, stamp_ns, pose, static)

    frames = ["root"]
    for i in range(12):
        frames.append(f"frame_{i}")
        parent, static = frames[rng.integers(len(frames) - 1)], rng.random() < 0.3
        stamps = 100 * SECOND + np.arange(0, 14 * SECOND, int(rng.uniform(0.05, 1.0) * SECOND))
        stamps = np.concatenate([stamps, stamps[-2:]])
        late = rng.integers(len(stamps) - 3)
        stamps[[late, late + 2]] = stamps[[late + 2, late]]
        for stamp in stamps[:1] if static else stamps:
            add(parent, frames[-1], int(stamp), random_pose(rng), static)

    outcomes = {True: 0, False: 0}
    for _ in range(400):
        target, source = rng.choice(frames, 2)
        stamp = int(100 * SECOND + rng.uniform(0.0, 14.5) * SECOND)
        try:
            expected = buffer.lookup_transform_core(target, source, genpy.Time(*split(stamp))).transform
        except tf2_py.TransformException:
            expected = None
        try:
            pose = tree.lookup(target, source, stamp)
        except TransformUnavailable:
            pose = None
        assert (pose is None) == (expected is None), (target, source, stamp)
        outcomes[pose is not None] += 1
        if pose is not None:
            t, q = expected.translation, expected.rotation
            theirs = Pose.from_quaternion(np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]))
            np.testing.assert_allclose(pose.translation, theirs.translation, atol=1e-6)
            np.testing.assert_allclose(pose.rotation, theirs.rotation, atol=1e-6)
    assert min(outcomes.values()) > 20


def test_reset_may_keep_what_is_static() -> None:
    tree = TransformTree()
    tree.add("base", "laser", 0, Pose.identity(), static=True)
    tree.add("odom", "base", 10**9, Pose.identity())
    tree.reset(keep_static=True)
    assert tree.frames == {"base", "laser"}
    tree.add("odom", "base", 0, Pose.identity())
    tree.lookup("odom", "laser", 0)
    tree.reset()
    assert not tree.frames
