#!/usr/bin/env python3
"""The head cue looks at the newest image, tells of all that it skips, and is heard by the composed node."""

from __future__ import annotations

import sys
import unittest
from typing import Any, List

import cv2
import numpy as np
import rospy
import rostest
from geometry_msgs.msg import TransformStamped
from graph import DiagnosticListener, wait_for_subscribers, wait_until
from sensor_msgs.msg import CompressedImage, Image, LaserScan
from tf2_msgs.msg import TFMessage

from people_fusion.core.stamps import to_seconds
from people_fusion.cues.heads.native import is_native
from people_fusion.msg import DetectedPersons, MeasurementAnnouncement
from people_fusion.ros.camera_cues import BUSY
from people_fusion.ros.conversions import stamp_from_msg
from people_fusion.ros.images import image_to_msg

RAW, COMPRESSED = "panorama/image_raw", "other/image_raw/compressed"
CUE, NODE = "panorama/image_raw/body", "head_cues"
SHAPE = (240, 1406, 3)
RATE_HZ, SECONDS = 40, 3.0


class HeadCue(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.diagnostics = DiagnosticListener()
        cls.pixels = np.random.default_rng(1).integers(0, 256, SHAPE).astype(np.uint8)
        cls.raw = rospy.Publisher(RAW, Image, queue_size=1)
        cls.compressed = rospy.Publisher(COMPRESSED, CompressedImage, queue_size=10)
        cls.transforms = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        cls.announced: List[Any] = []
        cls.detected: List[Any] = []
        cls.delays_s: List[float] = []
        rospy.Subscriber("people_fusion/announcements", MeasurementAnnouncement, cls.announced.append)
        rospy.Subscriber("people_fusion/detections", DetectedPersons, cls.on_detections)
        mounting = TransformStamped(child_frame_id="panorama")
        mounting.header.frame_id = "base"
        mounting.transform.translation.z, mounting.transform.rotation.w = 1.7, 1.0
        cls.transforms.publish(TFMessage([mounting]))
        for topic in (f"/{RAW}", f"/{COMPRESSED}"):
            wait_for_subscribers(topic, f"/{NODE}")
        wait_until(lambda: cls.raw.get_num_connections() and cls.compressed.get_num_connections(), "connections")

    @classmethod
    def on_detections(cls, message: Any) -> None:
        cls.detected.append(message)
        cls.delays_s.append(to_seconds(stamp_from_msg(rospy.Time.now()) - stamp_from_msg(message.header.stamp)))

    def image(self) -> Image:
        return image_to_msg(self.pixels, stamp_from_msg(rospy.Time.now()), "panorama")

    def test_images_that_come_too_fast_are_skipped_and_withdrawn(self) -> None:
        rate = rospy.Rate(RATE_HZ)
        for _ in range(int(RATE_HZ * SECONDS)):
            self.raw.publish(self.image())
            rate.sleep()
        wait_until(lambda: self.settled() and self.lost(BUSY) > 0, "all that was begun")
        announced = [each for each in self.announced if not each.withdrawn]
        withdrawn = [each for each in self.announced if each.withdrawn]
        self.assertGreater(len(announced), 2 * len(self.detected))  # it is that slow
        self.assertEqual(len(announced), len(self.detected) + len(withdrawn))
        self.assertLessEqual({each.cue for each in self.detected}, {CUE, "other/image_raw/body"})
        # Two images' work: the one that was begun when this one came, and its own.
        self.assertLess(np.median(self.delays_s), 3.0 * SECONDS / len(self.detected))
        wait_until(lambda: self.diagnostics.value("people_fusion", f"cue {CUE}"), "the composed node to hear the cue")

    def test_broken_images_are_counted_and_good_ones_go_on(self) -> None:
        short = self.image()
        short.data = short.data[:1000]
        unknown = self.image()
        unknown.encoding = "nonsense"
        header = self.image().header
        truncated = CompressedImage(header=header, format="jpeg", data=b"no image")
        for publisher, message, reason in (
            (self.raw, short, "image whose data does not fit its size"),
            (self.raw, unknown, "image of unknown encoding"),
            (self.compressed, truncated, "unreadable image"),
        ):
            message.header.stamp = rospy.Time.now()
            publisher.publish(message)
            wait_until(lambda reason=reason: self.lost(reason) == 1, reason)
        seen = len(self.detected)
        good = CompressedImage(format="jpeg", data=cv2.imencode(".jpg", self.pixels)[1].tobytes())
        good.header = self.image().header
        self.compressed.publish(good)
        wait_until(lambda: len(self.detected) > seen, "the good image")

    def test_what_was_done_can_be_looked_at(self) -> None:
        looks: List[Any] = []
        listener = rospy.Subscriber(f"people_fusion/debug/{CUE}", Image, looks.append)
        wait_until(lambda: listener.get_num_connections() > 0, "the debug image's publisher")
        self.raw.publish(self.image())
        wait_until(lambda: looks, "the debug image")
        self.assertEqual((looks[0].height, looks[0].width, looks[0].encoding), (*SHAPE[:2], "bgr8"))
        listener.unregister()

    def test_scans_that_tell_distances_are_taken_and_bad_ones_counted(self) -> None:
        scans = rospy.Publisher("scan_front", LaserScan, queue_size=10)
        wait_until(lambda: scans.get_num_connections() > 0, "the subscriber of scans")
        without_beams = LaserScan(angle_increment=0.01, range_max=30.0)
        without_beams.header = self.image().header
        good = LaserScan(header=without_beams.header, angle_increment=0.01, range_max=30.0, ranges=[2.0] * 300)
        seen = len(self.detected)
        for scan in (good, without_beams):
            scans.publish(scan)
        wait_until(lambda: self.lost("scan without beams") == 1, "the count")
        self.raw.publish(self.image())
        wait_until(lambda: len(self.detected) > seen, "the next image")

    def test_whether_the_native_kernel_is_there_is_told(self) -> None:
        wait_until(lambda: self.diagnostics.value(NODE, "native kernel") == str(is_native()), "the fact")

    def lost(self, reason: str) -> int:
        return self.diagnostics.count(NODE, f"lost: {reason}")

    def settled(self) -> bool:
        withdrawn = sum(each.withdrawn for each in self.announced)
        return len(self.announced) - withdrawn == len(self.detected) + withdrawn


if __name__ == "__main__":
    rospy.init_node("head_cue_test")
    rostest.rosrun("people_fusion", "head_cue", HeadCue, sys.argv)
