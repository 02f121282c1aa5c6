#!/usr/bin/env python3
"""Odometry messages stand in for the transform that tf lacks, and are left out where tf has it."""

from __future__ import annotations

import sys
import tempfile
import unittest
from pathlib import Path
from typing import Any, List

import rosbag
import rospy
import rostest
from graph import TrackListener, play, scored, simulated, wait_for_subscribers, wait_until
from tf2_msgs.msg import TFMessage

BASE = "base_footprint"


class OdometryTransform(unittest.TestCase):
    def setUp(self) -> None:
        self.placed_by: List[str] = []
        self.listener = rospy.Subscriber("/tf", TFMessage, self.on_transforms, queue_size=1000)
        wait_for_subscribers("/odom", "/odometry_tf")
        wait_for_subscribers("/tf", "/odometry_tf", "/people_tracker", "/leg_cue_front")

    def tearDown(self) -> None:
        self.listener.unregister()

    def on_transforms(self, message: Any) -> None:
        if any(transform.child_frame_id == BASE for transform in message.transforms):
            self.placed_by.append(message._connection_header["callerid"])

    def test_people_are_tracked_by_odometry_messages_alone(self) -> None:
        with tempfile.TemporaryDirectory() as directory:
            whole = simulated(Path(directory), "follow", 12.0)
            lacking = Path(directory) / "lacking.bag"
            with rosbag.Bag(str(whole)) as bag, rosbag.Bag(str(lacking), "w") as copy:
                for topic, message, at in bag.read_messages():
                    if topic == "/tf":
                        message.transforms = [one for one in message.transforms if one.child_frame_id != BASE]
                    copy.write(topic, message, at)
            listener = TrackListener()
            play(lacking)
            wait_until(lambda: listener.messages, "tracks")
            self.assertEqual(set(self.placed_by), {"/odometry_tf"})
            self.assertGreater(scored(whole, listener.tracks()).mota, 0.3)


if __name__ == "__main__":
    rospy.init_node("odometry")
    rostest.rosrun("people_fusion", "odometry", OdometryTransform, sys.argv)
