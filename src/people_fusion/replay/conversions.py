"""Recorded messages as core types. The messages are rosbags' objects, with the fields of their ROS definitions."""

from __future__ import annotations

from typing import Any, Iterator, NamedTuple, Tuple

import numpy as np

from people_fusion.core.camera_info import camera_of
from people_fusion.core.cameras import Camera
from people_fusion.core.depth_images import DepthImage
from people_fusion.core.errors import DataError
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.images import Image
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.pixels import depths_of, pixels_of
from people_fusion.core.poses import Pose, UncertainPose
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import join
from people_fusion.core.transforms import normalise_frame
from people_fusion.core.wire import measurement_of


class Link(NamedTuple):
    """parent_from_child of one tf message, as numbers; `position` metres, `quaternion` x y z w."""

    parent: str
    child: str
    stamp_ns: int
    position: Tuple[float, float, float]
    quaternion: Tuple[float, float, float, float]

    def pose(self) -> Pose:
        """The transform.

        Raises:
            DataError: a value is not finite or the quaternion is zero.
        """
        return Pose.from_quaternion(np.array(self.position), np.array(self.quaternion))


def stamp(header: Any) -> int:
    """Stamp of a std_msgs/Header."""
    return join(header.stamp.sec, header.stamp.nanosec)


def scan(message: Any) -> Scan:
    """Scan of a sensor_msgs/LaserScan.

    Raises:
        DataError: it has no stamp.
    """
    stamp_ns = stamp(message.header)
    if stamp_ns == 0:
        raise DataError("scan without stamp")
    return Scan(
        stamp_ns=stamp_ns,
        frame_id=normalise_frame(message.header.frame_id),
        ranges=message.ranges.astype(np.float64),
        angle_min=message.angle_min,
        angle_increment=message.angle_increment,
        range_min=message.range_min,
        range_max=message.range_max,
        time_increment=message.time_increment,
        scan_time=message.scan_time,
    )


def camera(message: Any, rectified: bool) -> Camera:
    """Camera of a sensor_msgs/CameraInfo, see camera_of.

    Raises:
        DataError: it describes no camera.
    """
    matrices = message.D, message.K, message.R, message.P
    return camera_of(message.width, message.height, message.distortion_model, *matrices, rectified)


def image(message: Any, model: Camera) -> Image:
    """Image of a sensor_msgs/Image or CompressedImage.

    Raises:
        DataError: it has no stamp, cannot be read, or is not of the camera's size.
    """
    stamp_ns = _stamp_of_image(message)
    shown = pixels_of(message)
    height, width = shown.shape[:2]
    return Image(stamp_ns, normalise_frame(message.header.frame_id), shown, model.resized(width, height))


def depth_image(message: Any, model: Camera) -> DepthImage:
    """Depth image of a sensor_msgs/Image or CompressedImage.

    Raises:
        DataError: it has no stamp, cannot be read, or is not of the camera's size.
    """
    stamp_ns = _stamp_of_image(message)
    depths = depths_of(message)
    height, width = depths.shape
    return DepthImage(stamp_ns, normalise_frame(message.header.frame_id), depths, model.resized(width, height))


def _stamp_of_image(message: Any) -> int:
    stamp_ns = stamp(message.header)
    if stamp_ns == 0:
        raise DataError("image without stamp")
    return stamp_ns


def links(message: Any) -> Iterator[Link]:
    """Links of a tf2_msgs/TFMessage or a tf/tfMessage."""
    for transform in message.transforms:
        header, position, turn = transform.header, transform.transform.translation, transform.transform.rotation
        yield Link(
            normalise_frame(header.frame_id),
            normalise_frame(transform.child_frame_id),
            join(header.stamp.sec, header.stamp.nanosec),
            (position.x, position.y, position.z),
            (turn.x, turn.y, turn.z, turn.w),
        )


def odometry_link(message: Any) -> Link:
    """The link odom to base of a nav_msgs/Odometry; a frame that it does not name is empty."""
    position, turn = message.pose.pose.position, message.pose.pose.orientation
    return Link(
        normalise_frame(message.header.frame_id),
        normalise_frame(message.child_frame_id),
        stamp(message.header),
        (position.x, position.y, position.z),
        (turn.x, turn.y, turn.z, turn.w),
    )


def pose(message: Any) -> Pose:
    """Pose of a geometry_msgs/Pose.

    Raises:
        DataError: a value is not finite or the quaternion is zero.
    """
    position, turn = message.position, message.orientation
    return Pose.from_quaternion(
        np.array([position.x, position.y, position.z]), np.array([turn.x, turn.y, turn.z, turn.w])
    )


def uncertain_pose(message: Any) -> UncertainPose:
    """Pose with covariance of a geometry_msgs/PoseWithCovariance.

    Raises:
        DataError: a value is not finite, the quaternion is zero or a variance is negative.
    """
    covariance = np.array(message.covariance, dtype=np.float64).reshape(6, 6)
    if not np.isfinite(covariance).all() or (np.diag(covariance) < 0).any():
        raise DataError("pose with an impossible covariance")
    return UncertainPose(pose(message.pose), (covariance + covariance.T) / 2)


def occupancy_grid(message: Any) -> OccupancyGrid:
    """Map of a nav_msgs/OccupancyGrid.

    Raises:
        DataError: its size is not that of its data, or its place or resolution is impossible.
    """
    info = message.info
    return OccupancyGrid.from_cells(
        normalise_frame(message.header.frame_id),
        info.resolution,
        pose(info.origin),
        info.width,
        info.height,
        message.data,
        stamp(message.header),
    )


def announcement(message: Any) -> Announcement:
    """Announcement of a people_fusion/MeasurementAnnouncement.

    Raises:
        DataError: it has no stamp or names no cue.
    """
    stamp_ns = stamp(message.header)
    if stamp_ns == 0 or not message.cue:
        raise DataError("announcement without stamp or without a cue's name")
    return Announcement(stamp_ns, message.cue, int(message.sequence), bool(message.withdrawn))


def measurement(message: Any) -> Measurement:
    """Measurement of a people_fusion/DetectedPersons, in the sensor's frame.

    Raises:
        DataError: names the first thing that is wrong.
    """
    stamp_ns = stamp(message.header)
    if stamp_ns == 0:
        raise DataError("detections without a stamp")
    return measurement_of(message, stamp_ns, normalise_frame(message.header.frame_id))
