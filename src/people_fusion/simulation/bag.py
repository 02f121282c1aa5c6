"""A simulated run as a ROS 1 bag, as the robot's drivers would have recorded it."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Callable, Dict, Iterable, Optional, Tuple, Union

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import get_types_from_msg
from rosbags.typesys.store import Typestore

from people_fusion.core.errors import RecordingError
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Measurement
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import from_seconds, split
from people_fusion.replay.track_bag import detection_fields
from people_fusion.replay.typestore import typestore
from people_fusion.simulation.camera import Calibration, HeadBoxes, Picture
from people_fusion.simulation.depth_camera import DepthPicture
from people_fusion.simulation.detector import Told
from people_fusion.simulation.simulator import (
    FOOTPRINT,
    MAP,
    ODOM,
    Annotation,
    Event,
    FrameTransform,
    LocalisationFix,
    OdometryReading,
)

UNOBSERVED_VARIANCE = 1e6
TRANSFORMS = "tf2_msgs/msg/TFMessage"  # which rosbags lacks for ROS 1
TRANSFORMS_DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
LATCHED = ("/map", "/tf_static")
PNG_HEADER = np.zeros(12, dtype=np.uint8)  # compressed_depth_image_transport's, which says nothing of 16UC1
HEAD_CHANNELS = ("id", "left", "top", "right", "bottom", "visibility", "yaw")


def write_bag(
    path: Union[str, Path], events: Iterable[Event], progress: Optional[Callable[[int], None]] = None
) -> None:
    """Write what `simulate` yields; a bag that is there already is replaced once the new one is whole.

    Args:
        progress: called with the arrival of each message in nanoseconds.

    Raises:
        RecordingError: the bag cannot be written; the message names it.
    """
    path = Path(path)
    unfinished = path.with_name(path.name + ".unfinished")
    store = typestore()
    store.register(get_types_from_msg(TRANSFORMS_DEFINITION, TRANSFORMS))
    messages = _Messages(store)
    connections: Dict[str, Any] = {}
    try:
        unfinished.unlink(missing_ok=True)
        with Writer(unfinished) as writer:
            for topic, arrival_ns, item in events:
                kind, message = messages.of(topic, item)
                if topic not in connections:
                    latching = 1 if topic in LATCHED else None
                    connections[topic] = writer.add_connection(
                        topic, kind, typestore=store, callerid="/simulate", latching=latching
                    )
                writer.write(connections[topic], arrival_ns, store.serialize_ros1(message, kind))
                if progress is not None:
                    progress(arrival_ns)
        unfinished.replace(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    finally:
        unfinished.unlink(missing_ok=True)


class _Messages:
    """Core types as ROS messages."""

    def __init__(self, store: Typestore) -> None:
        self._types = store.types
        self._counts: Dict[str, int] = {}

    def of(self, topic: str, item: Any) -> Tuple[str, Any]:
        """Type and message of an event's object."""
        sequence = self._counts.get(topic, 0)
        self._counts[topic] = sequence + 1
        if isinstance(item, Scan):
            return self._scan(item, sequence)
        if isinstance(item, (FrameTransform, tuple)):
            return self._transforms((item,) if isinstance(item, FrameTransform) else item, sequence)
        if isinstance(item, OdometryReading):
            return self._odometry(item, sequence)
        if isinstance(item, LocalisationFix):
            return self._fix(item, sequence)
        if isinstance(item, Annotation):
            return self._annotation(item, sequence)
        if isinstance(item, OccupancyGrid):
            return self._map(item, sequence)
        if isinstance(item, Measurement):
            return self._detections(item, sequence)
        if isinstance(item, Told):
            return self._announcement(item, sequence)
        if isinstance(item, Picture):
            return self._picture(item, sequence)
        if isinstance(item, DepthPicture):
            return self._depth_picture(item, sequence)
        if isinstance(item, Calibration):
            return self._camera_info(item, sequence)
        if isinstance(item, HeadBoxes):
            return self._heads(item, sequence)
        raise TypeError(f"no message for {type(item).__name__}")

    def _make(self, kind: str, *fields: Any) -> Any:
        return self._types[kind](*fields)

    def _time(self, stamp_ns: int) -> Any:
        return self._make("builtin_interfaces/msg/Time", *split(stamp_ns))

    def _header(self, sequence: int, stamp_ns: int, frame_id: str) -> Any:
        return self._make("std_msgs/msg/Header", sequence, self._time(stamp_ns), frame_id)

    def _vector(self, x: float, y: float, z: float) -> Any:
        return self._make("geometry_msgs/msg/Vector3", float(x), float(y), float(z))

    def _quaternion(self, x: float, y: float, z: float, w: float) -> Any:
        return self._make("geometry_msgs/msg/Quaternion", float(x), float(y), float(z), float(w))

    def _pose(self, pose: Pose) -> Any:
        point = self._make("geometry_msgs/msg/Point", *map(float, pose.translation))
        return self._make("geometry_msgs/msg/Pose", point, self._quaternion(*pose.quaternion))

    def _pose_with_covariance(self, pose: Pose, covariance: np.ndarray) -> Any:
        return self._make(
            "geometry_msgs/msg/PoseWithCovariance", self._pose(pose), np.asarray(covariance, float).ravel()
        )

    def _twist_with_covariance(self, linear: Tuple[float, float], turn_rate: float, variances: Iterable[float]) -> Any:
        twist = self._make("geometry_msgs/msg/Twist", self._vector(*linear, 0.0), self._vector(0.0, 0.0, turn_rate))
        return self._make(
            "geometry_msgs/msg/TwistWithCovariance", twist, np.diag(list(variances)).astype(float).ravel()
        )

    def _scan(self, scan: Scan, sequence: int) -> Tuple[str, Any]:
        kind = "sensor_msgs/msg/LaserScan"
        return kind, self._make(
            kind,
            self._header(sequence, scan.stamp_ns, scan.frame_id),
            scan.angle_min,
            float(scan.angles[-1]),
            scan.angle_increment,
            scan.time_increment,
            scan.scan_time,
            scan.range_min,
            scan.range_max,
            scan.ranges.astype(np.float32),
            np.zeros(0, np.float32),
        )

    def _transforms(self, links: Tuple[FrameTransform, ...], sequence: int) -> Tuple[str, Any]:
        stamped = []
        for link in links:
            transform = self._make(
                "geometry_msgs/msg/Transform",
                self._vector(*link.pose.translation),
                self._quaternion(*link.pose.quaternion),
            )
            header = self._header(sequence, link.stamp_ns, link.parent)
            stamped.append(self._make("geometry_msgs/msg/TransformStamped", header, link.child, transform))
        return TRANSFORMS, self._make(TRANSFORMS, stamped)

    def _odometry(self, reading: OdometryReading, sequence: int) -> Tuple[str, Any]:
        kind = "nav_msgs/msg/Odometry"
        unknown = np.zeros((6, 6))  # as the robot's driver has it
        twist = self._twist_with_covariance((reading.speed, 0.0), reading.turn_rate, np.zeros(6))
        header = self._header(sequence, reading.stamp_ns, ODOM)
        return kind, self._make(kind, header, FOOTPRINT, self._pose_with_covariance(reading.pose, unknown), twist)

    def _fix(self, fix: LocalisationFix, sequence: int) -> Tuple[str, Any]:
        kind = "geometry_msgs/msg/PoseWithCovarianceStamped"
        pose = self._pose_with_covariance(fix.pose.mean, fix.pose.covariance)
        return kind, self._make(kind, self._header(sequence, fix.stamp_ns, MAP), pose)

    def _annotation(self, annotation: Annotation, sequence: int) -> Tuple[str, Any]:
        kind = "people_fusion/msg/TrackedPersons"
        age = self._make("builtin_interfaces/msg/Duration", *split(from_seconds(annotation.age_s)))
        pose_variances = [annotation.variance, annotation.variance, 0.0, UNOBSERVED_VARIANCE, UNOBSERVED_VARIANCE, 0.0]
        twist_variances = [0.0] * 3 + [UNOBSERVED_VARIANCE] * 3
        people = []
        for row, identity in enumerate(annotation.ids):
            x, y, z = map(float, annotation.positions[row])
            pose = Pose.from_xy_yaw(x, y, float(annotation.headings[row]), z)
            people.append(
                self._make(
                    "people_fusion/msg/TrackedPerson",
                    int(identity),
                    bool(annotation.occluded[row]),
                    False,
                    0,
                    age,
                    1.0,
                    self._pose_with_covariance(pose, np.diag(pose_variances)),
                    self._twist_with_covariance(tuple(annotation.velocities[row]), 0.0, twist_variances),
                )
            )
        return kind, self._make(kind, self._header(sequence, annotation.stamp_ns, MAP), people)

    def _detections(self, measurement: Measurement, sequence: int) -> Tuple[str, Any]:
        kind = "people_fusion/msg/DetectedPersons"
        header = self._header(sequence, measurement.stamp_ns, measurement.frame_id)
        return kind, self._types[kind](header=header, **detection_fields(measurement, self._make))

    def _announcement(self, told: Told, sequence: int) -> Tuple[str, Any]:
        kind = "people_fusion/msg/MeasurementAnnouncement"
        told_of = told.announcement
        header = self._header(sequence, told_of.stamp_ns, told.frame_id)
        return kind, self._make(kind, header, told_of.cue, told_of.sequence, told_of.withdrawn)

    def _picture(self, picture: Picture, sequence: int) -> Tuple[str, Any]:
        config, pixels = picture.config, picture.pixels
        header = self._header(sequence, picture.stamp_ns, config.frame)
        if config.encoding == "jpeg":
            import cv2  # 100 MB: not for those who simulate no images

            data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, config.quality])[1].ravel()
            kind = "sensor_msgs/msg/CompressedImage"
            return kind, self._make(kind, header, "bgr8; jpeg compressed bgr8", data)
        kind = "sensor_msgs/msg/Image"
        height, width = pixels.shape[:2]
        step = pixels.nbytes // height
        return kind, self._make(kind, header, height, width, config.encoding, 0, step, pixels.ravel())

    def _depth_picture(self, picture: DepthPicture, sequence: int) -> Tuple[str, Any]:
        header = self._header(sequence, picture.stamp_ns, picture.config.frame)
        encoding, pixels = picture.config.encoding, picture.depths
        if encoding != "32FC1":
            pixels = np.nan_to_num(np.round(1000.0 * pixels)).astype(np.uint16)
        if encoding == "compressedDepth":
            import cv2  # 100 MB: not for those who simulate no images

            data = cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].ravel()
            kind = "sensor_msgs/msg/CompressedImage"
            return kind, self._make(kind, header, "16UC1; compressedDepth", np.concatenate([PNG_HEADER, data]))
        kind = "sensor_msgs/msg/Image"
        height, width = pixels.shape
        step = pixels.nbytes // height
        return kind, self._make(kind, header, height, width, encoding, 0, step, pixels.ravel().view(np.uint8))

    def _camera_info(self, calibration: Calibration, sequence: int) -> Tuple[str, Any]:
        kind = "sensor_msgs/msg/CameraInfo"
        config = calibration.config
        pinhole = config.pinhole
        D = np.array(pinhole.distortion if len(pinhole.distortion) else np.zeros(5), dtype=float)
        P = np.column_stack([pinhole.matrix, np.zeros(3)])
        return kind, self._make(
            kind,
            self._header(sequence, calibration.stamp_ns, config.frame),
            pinhole.height,
            pinhole.width,
            "rational_polynomial" if len(D) > 5 else "plumb_bob",
            D,
            pinhole.matrix.ravel(),
            np.eye(3).ravel(),
            P.ravel(),
            0,
            0,
            self._make("sensor_msgs/msg/RegionOfInterest", 0, 0, 0, 0, False),
        )

    def _heads(self, heads: HeadBoxes, sequence: int) -> Tuple[str, Any]:
        """A cloud of the heads' middles, with what else is known of each as its channels."""
        kind = "sensor_msgs/msg/PointCloud"
        points = [self._make("geometry_msgs/msg/Point32", *map(float, place)) for place in heads.positions]
        columns = [heads.ids, *heads.corners.T, heads.visibility, heads.yaws]
        channels = [
            self._make("sensor_msgs/msg/ChannelFloat32", name, np.asarray(column, dtype=np.float32))
            for name, column in zip(HEAD_CHANNELS, columns)
        ]
        return kind, self._make(kind, self._header(sequence, heads.stamp_ns, heads.frame_id), points, channels)

    def _map(self, grid: OccupancyGrid, sequence: int) -> Tuple[str, Any]:
        kind = "nav_msgs/msg/OccupancyGrid"
        height, width = grid.occupancy.shape
        stamp_ns = grid.stamp_ns
        meta = self._make(
            "nav_msgs/msg/MapMetaData", self._time(stamp_ns), grid.resolution, width, height, self._pose(grid.origin)
        )
        return kind, self._make(kind, self._header(sequence, stamp_ns, grid.frame_id), meta, grid.occupancy.ravel())
