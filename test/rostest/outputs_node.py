#!/usr/bin/env python3
"""What the composed node publishes of one person, and that markers go when he goes."""

from __future__ import annotations

import math
import sys
import unittest
from typing import Any, Dict, Set

import rospy
import rostest
from geometry_msgs.msg import PoseArray, PoseStamped
from graph import wait_for_subscribers, wait_until
from scans import PERIOD_S, good_scan
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import Marker, MarkerArray

from people_fusion.msg import DetectedPersons, TrackedPersons

NEAR, FAR = (2.0, 0.0), (0.0, 40.0)  # the second is out of sight
TOPICS: Dict[str, Any] = {
    "/people_fusion/tracks": TrackedPersons,
    "/people_fusion/hypotheses": TrackedPersons,
    "/people_fusion/poses": PoseArray,
    "/people_fusion/markers": MarkerArray,
    "/people_fusion/detections": DetectedPersons,
    "/people_fusion/detection_markers": MarkerArray,
    "/people_tracker/pose_array": PoseArray,
    "/people_tracker/pose": PoseStamped,
    "/people_tracker/marker_array": MarkerArray,
}


class Outputs(unittest.TestCase):
    def setUp(self) -> None:
        self.newest: Dict[str, Any] = {}
        self.shown: Dict[Any, bool] = {}
        self.supposed: Set[Any] = set()  # stamps with somebody
        self.sure: Set[Any] = set()
        self._scans = rospy.Publisher("/scan", LaserScan, queue_size=10)
        for topic, kind in TOPICS.items():
            rospy.Subscriber(topic, kind, lambda message, topic=topic: self.newest.update({topic: message}))
        rospy.Subscriber("/people_fusion/markers", MarkerArray, self._on_markers, queue_size=100)
        rospy.Subscriber("/people_fusion/hypotheses", TrackedPersons, lambda m: self._note(m, self.supposed))
        rospy.Subscriber("/people_fusion/tracks", TrackedPersons, lambda m: self._note(m, self.sure))
        wait_for_subscribers("/scan", "/people_fusion")

    def test_person_is_published_everywhere_and_removed_when_gone(self) -> None:
        self._scan_until(lambda: set(self.newest) == set(TOPICS), "a message on every topic", *NEAR)
        nearest = self.newest["/people_tracker/pose"]
        self.assertEqual(nearest.header.frame_id, "laser")
        self.assertLess(math.hypot(nearest.pose.position.x - 2.0, nearest.pose.position.y), 0.3)
        self.assertEqual(len(self.newest["/people_tracker/pose_array"].poses), 1)
        self.assertEqual(len(self.newest["/people_fusion/poses"].poses), 1)
        self._scan_until(lambda: "body" in {name for name, _ in self.shown}, "a body", *NEAR)
        self.assertLess(min(self.supposed), min(self.sure))
        self._scan_until(lambda: not self.newest["/people_fusion/tracks"].tracks, "the track to end", *FAR)
        self._scan_until(lambda: not self.shown, "the markers to go", *FAR)

    @staticmethod
    def _note(message: Any, stamps: Set[Any]) -> None:
        if message.tracks:
            stamps.add(message.header.stamp)

    def _scan_until(self, condition: Any, what: str, x: float, y: float) -> None:
        def scanned() -> Any:
            self._scans.publish(good_scan(x, y))
            rospy.sleep(PERIOD_S)
            return condition()

        wait_until(scanned, what)

    def _on_markers(self, message: Any) -> None:
        for marker in message.markers:
            if marker.action == Marker.ADD:
                self.shown[marker.ns, marker.id] = True
            else:
                self.shown.pop((marker.ns, marker.id), None)


if __name__ == "__main__":
    rospy.init_node("outputs")
    rostest.rosrun("people_fusion", "outputs", Outputs, sys.argv)
