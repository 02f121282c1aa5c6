#!/usr/bin/env python3
"""Transforms that arrive 200 ms after what they are for."""

from __future__ import annotations

import sys
import tempfile
import unittest
from collections import deque
from pathlib import Path
from typing import Any, Deque, Tuple

import rospy
import rostest
from graph import DiagnosticListener, TrackListener, offline, play, scored, simulated, wait_for_subscribers
from tf2_msgs.msg import TFMessage

DELAY = rospy.Duration.from_sec(0.2)
MOTA_TOLERANCE = 0.02


class DelayedTransforms(unittest.TestCase):
    def setUp(self) -> None:
        self._held: Deque[Tuple[rospy.Time, Any]] = deque()
        self._delayed = rospy.Publisher("/tf", TFMessage, queue_size=1000, tcp_nodelay=True)
        rospy.Subscriber("/tf_in_time", TFMessage, self._hold, queue_size=1000, tcp_nodelay=True)
        rospy.Timer(rospy.Duration.from_sec(0.01), self._release)

    def test_people_are_tracked_as_if_transforms_were_in_time(self) -> None:
        with tempfile.TemporaryDirectory() as directory:
            bag = simulated(Path(directory), "hallway", 20.0)
            wait_for_subscribers("/tf", "/leg_cue", "/people_tracker")
            listener, diagnostics = TrackListener(), DiagnosticListener()
            play(bag, "/tf:=/tf_in_time")
            live, reference = scored(bag, listener.tracks()), scored(bag, offline(bag))
            rospy.loginfo("MOTA late %.3f, in time %.3f", live.mota, reference.mota)
            self.assertLess(abs(live.mota - reference.mota), MOTA_TOLERANCE)
            self.assertEqual(diagnostics.count("leg_cue", "lost: transform did not arrive in time"), 0)

    def _hold(self, message: Any) -> None:
        self._held.append((rospy.Time.now() + DELAY, message))

    def _release(self, _event: Any) -> None:
        while self._held and self._held[0][0] <= rospy.Time.now():
            self._delayed.publish(self._held.popleft()[1])


if __name__ == "__main__":
    rospy.init_node("delayed_tf")
    rostest.rosrun("people_fusion", "delayed_tf", DelayedTransforms, sys.argv)
