"""Messages of cameras and depth cameras, and what the nodes keep of them."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("people_fusion.msg", reason="the messages are not built; tools/test builds them")

from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.depth_images import OTHER_PIXELS, DepthImage
from people_fusion.core.errors import DataError
from people_fusion.core.pixels import depths_of, pixels_of
from people_fusion.ros.clouds import cloud_from_msg, cloud_to_msg
from people_fusion.ros.images import camera_from_msg, same_camera
from people_fusion.ros.rgbd_cue_node import RgbdCues

RNG = np.random.default_rng(5)
MILLIMETRES = RNG.integers(500, 6000, (12, 16)).astype(np.uint16)


def info(**changes: Any) -> CameraInfo:
    message = CameraInfo(width=640, height=480, distortion_model="plumb_bob", D=[0.0] * 5)
    message.K = [525.0, 0.0, 319.5, 0.0, 525.0, 239.5, 0.0, 0.0, 1.0]
    message.P = [525.0, 0.0, 319.5, 0.0, 0.0, 525.0, 239.5, 0.0, 0.0, 0.0, 1.0, 0.0]
    for name, value in changes.items():
        setattr(message, name, value)
    return message


def test_the_same_camera_is_known_again_whatever_its_header() -> None:
    later = info()
    later.header.seq, later.header.stamp.secs = 7, 8
    assert same_camera(info(), later)
    for change in ({"width": 320}, {"D": [0.1] * 5}, {"K": [500.0, *info().K[1:]]}, {"distortion_model": "fisheye"}):
        assert not same_camera(info(), info(**change))


@pytest.mark.parametrize("encoding", ["16UC1", "compressed"])
def test_depths_come_from_images_and_compressed_ones_alike(encoding: str) -> None:
    message: Any = Image(height=12, width=16, step=32, encoding="16UC1", data=MILLIMETRES.astype("<u2").tobytes())
    if encoding == "compressed":
        data = cv2.imencode(".png", MILLIMETRES)[1].tobytes()
        message = CompressedImage(format="16UC1; compressedDepth", data=bytes(12) + data)
    np.testing.assert_allclose(depths_of(message), MILLIMETRES / 1000.0, rtol=1e-6)


def test_a_coloured_cloud_is_what_rviz_reads() -> None:
    points = RNG.normal(size=(5, 3)).astype(np.float32)
    colours = RNG.integers(0, 256, (5, 3)).astype(np.uint8)
    message = cloud_to_msg(points, colours, 7_000_000_008, "kinect")
    assert (message.header.frame_id, message.header.stamp.secs, message.header.stamp.nsecs) == ("kinect", 7, 8)
    assert (message.height, message.width, len(message.data)) == (1, 5, message.row_step)
    offsets = {field.name: field.offset for field in message.fields}
    assert {(field.name, field.datatype, field.count) for field in message.fields} == {
        (name, PointField.FLOAT32, 1) for name in ("x", "y", "z", "rgb")
    }
    for row in range(5):
        cell = message.data[row * message.point_step :][: message.point_step]
        xyz = [np.frombuffer(cell, "<f4", 1, offsets[axis])[0] for axis in "xyz"]
        np.testing.assert_array_equal(xyz, points[row])
        packed = int(np.frombuffer(cell, "<u4", 1, offsets["rgb"])[0])  # 0x00RRGGBB, by PCL's convention
        assert [packed & 255, packed >> 8 & 255, packed >> 16] == colours[row].tolist()


def test_an_empty_cloud_is_one() -> None:
    message = cloud_to_msg(np.zeros((0, 3)), np.zeros((0, 3), np.uint8), 1, "kinect")
    assert (message.width, message.data) == (0, b"")


def test_an_organised_cloud_comes_with_its_colour() -> None:
    points = RNG.uniform(0.5, 3.0, (4, 6, 3)).astype(np.float32)
    colours = RNG.integers(0, 256, (4, 6, 3)).astype(np.uint8)
    message = cloud_to_msg(points.reshape(-1, 3), colours.reshape(-1, 3), 1, "kinect")
    message.height, message.width, message.row_step = 4, 6, 6 * message.point_step
    cloud = cloud_from_msg(message)
    np.testing.assert_array_equal(cloud.depths, points[..., 2])
    np.testing.assert_array_equal(cloud.colour, colours)
    with pytest.raises(DataError, match="without x, y and z"):
        cloud_from_msg(PointCloud2(height=4, width=6, point_step=16, row_step=96, data=bytes(384)))


def test_the_camera_of_images_stays_the_same_object_until_something_changes() -> None:
    node: Any = SimpleNamespace(cameras={"depth": camera_from_msg(info(), False)}, _sizes={})
    whole, half = (RgbdCues._resized(node, "depth", *size) for size in ((480, 640), (240, 320)))
    assert (whole.width, half.width) == (640, 320)
    assert RgbdCues._resized(node, "depth", 240, 320) is half
    node.cameras["depth"] = camera_from_msg(info(K=[500.0, *info().K[1:]]), False)
    assert RgbdCues._resized(node, "depth", 240, 320) is not half
    with pytest.raises(DataError, match="another shape"):
        RgbdCues._resized(node, "depth", 100, 320)
    with pytest.raises(DataError, match="before its camera_info"):
        RgbdCues._resized(node, "unknown", 240, 320)


@pytest.mark.parametrize("shape", [(240, 320, 3), (480, 640, 3), (240, 320)])
def test_colour_is_brought_to_the_size_of_the_depths(shape: Any) -> None:
    fitted = depth_image().coloured(np.full(shape, 90, dtype=np.uint8), "kinect").colour
    assert fitted.shape == (240, 320, 3) and (fitted == 90).all()


@pytest.mark.parametrize("shape, frame_id", [((200, 320, 3), "kinect"), ((240, 320, 3), "rgb")])
def test_colour_of_other_pixels_is_refused(shape: Any, frame_id: str) -> None:
    with pytest.raises(DataError, match=OTHER_PIXELS):
        depth_image().coloured(np.zeros(shape, dtype=np.uint8), frame_id)


def depth_image() -> DepthImage:
    depths = np.ones((240, 320), dtype=np.float32)
    return DepthImage(1, "kinect", depths, Pinhole(320, 240, np.array([[260.0, 0, 160], [0, 260, 120], [0, 0, 1]])))


def test_pixels_come_from_raw_and_compressed_images() -> None:
    pixels = RNG.integers(0, 256, (12, 16, 3)).astype(np.uint8)
    raw = Image(height=12, width=16, step=48, encoding="bgr8", data=pixels.tobytes())
    png = CompressedImage(format="png", data=cv2.imencode(".png", pixels)[1].tobytes())
    for message in (raw, png):
        np.testing.assert_array_equal(pixels_of(message), pixels)
