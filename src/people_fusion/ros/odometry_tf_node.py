"""Odometry messages as the transform odom to base, for robots whose tf lacks it; rviz can use it, too."""

from __future__ import annotations

import time
from typing import Any, Optional, Set

import rospy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from tf2_msgs.msg import TFMessage

from people_fusion.core.errors import DataError
from people_fusion.ros import topics
from people_fusion.ros.conversions import frame_from_msg, pose_from_msg

ODOMETRY = "odom"
QUEUE = 100
LISTEN_S = 1.0  # by the wall; whoever publishes the transform has done so by then


class OdometryTransforms:
    """Which odometry becomes a transform: that of a frame whose place nobody else publishes."""

    def __init__(self) -> None:
        self._placed: Set[str] = set()

    def is_placed(self, child_frame: str) -> bool:
        """Whether somebody else publishes where this frame is."""
        return child_frame in self._placed

    def hear(self, message: Any) -> None:
        """A TFMessage of somebody else."""
        self._placed.update(frame_from_msg(transform.child_frame_id) for transform in message.transforms)

    def convert(self, message: Any) -> Optional[Any]:
        """TransformStamped of a nav_msgs/Odometry, or None where tf has it already.

        Raises:
            DataError: no stamp or frames, a value is not finite, or no rotation.
        """
        parent, child = frame_from_msg(message.header.frame_id), frame_from_msg(message.child_frame_id)
        if not parent or not child or not message.header.stamp:
            raise DataError("odometry without stamp or frames", f"{parent!r} to {child!r}")
        pose = pose_from_msg(message.pose.pose)
        if self.is_placed(child):
            return None
        transform = TransformStamped(child_frame_id=child)
        transform.header.stamp, transform.header.frame_id = message.header.stamp, parent
        shift, turn = transform.transform.translation, transform.transform.rotation
        shift.x, shift.y, shift.z = pose.translation.tolist()
        turn.x, turn.y, turn.z, turn.w = pose.quaternion.tolist()
        return transform


class _Node:
    def __init__(self) -> None:
        self._transforms = OdometryTransforms()
        self._speaks_from = time.monotonic() + LISTEN_S
        self._publisher = rospy.Publisher(topics.TF, TFMessage, queue_size=QUEUE, tcp_nodelay=True)
        for topic in (topics.TF, topics.TF_STATIC):
            rospy.Subscriber(topic, TFMessage, self._on_transforms, queue_size=QUEUE, tcp_nodelay=True)
        rospy.Subscriber(ODOMETRY, Odometry, self._on_odometry, queue_size=QUEUE, tcp_nodelay=True)

    def _on_transforms(self, message: Any) -> None:
        if message._connection_header["callerid"] != rospy.get_name():
            self._transforms.hear(message)

    def _on_odometry(self, message: Any) -> None:
        try:
            transform = self._transforms.convert(message)
        except DataError as error:
            rospy.logwarn_throttle(10.0, f"{error}")
            return
        if transform is None:
            rospy.loginfo_once(f"tf places {message.child_frame_id}: odometry is not needed")
        elif time.monotonic() > self._speaks_from:
            rospy.loginfo_once(f"odometry stands in for {transform.header.frame_id} to {transform.child_frame_id}")
            self._publisher.publish(TFMessage([transform]))


def main() -> int:
    """Entry of scripts/odometry_tf; returns the exit status."""
    rospy.init_node("odometry_tf")
    _Node()
    rospy.spin()
    return 0
