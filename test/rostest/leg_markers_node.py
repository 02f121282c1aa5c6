#!/usr/bin/env python3
"""Legs of somebody who walks are seen, in the colour of that person once there is one."""

from __future__ import annotations

import sys
import unittest
from typing import Any, List, Set, Tuple

import rospy
import rostest
from graph import wait_for_subscribers, wait_until
from scans import PERIOD_S, good_scan
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import MarkerArray

SPEED = 0.5


def colours(markers: Any, namespace: str) -> Set[Tuple[float, float, float]]:
    return {(marker.color.r, marker.color.g, marker.color.b) for marker in markers if marker.ns == namespace}


class LegMarkers(unittest.TestCase):
    def setUp(self) -> None:
        self.shins: List[Any] = []
        self.markers: List[Any] = []
        self._scans = rospy.Publisher("/scan", LaserScan, queue_size=10)
        rospy.Subscriber("/people_fusion/leg_markers", MarkerArray, self._on_legs)
        rospy.Subscriber("/people_fusion/markers", MarkerArray, self._on_markers)
        wait_for_subscribers("/scan", "/people_fusion")

    def test_legs_are_shown_and_belong_to_the_person_who_walks(self) -> None:
        began = rospy.get_time()

        def walked() -> bool:
            way = SPEED * (rospy.get_time() - began)
            self._scans.publish(good_scan(1.0 + way % 4.0, 0.0))
            rospy.sleep(PERIOD_S)
            bodies = colours(self.markers, "body")
            return bool(bodies) and len(self.shins) == 2 and colours(self.shins, "shin") == bodies

        wait_until(walked, "two shins in the colour of a body")
        self.assertTrue(all(shin.header.frame_id == "laser" for shin in self.shins))

    def _on_markers(self, message: Any) -> None:
        self.markers = message.markers

    def _on_legs(self, message: Any) -> None:
        self.shins = [marker for marker in message.markers if marker.ns == "shin"]


if __name__ == "__main__":
    rospy.init_node("leg_markers")
    rostest.rosrun("people_fusion", "leg_markers", LegMarkers, sys.argv)
