#!/usr/bin/env python3
"""Scans and detections that are broken in every way, between good ones."""

from __future__ import annotations

import copy
import math
import sys
import unittest
from typing import Any, Callable, Dict

import numpy as np
import rospy
import rostest
from diagnostic_msgs.msg import DiagnosticStatus
from graph import DiagnosticListener, TrackListener, wait_for_subscribers, wait_until
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from scans import BEAMS, PERIOD_S, good_scan
from sensor_msgs.msg import LaserScan

from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose
from people_fusion.msg import DetectedPerson, DetectedPersons
from people_fusion.ros.conversions import grid_to_msg


def with_ranges(value: float) -> LaserScan:
    scan = good_scan()
    scan.ranges = [value] * BEAMS
    return scan


def with_field(**fields: Any) -> LaserScan:
    scan = good_scan()
    for name, value in fields.items():
        setattr(scan, name, value)
    return scan


def reshaped() -> LaserScan:
    scan = good_scan()
    scan.ranges, scan.angle_increment = scan.ranges[::2], 2 * scan.angle_increment
    return scan


def without_stamp() -> LaserScan:
    scan = good_scan()
    scan.header.stamp = rospy.Time()
    return scan


HARMLESS: Dict[str, Callable[[], LaserScan]] = {
    "NaN": lambda: with_ranges(math.nan),
    "nothing within reach": lambda: with_ranges(math.inf),
    "too close": lambda: with_ranges(-math.inf),
    "zero": lambda: with_ranges(0.0),
    "negative": lambda: with_ranges(-1.0),
    "half the beams": reshaped,
}
BROKEN: Dict[str, Callable[[], LaserScan]] = {
    "scan without beams": lambda: with_field(ranges=[]),
    "scan without a stamp": without_stamp,
    "scan with impossible angles": lambda: with_field(angle_increment=math.nan),
    "scan with impossible reach": lambda: with_field(range_max=math.nan),
    "scan with impossible times": lambda: with_field(time_increment=-1.0),
}


def detections(variance: float, x: float = 2.0) -> DetectedPersons:
    message = DetectedPersons(cue="foreign", modality="head", period=0.1)
    message.header.stamp, message.header.frame_id = rospy.Time.now(), "laser"
    person = DetectedPerson(confidence=0.9, modality="head")
    person.pose.pose.position.x, person.pose.pose.orientation.w = x, 1.0
    person.pose.covariance = np.diag([variance, 0.01, 0.01, 1e6, 1e6, 1e6]).ravel().tolist()
    message.detections = [person]
    return message


class BadData(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.scans = rospy.Publisher("/scan", LaserScan, queue_size=10)
        cls.foreign = rospy.Publisher("/people_fusion/detections", DetectedPersons, queue_size=10)
        cls.listener, cls.diagnostics = TrackListener(), DiagnosticListener()
        wait_for_subscribers("/scan", "/leg_cue")
        wait_for_subscribers("/people_fusion/detections", "/people_tracker")
        wait_until(lambda: cls.scans.get_num_connections() and cls.foreign.get_num_connections(), "connections")

    def test_harmless_scans_pass_and_tracks_go_on(self) -> None:
        self.assert_tracked()
        for make in HARMLESS.values():
            self.scans.publish(make())
            rospy.sleep(PERIOD_S)
        self.assert_tracked()

    def test_broken_scans_are_counted_by_reason(self) -> None:
        self.assert_tracked()
        for make in BROKEN.values():
            self.scans.publish(make())
            rospy.sleep(PERIOD_S)
        for reason in BROKEN:
            self.assert_counted("leg_cue", reason)
        self.assert_tracked()

    def test_a_scan_that_is_stamped_a_year_off_does_not_reset_the_tracks(self) -> None:
        self.assert_tracked()
        identities = {person.track_id for person in self.listener.messages[-1].tracks}
        for years in (1, -1):
            scan = good_scan()
            scan.header.stamp += rospy.Duration.from_sec(years * 3.15e7)
            self.scans.publish(scan)
            rospy.sleep(PERIOD_S)
        self.assert_tracked()
        self.assertEqual(identities & {person.track_id for person in self.listener.messages[-1].tracks}, identities)
        rospy.sleep(1.2)  # for the next diagnostics
        self.assertEqual(self.diagnostics.count("leg_cue", "time jumps"), 0)
        self.assertEqual(self.diagnostics.count("people_tracker", "time jumps"), 0)

    def test_broken_detections_are_counted_by_reason(self) -> None:
        self.foreign.publish(detections(variance=-1.0))
        self.assert_counted("people_tracker", "detection's covariance has a negative variance")
        self.foreign.publish(detections(variance=0.01, x=math.nan))
        self.assert_counted("people_tracker", "detection is not finite")
        self.assert_tracked()

    def test_frame_that_never_appears_is_an_error_that_names_it(self) -> None:
        lost = copy.copy(detections(variance=0.01))
        lost.cue, lost.header.frame_id = "lost", "nowhere"

        def complained() -> bool:
            lost.header.stamp = rospy.Time.now()
            self.foreign.publish(lost)
            self.scans.publish(good_scan())
            is_error = self.diagnostics.level("people_tracker") == DiagnosticStatus.ERROR
            return is_error and "from nowhere to laser" in self.diagnostics.message("people_tracker")

        wait_until(complained, "an error that names the frame")
        self.assert_tracked()

    def test_map_in_a_frame_that_never_appears_is_laid_aside(self) -> None:
        cells = np.zeros((100, 100), dtype=np.int8)
        grid = OccupancyGrid("hall", 0.05, Pose.identity(), cells)
        publisher = rospy.Publisher("/map", OccupancyGridMsg, queue_size=1, latch=True)
        publisher.publish(grid_to_msg(grid))

        def said() -> bool:
            self.scans.publish(good_scan())
            rospy.sleep(PERIOD_S)
            return "from laser to hall" in self.diagnostics.message("leg_cue")

        wait_until(said, "a complaint that names the frame")
        self.assert_tracked()
        wait_until(lambda: self.diagnostics.value("leg_cue", "map in use") == "False", "the diagnostics' say", 2.0)

    def assert_counted(self, node: str, reason: str) -> None:
        wait_until(lambda: self.diagnostics.count(node, f"lost: {reason}") > 0, f"{node} to count: {reason}")

    def assert_tracked(self) -> None:
        """Good scans still give a track at the person's place."""
        before = len(self.listener.messages)

        def tracked() -> bool:
            self.scans.publish(good_scan())
            rospy.sleep(PERIOD_S)
            people = [person for message in self.listener.messages[before:] for person in message.tracks]
            places = [person.pose.pose.position for person in people]
            return any(math.hypot(place.x - 2.0, place.y) < 0.3 for place in places)

        wait_until(tracked, "a track of the person in good scans")


if __name__ == "__main__":
    rospy.init_node("bad_data")
    rostest.rosrun("people_fusion", "bad_data", BadData, sys.argv)
