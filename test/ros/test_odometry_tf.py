"""Odometry becomes the transform odom to base where nobody else publishes it."""

from __future__ import annotations

import math
from typing import Any

import pytest

pytest.importorskip("rospy", reason="ROS is not installed")
pytest.importorskip("people_fusion.msg", reason="the package's messages are not built")

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rospy import Time
from tf2_msgs.msg import TFMessage

from people_fusion.core.errors import DataError
from people_fusion.ros.odometry_tf_node import OdometryTransforms


@pytest.fixture
def odometry() -> Any:
    message = Odometry(child_frame_id="base_link")
    message.header.stamp, message.header.frame_id = Time(5, 7), "/odom"
    message.pose.pose.position.x, message.pose.pose.position.y = 1.0, -2.0
    message.pose.pose.orientation.z = message.pose.pose.orientation.w = math.sqrt(0.5)
    return message


def test_odometry_becomes_the_transform_of_its_pose(odometry: Any) -> None:
    transform = OdometryTransforms().convert(odometry)
    assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link")
    assert transform.header.stamp == Time(5, 7)
    assert (transform.transform.translation.x, transform.transform.translation.y) == (1.0, -2.0)
    assert transform.transform.rotation.z == pytest.approx(math.sqrt(0.5))


def test_nothing_is_added_where_tf_has_it(odometry: Any) -> None:
    transforms = OdometryTransforms()
    transforms.hear(TFMessage([TransformStamped(child_frame_id="laser")]))
    assert transforms.convert(odometry) is not None
    transforms.hear(TFMessage([TransformStamped(child_frame_id="/base_link")]))
    assert transforms.convert(odometry) is None


@pytest.mark.parametrize("spoil", ["child_frame_id", "stamp", "nan", "no rotation"])
def test_spoilt_odometry_is_refused(odometry: Any, spoil: str) -> None:
    if spoil == "child_frame_id":
        odometry.child_frame_id = ""
    elif spoil == "stamp":
        odometry.header.stamp = Time()
    elif spoil == "nan":
        odometry.pose.pose.position.x = math.nan
    else:
        odometry.pose.pose.orientation.z = odometry.pose.pose.orientation.w = 0.0
    with pytest.raises(DataError):
        OdometryTransforms().convert(odometry)
