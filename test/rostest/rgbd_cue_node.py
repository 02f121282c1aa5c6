#!/usr/bin/env python3
"""The RGB-D cue tells of people in depth images and clouds, queues none of them, and survives what is no image."""

from __future__ import annotations

import sys
import unittest
from typing import Any, List, Optional, Sequence, Tuple

import cv2
import numpy as np
import rospy
import rostest
from camera_scenes import Ideal
from depth_scenes import Person, depths_of, pose_of
from geometry_msgs.msg import TransformStamped
from graph import DiagnosticListener, wait_for_subscribers, wait_until
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField
from tf2_msgs.msg import TFMessage

from people_fusion.core.depth_images import OTHER_PIXELS
from people_fusion.core.measurements import Measurement
from people_fusion.core.stamps import to_seconds
from people_fusion.msg import DetectedPersons, MeasurementAnnouncement
from people_fusion.ros.camera_cues import BUSY, UNCALIBRATED, UNSTAMPED
from people_fusion.ros.conversions import measurement_from_msg, pose_to_msg, stamp_from_msg
from people_fusion.ros.images import image_to_msg
from people_fusion.ros.rgbd_cue_node import NO_COLOUR, WRONG_FLOOR

NODE, FRAME = "rgbd_cues", "kinect_optical"
DEPTHS, INFO, COLOUR = (
    "kinect/depth_registered/image_raw",
    "kinect/depth_registered/camera_info",
    "kinect/rgb/image_raw",
)
OTHER, OTHER_INFO, CLOUD = "other/depth/image_raw/compressedDepth", "other/depth/camera_info", "kinect/points"
CUE = f"{DEPTHS}/people"
CAMERA = Ideal(320, 240, 262.5)
POSE = pose_of(1.5, 5.0)
STANDS, SITS = Person(2.8, 0.6, 1.8), Person(2.4, -0.5, 1.28, sits=True)
FAR_OFF = 0.1  # metres that a head may be off
RATE_HZ, SECONDS = 40, 3.0


def depth_message(depths: np.ndarray, encoding: str = "16UC1") -> Image:
    message = Image(encoding=encoding, height=depths.shape[0], width=depths.shape[1])
    message.header.stamp, message.header.frame_id = rospy.Time.now(), FRAME
    pixels = np.nan_to_num(1000.0 * depths).astype("<u2") if encoding == "16UC1" else depths.astype("<f4")
    message.step, message.data = pixels.itemsize * depths.shape[1], pixels.tobytes()
    return message


def info_message(camera: Ideal) -> CameraInfo:
    message = CameraInfo(width=camera.width, height=camera.height, distortion_model="plumb_bob", D=[0.0] * 5)
    message.header.frame_id = FRAME
    u, v = camera.middle.tolist()
    message.K = [camera.focal, 0.0, u, 0.0, camera.focal, v, 0.0, 0.0, 1.0]
    message.P = [camera.focal, 0.0, u, 0.0, 0.0, camera.focal, v, 0.0, 0.0, 0.0, 1.0, 0.0]
    return message


def cloud_message(depths: np.ndarray, camera: Ideal) -> PointCloud2:
    rows, columns = np.indices(depths.shape)
    rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    points = ((rays / rays[:, 2:]) * depths.reshape(-1, 1)).astype("<f4")
    message = PointCloud2(height=depths.shape[0], width=depths.shape[1], point_step=12, row_step=12 * depths.shape[1])
    message.header.stamp, message.header.frame_id = rospy.Time.now(), FRAME
    message.fields = [PointField(axis, 4 * n, PointField.FLOAT32, 1) for n, axis in enumerate("xyz")]
    message.data = points.tobytes()
    return message


class RgbdCue(unittest.TestCase):
    @classmethod
    def setUpClass(cls) -> None:
        cls.diagnostics = DiagnosticListener()
        cls.scene = depths_of(POSE, [STANDS, SITS], camera=CAMERA)
        cls.announced: List[Any] = []
        cls.detected: List[Any] = []
        cls.delays_s: List[float] = []
        rospy.Subscriber("people_fusion/announcements", MeasurementAnnouncement, cls.announced.append)
        rospy.Subscriber("people_fusion/detections", DetectedPersons, cls.on_detections)
        kinds = {DEPTHS: Image, COLOUR: Image, OTHER: CompressedImage, CLOUD: PointCloud2}
        cls.publishers = {name: rospy.Publisher(name, kind, queue_size=5) for name, kind in kinds.items()}
        cls.infos = {name: rospy.Publisher(name, CameraInfo, queue_size=5, latch=True) for name in (INFO, OTHER_INFO)}
        cls.transforms = rospy.Publisher("/tf_static", TFMessage, queue_size=1, latch=True)
        mounting = TransformStamped(child_frame_id=FRAME)
        mounting.header.frame_id = "base"
        pose = pose_to_msg(POSE)
        mounting.transform.rotation = pose.orientation
        for axis in "xyz":
            setattr(mounting.transform.translation, axis, getattr(pose.position, axis))
        cls.transforms.publish(TFMessage([mounting]))
        wait_for_subscribers("/tf_static", f"/{NODE}")
        wait_until(lambda: all(each.get_num_connections() for each in cls.publishers.values()), "connections")
        wait_until(lambda: all(each.get_num_connections() for each in cls.infos.values()), "connections")
        cls.tell_camera(CAMERA)

    @classmethod
    def on_detections(cls, message: Any) -> None:
        cls.detected.append(message)
        cls.delays_s.append(to_seconds(stamp_from_msg(rospy.Time.now()) - stamp_from_msg(message.header.stamp)))

    @classmethod
    def tell_camera(cls, camera: Ideal) -> None:
        cls.infos[INFO].publish(info_message(camera))
        rospy.sleep(0.3)

    def looked_at(self, topic: str, message: Any) -> Measurement:
        """What the cue says of a message."""
        self.publishers[topic].publish(message)
        stamp = message.header.stamp
        wait_until(lambda: any(each.header.stamp == stamp for each in self.detected), f"the image on {topic}")
        return measurement_from_msg(next(each for each in self.detected if each.header.stamp == stamp))

    def assert_lost(self, topic: str, message: Any, reason: str) -> None:
        before = self.lost(reason)
        self.publishers[topic].publish(message)
        wait_until(lambda: self.lost(reason) == before + 1, reason)

    def assert_both_are_told(self, told: Measurement, topic: str) -> None:
        self.assertEqual((told.cue, told.modality, told.frame_id), (f"{topic}/people", "rgbd", FRAME))
        self.assertEqual(len(told), 2)
        places = POSE.apply(told.positions)
        for person in (STANDS, SITS):
            offsets = np.linalg.norm(places - person.head, axis=1)
            row = int(offsets.argmin())
            self.assertLess(offsets[row], FAR_OFF)
            self.assertAlmostEqual(told.bodies.heights[row], person.height, delta=FAR_OFF)
            self.assertGreater(told.bodies.height_stds[row], 0.0)
            self.assertEqual(told.bodies.sitting[row] > 0.5, person.sits)

    def test_people_are_told_with_their_heights_and_postures(self) -> None:
        for encoding in ("16UC1", "32FC1"):
            self.assert_both_are_told(self.looked_at(DEPTHS, depth_message(self.scene, encoding)), DEPTHS)
        wait_until(lambda: self.diagnostics.value("people_fusion", f"cue {CUE}"), "the composed node to hear the cue")

    def test_a_compressed_image_says_the_same_once_its_camera_is_known(self) -> None:
        png = cv2.imencode(".png", np.nan_to_num(1000.0 * self.scene).astype(np.uint16))[1].tobytes()

        def message(data: bytes) -> CompressedImage:
            return CompressedImage(
                header=depth_message(self.scene).header, format="16UC1; compressedDepth", data=bytes(12) + data
            )

        self.assert_lost(OTHER, message(png), UNCALIBRATED)
        self.infos[OTHER_INFO].publish(info_message(CAMERA))
        rospy.sleep(0.3)
        self.assert_lost(OTHER, message(png[: len(png) // 4]), "unreadable image")
        self.assert_both_are_told(self.looked_at(OTHER, message(png)), "other/depth/image_raw")

    def test_an_organised_cloud_says_the_same_without_a_camera_info(self) -> None:
        self.assert_lost(
            CLOUD,
            cloud_message(np.full_like(self.scene, np.nan), CAMERA),
            "point cloud of too few points to tell its camera",
        )
        self.assert_both_are_told(self.looked_at(CLOUD, cloud_message(self.scene, CAMERA)), CLOUD)
        flat = cloud_message(self.scene, CAMERA)
        flat.height, flat.width = 1, flat.height * flat.width
        self.assert_lost(CLOUD, flat, "point cloud that is not organised")
        self.assertEqual(len(self.looked_at(CLOUD, cloud_message(np.full_like(self.scene, np.nan), CAMERA))), 0)

    def test_an_image_without_a_return_shows_nobody_and_says_nothing_of_what_is_free(self) -> None:
        for encoding in ("16UC1", "32FC1"):
            told = self.looked_at(DEPTHS, depth_message(np.full_like(self.scene, np.nan), encoding))
            self.assertEqual(len(told), 0)
            self.assertTrue(told.sight is None or np.isnan(told.sight.ranges).all())

    def test_what_is_no_depth_image_is_counted_and_good_ones_go_on(self) -> None:
        empty = depth_message(np.zeros((0, 0), dtype=np.float32))
        short = depth_message(self.scene)
        short.data = short.data[:1000]
        colour = image_to_msg(np.zeros((240, 320, 3), np.uint8), stamp_from_msg(rospy.Time.now()), FRAME)
        nowhere = depth_message(self.scene)
        nowhere.header.frame_id = ""
        for message, reason in (
            (empty, "image whose data does not fit its size"),
            (short, "image whose data does not fit its size"),
            (colour, "image that holds no depths"),
            (nowhere, UNSTAMPED),
        ):
            message.header.stamp = rospy.Time.now()
            self.assert_lost(DEPTHS, message, reason)
        self.assert_both_are_told(self.looked_at(DEPTHS, depth_message(self.scene)), DEPTHS)

    def test_a_camera_may_change_its_resolution(self) -> None:
        halved = self.scene[::2, ::2]
        self.assertEqual(len(self.looked_at(DEPTHS, depth_message(halved))), 2)  # before its camera_info
        wide = Ideal(360, 200, 262.5)
        other = depths_of(POSE, [STANDS, SITS], camera=wide)
        self.assert_lost(DEPTHS, depth_message(other), "image of another shape than its camera's")
        self.tell_camera(wide)
        self.assert_both_are_told(self.looked_at(DEPTHS, depth_message(other)), DEPTHS)
        self.assert_lost(DEPTHS, depth_message(self.scene), "image of another shape than its camera's")
        self.tell_camera(CAMERA)
        self.assert_both_are_told(self.looked_at(DEPTHS, depth_message(self.scene)), DEPTHS)

    def test_colour_is_taken_where_it_fits_and_never_waited_for(self) -> None:
        pixels = np.random.default_rng(1).integers(0, 256, (240, 320, 3)).astype(np.uint8)
        announced = len(self.announced)
        for _ in range(20):  # colour alone
            self.publishers[COLOUR].publish(image_to_msg(pixels, stamp_from_msg(rospy.Time.now()), FRAME))
            rospy.sleep(0.01)
        self.assertEqual(len(self.announced), announced)
        rospy.sleep(0.2)
        alone = self.event(NO_COLOUR)
        self.assert_both_are_told(self.looked_at(DEPTHS, depth_message(self.scene)), DEPTHS)
        wait_until(lambda: self.event(NO_COLOUR) == alone + 1, NO_COLOUR)
        looks: List[Any] = []
        listener = self.listening(Image, "", looks)
        for size, frame, fits in (
            ((240, 320), FRAME, True),
            ((480, 640), FRAME, True),
            ((240, 320), "rgb", False),
            ((200, 320), FRAME, False),
        ):
            refused = self.lost(OTHER_PIXELS)
            depths = depth_message(self.scene)
            colour = image_to_msg(cv2.resize(pixels, size[::-1]), stamp_from_msg(depths.header.stamp), frame)
            self.publishers[COLOUR].publish(colour)
            rospy.sleep(0.2)
            looks.clear()
            self.assert_both_are_told(self.looked_at(DEPTHS, depths), DEPTHS)
            wait_until(lambda: looks, "the picture")
            shown = np.frombuffer(looks[0].data, dtype=np.uint8).reshape(240, 320, 3)
            self.assertEqual((shown[:, :, 0] != shown[:, :, 1])[:50].mean() > 0.9, fits)  # a wall, grey by depth
            if not fits:
                wait_until(lambda refused=refused: self.lost(OTHER_PIXELS) == refused + 1, OTHER_PIXELS)
        listener.unregister()

    def test_the_floor_is_told_and_a_wrong_one_is_complained_of(self) -> None:
        """The robot's transforms stay as they are while the camera moves."""
        cases: Sequence[Tuple[float, float, float, float]] = (
            (1.5, 5.0, 0.0, 0.0),
            (1.63, 5.0, 0.13, 0.0),
            (1.5, 9.0, 0.0, 4.0),
        )
        for height, down, lower, tilt in cases:
            before = self.event(f"{CUE}: {WRONG_FLOOR}")
            self.looked_at(DEPTHS, depth_message(depths_of(pose_of(height, down), [STANDS], camera=CAMERA)))
            wrong = lower > 0.0 or tilt > 0.0
            wait_until(lambda c=(lower, tilt): self.floor_is(*c), f"a floor {lower} m lower, tilted by {tilt} degrees")
            self.assertEqual(self.event(f"{CUE}: {WRONG_FLOOR}"), before + wrong)
            self.assertLess(float(self.fact("floor residual, m")), 0.03)
        unseen = int(self.fact("images without floor"))
        self.looked_at(DEPTHS, depth_message(np.full_like(self.scene, np.nan)))
        wait_until(lambda: int(self.fact("images without floor")) == unseen + 1, "an image without floor")
        self.assertEqual(self.fact("floor residual, m"), "nan")

    def test_images_that_come_too_fast_are_skipped_and_withdrawn(self) -> None:
        wait_until(self.settled, "all that was begun before")
        announced, detected, first = len(self.announced), len(self.detected), self.lost(BUSY)
        big = depth_message(np.repeat(np.repeat(self.scene, 4, axis=0), 4, axis=1))
        rate = rospy.Rate(RATE_HZ)
        for _ in range(int(RATE_HZ * SECONDS)):
            big.header.stamp = rospy.Time.now()
            self.publishers[DEPTHS].publish(big)
            rate.sleep()
        wait_until(lambda: self.settled() and self.lost(BUSY) > first, "all that was begun")
        told = [each for each in self.announced[announced:] if not each.withdrawn]
        withdrawn = [each for each in self.announced[announced:] if each.withdrawn]
        count = len(self.detected) - detected
        self.assertGreater(len(told), count)  # it is that slow
        self.assertEqual(len(told), count + len(withdrawn))
        # Two images' work: the one that was begun when this one came, and its own.
        self.assertLess(np.median(self.delays_s[detected:]), 3.0 * SECONDS / count)

    def test_what_was_done_can_be_looked_at(self) -> None:
        pictures: List[Any] = []
        clouds: List[Any] = []
        listeners = [self.listening(Image, "", pictures), self.listening(PointCloud2, "/points", clouds)]
        self.looked_at(DEPTHS, depth_message(self.scene))
        wait_until(lambda: pictures and clouds, "picture and cloud")
        self.assertEqual((pictures[0].height, pictures[0].width, pictures[0].encoding), (240, 320, "bgr8"))
        self.assertEqual([field.name for field in clouds[0].fields], ["x", "y", "z", "rgb"])
        self.assertEqual(clouds[0].header.frame_id, FRAME)
        cells = np.frombuffer(clouds[0].data, dtype=[("xyz", "<f4", 3), ("bgr", "u1", 3), ("unused", "u1")])
        self.assertEqual(len(cells), np.isfinite(self.scene[::2, ::2]).sum())
        self.assertGreaterEqual(len(np.unique(cells["bgr"], axis=0)), 4)  # floor, two people, the rest
        for listener in listeners:
            listener.unregister()

    def listening(self, kind: Any, what: str, heard: List[Any], cue: Optional[str] = None) -> Any:
        listener = rospy.Subscriber(f"people_fusion/debug/{cue or CUE}{what}", kind, heard.append)
        wait_until(lambda: listener.get_num_connections() > 0, "its publisher")
        rospy.sleep(0.2)  # it knows of us, too
        return listener

    def floor_is(self, lower: float, tilt: float) -> bool:
        """As the cue corrected it."""
        corrected, tilted = (self.fact(f"floor {what}") for what in ("corrected by, m", "tilted by, degrees"))
        return bool(corrected) and abs(float(corrected) + lower) < 0.05 and abs(float(tilted) - tilt) < 1.0

    def fact(self, name: str) -> str:
        return self.diagnostics.value(NODE, f"{CUE}: {name}")

    def event(self, name: str) -> int:
        return self.diagnostics.count(NODE, name)

    def lost(self, reason: str) -> int:
        return self.diagnostics.count(NODE, f"lost: {reason}")

    def settled(self) -> bool:
        withdrawn = sum(each.withdrawn for each in self.announced)
        return len(self.announced) - withdrawn == len(self.detected) + withdrawn


if __name__ == "__main__":
    rospy.init_node("rgbd_cue_test")
    rostest.rosrun("people_fusion", "rgbd_cue", RgbdCue, sys.argv)
