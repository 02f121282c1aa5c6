"""Messages to core types and back, in named pairs. The only place that knows how the wire says «not observed».

A message that holds what it must not (a value that is not finite, a negative variance, lists of different lengths)
raises DataError; frames lose the leading slash that tf2 refuses.
"""

from __future__ import annotations

import math
from typing import Any, List, Tuple

import numpy as np
from geometry_msgs.msg import Point, Point32, PoseArray, PoseWithCovarianceStamped
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import Quaternion as QuaternionMsg
from nav_msgs.msg import OccupancyGrid as OccupancyGridMsg
from rospy import Duration, Time
from sensor_msgs.msg import LaserScan
from std_msgs.msg import Header

from people_fusion.core.errors import DataError
from people_fusion.core.gaussians import checked_covariance
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.poses import Pose, UncertainPose
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import NANOSECONDS, from_seconds, join, split, to_seconds
from people_fusion.core.tracks import Particles, Tracks
from people_fusion.core.wire import (
    DETECTIONS_PER_MESSAGE,
    UNOBSERVED_VARIANCE,
    bodies_on_wire,
    headings,
    measurement_of,
)
from people_fusion.msg import (
    DetectedPerson,
    DetectedPersons,
    MeasurementAnnouncement,
    TrackedPerson,
    TrackedPersons,
    TrackParticles,
)


def stamp_from_msg(stamp: Any) -> int:
    """Nanoseconds of a ROS time or duration."""
    return join(stamp.secs, stamp.nsecs)


def stamp_to_msg(stamp_ns: int) -> Any:
    """ROS time of nanoseconds."""
    return Time(*split(stamp_ns))


def header_to_msg(stamp_ns: int, frame_id: str) -> Any:
    """std_msgs/Header."""
    return Header(stamp=stamp_to_msg(stamp_ns), frame_id=frame_id)


def frame_from_msg(frame_id: str) -> str:
    """Frame as tf2 knows it; older drivers write a leading slash."""
    return frame_id.lstrip("/")


def scan_from_msg(message: Any) -> Scan:
    """Scan of a sensor_msgs/LaserScan; ranges may be a tuple or an array.

    Raises:
        DataError: no stamp, no frame, no beams or no usable angles.
    """
    _stamped(message.header, "scan")
    ranges = np.asarray(message.ranges, dtype=np.float64)
    if len(ranges) == 0:
        raise DataError("scan without beams")
    angles = (message.angle_min, message.angle_increment)
    if not all(map(math.isfinite, angles)) or (message.angle_increment == 0.0 and len(ranges) > 1):
        raise DataError("scan with impossible angles", f"angle_min {angles[0]}, angle_increment {angles[1]}")
    times = (message.time_increment, message.scan_time)
    if not all(math.isfinite(value) and value >= 0.0 for value in times):
        raise DataError("scan with impossible times", f"time_increment {times[0]}, scan_time {times[1]}")
    if math.isnan(message.range_min) or math.isnan(message.range_max) or message.range_max <= message.range_min:
        raise DataError("scan with impossible reach", f"range_min {message.range_min}, range_max {message.range_max}")
    return Scan(
        stamp_ns=stamp_from_msg(message.header.stamp),
        frame_id=frame_from_msg(message.header.frame_id),
        ranges=ranges,
        angle_min=message.angle_min,
        angle_increment=message.angle_increment,
        range_min=message.range_min,
        range_max=message.range_max,
        time_increment=message.time_increment,
        scan_time=message.scan_time,
    )


def scan_to_msg(scan: Scan) -> Any:
    """sensor_msgs/LaserScan of a scan."""
    return LaserScan(
        header=header_to_msg(scan.stamp_ns, scan.frame_id),
        angle_min=scan.angle_min,
        angle_max=scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1),
        angle_increment=scan.angle_increment,
        time_increment=scan.time_increment,
        scan_time=scan.scan_time,
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=scan.ranges.tolist(),
    )


def grid_from_msg(message: Any) -> OccupancyGrid:
    """Map of a nav_msgs/OccupancyGrid; data may be a tuple or an array.

    Raises:
        DataError: its size is not that of its data, or its place or resolution is impossible.
    """
    info = message.info
    cells = np.array(message.data, dtype=np.int8)
    if cells.size != info.width * info.height or cells.size == 0:
        raise DataError("map of the wrong size", f"{info.width} x {info.height} for {cells.size} cells")
    if not (math.isfinite(info.resolution) and info.resolution > 0):
        raise DataError("map of an impossible resolution", f"{info.resolution} m")
    return OccupancyGrid(
        frame_id=frame_from_msg(message.header.frame_id),
        resolution=info.resolution,
        origin=pose_from_msg(info.origin),
        occupancy=cells.reshape(info.height, info.width),
        stamp_ns=stamp_from_msg(message.header.stamp),
    )


def grid_to_msg(grid: OccupancyGrid) -> Any:
    """nav_msgs/OccupancyGrid of a map."""
    message = OccupancyGridMsg(header=header_to_msg(grid.stamp_ns, grid.frame_id))
    message.info.resolution = grid.resolution
    message.info.height, message.info.width = grid.occupancy.shape
    message.info.origin = pose_to_msg(grid.origin)
    message.data = grid.occupancy.ravel().tolist()
    return message


def pose_from_msg(message: Any) -> Pose:
    """Pose of a geometry_msgs/Pose.

    Raises:
        DataError: a value is not finite or the quaternion is zero.
    """
    p, q = message.position, message.orientation
    return Pose.from_quaternion(np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))


def pose_to_msg(pose: Pose) -> Any:
    """geometry_msgs/Pose of a single pose."""
    return PoseMsg(Point(*pose.translation.tolist()), QuaternionMsg(*pose.quaternion.tolist()))


def localisation_from_msg(message: Any) -> Tuple[int, str, UncertainPose]:
    """Stamp, world frame and world_from_base of a geometry_msgs/PoseWithCovarianceStamped.

    Raises:
        DataError: no stamp or frame, a value is not finite, or the covariance is none.
    """
    _stamped(message.header, "localisation")
    covariance = checked_covariance(_square(message.pose.covariance), "localisation's covariance")
    pose = UncertainPose(pose_from_msg(message.pose.pose), covariance)
    return stamp_from_msg(message.header.stamp), frame_from_msg(message.header.frame_id), pose


def localisation_to_msg(stamp_ns: int, frame_id: str, world_from_base: UncertainPose) -> Any:
    """geometry_msgs/PoseWithCovarianceStamped."""
    message = PoseWithCovarianceStamped(header=header_to_msg(stamp_ns, frame_id))
    message.pose.pose = pose_to_msg(world_from_base.mean)
    message.pose.covariance = world_from_base.covariance.ravel().tolist()
    return message


def announcement_from_msg(message: Any) -> Announcement:
    """Announcement of a people_fusion/MeasurementAnnouncement; its frame matters to nobody.

    Raises:
        DataError: no stamp, or no cue.
    """
    if not message.header.stamp:
        raise DataError("announcement without a stamp")
    if not message.cue:
        raise DataError("announcement without a cue's name")
    return Announcement(stamp_from_msg(message.header.stamp), message.cue, message.sequence, message.withdrawn)


def announcement_to_msg(announcement: Announcement, frame_id: str) -> Any:
    """people_fusion/MeasurementAnnouncement of a sensor message in this frame."""
    return MeasurementAnnouncement(
        header=header_to_msg(announcement.stamp_ns, frame_id),
        cue=announcement.cue,
        sequence=announcement.sequence,
        withdrawn=announcement.withdrawn,
    )


def measurement_from_msg(message: Any) -> Measurement:
    """Measurement of a people_fusion/DetectedPersons, in the sensor's frame.

    Raises:
        DataError: names the first thing that is wrong; no part of the message is taken then.
    """
    _stamped(message.header, "detections")
    return measurement_of(message, stamp_from_msg(message.header.stamp), frame_from_msg(message.header.frame_id))


def measurement_to_msg(measurement: Measurement) -> Any:
    """people_fusion/DetectedPersons of a measurement in its sensor's frame; sensor points stay behind."""
    message = DetectedPersons(
        header=header_to_msg(measurement.stamp_ns, measurement.frame_id),
        cue=measurement.cue,
        modality=measurement.modality,
        sequence=measurement.sequence,
        period=measurement.period_s,
    )
    unobserved = [axis for axis in range(3) if not measurement.observed[axis]] + [3, 4, 5]
    covariances = np.zeros((len(measurement), 6, 6))
    covariances[:, :3, :3] = measurement.covariances
    covariances[:, unobserved, unobserved] = UNOBSERVED_VARIANCE
    first = measurement.sequence * DETECTIONS_PER_MESSAGE
    bodies = bodies_on_wire(measurement).tolist()
    rows = zip(measurement.positions.tolist(), covariances.reshape(-1, 36).tolist(), bodies)
    for i, (position, covariance, body) in enumerate(rows):
        person = DetectedPerson(
            detection_id=first + i, confidence=float(measurement.confidences[i]), modality=measurement.modality
        )
        person.pose.pose = PoseMsg(Point(*position), QuaternionMsg(0.0, 0.0, 0.0, 1.0))
        person.pose.covariance = covariance
        person.height, person.height_std, person.sitting = body
        message.detections.append(person)
    sight = measurement.sight
    if sight is not None:
        message.sight_angle_min, message.sight_angle_increment = sight.angle_min, sight.angle_increment
        message.sight_range_max, message.sight_ranges = sight.range_max, sight.ranges.tolist()
    message.legs = [Point32(x, y, 0.0) for x, y in measurement.legs.tolist()]
    message.leg_owners = measurement.leg_owners.tolist()
    return message


def tracks_from_msg(message: Any) -> Tracks:
    """Tracks of a people_fusion/TrackedPersons. The wire has no covariance between position and velocity: zero.

    Raises:
        DataError: a value is not finite or a covariance is none.
    """
    persons = message.tracks
    count = len(persons)
    pose_covariances = np.array([p.pose.covariance for p in persons], dtype=float).reshape(-1, 6, 6)
    twist_covariances = np.array([p.twist.covariance for p in persons], dtype=float).reshape(-1, 6, 6)
    size = 5 if (twist_covariances[:, 2, 2] >= UNOBSERVED_VARIANCE).all() else 6
    means = np.zeros((count, size))
    means[:, :3] = np.array([_xyz(p.pose.pose.position) for p in persons]).reshape(-1, 3)
    means[:, 3:] = np.array([_xyz(p.twist.twist.linear) for p in persons]).reshape(-1, 3)[:, : size - 3]
    covariances = np.zeros((count, size, size))
    covariances[:, :3, :3] = pose_covariances[:, :3, :3]
    covariances[:, 3:, 3:] = twist_covariances[:, : size - 3, : size - 3]
    if not np.isfinite(means).all():
        raise DataError("track is not finite")
    return Tracks(
        stamp_ns=stamp_from_msg(message.header.stamp),
        frame_id=frame_from_msg(message.header.frame_id),
        ids=np.array([p.track_id for p in persons], dtype=np.int64),
        means=means,
        covariances=checked_covariance(covariances, "track's covariance"),
        existence=np.array([p.existence for p in persons], dtype=float),
        confirmed=np.ones(count, dtype=bool),
        matched=np.array([p.is_matched for p in persons], dtype=bool),
        occluded=np.array([p.is_occluded for p in persons], dtype=bool),
        ages_s=np.array([to_seconds(stamp_from_msg(p.age)) for p in persons], dtype=float),
    )


def tracks_to_msg(tracks: Tracks) -> Any:
    """people_fusion/TrackedPersons of all the given tracks; select the confirmed ones before."""
    size = tracks.means.shape[1]
    velocities = _velocities(tracks)
    yaws, yaw_variances = headings(tracks.means, tracks.covariances)
    quaternions = _quaternions(yaws)
    poses = np.zeros((len(tracks), 6, 6))
    poses[:, :3, :3] = tracks.covariances[:, :3, :3]
    poses[:, [3, 4], [3, 4]] = UNOBSERVED_VARIANCE
    poses[:, 5, 5] = yaw_variances
    twists = np.zeros((len(tracks), 6, 6))
    twists[:, [2, 3, 4, 5], [2, 3, 4, 5]] = UNOBSERVED_VARIANCE
    twists[:, : size - 3, : size - 3] = tracks.covariances[:, 3:, 3:]
    message = TrackedPersons(header=header_to_msg(tracks.stamp_ns, tracks.frame_id))
    for i in range(len(tracks)):
        person = TrackedPerson(
            track_id=int(tracks.ids[i]),
            is_occluded=bool(tracks.occluded[i]),
            is_matched=bool(tracks.matched[i]),
            age=Duration(*divmod(from_seconds(float(tracks.ages_s[i])), NANOSECONDS)),
            existence=float(tracks.existence[i]),
        )
        person.pose.pose = PoseMsg(Point(*tracks.means[i, :3].tolist()), QuaternionMsg(*quaternions[i].tolist()))
        person.pose.covariance = poses[i].ravel().tolist()
        linear = person.twist.twist.linear
        linear.x, linear.y, linear.z = velocities[i].tolist()
        person.twist.covariance = twists[i].ravel().tolist()
        message.tracks.append(person)
    return message


def poses_to_msg(tracks: Tracks) -> Any:
    """geometry_msgs/PoseArray of the tracks' heads, x axis in the direction of motion."""
    quaternions = _quaternions(headings(tracks.means, tracks.covariances)[0])
    return PoseArray(
        header=header_to_msg(tracks.stamp_ns, tracks.frame_id),
        poses=[
            PoseMsg(Point(*position), QuaternionMsg(*quaternion))
            for position, quaternion in zip(tracks.means[:, :3].tolist(), quaternions.tolist())
        ],
    )


def _quaternions(yaws: np.ndarray) -> np.ndarray:
    """(T, 4) x y z w of rotations (T,) about the vertical."""
    zeros = np.zeros(len(yaws))
    return np.column_stack([zeros, zeros, np.sin(0.5 * yaws), np.cos(0.5 * yaws)])


def _velocities(tracks: Tracks) -> np.ndarray:
    """(T, 3), metres a second."""
    velocities = np.zeros((len(tracks), 3))
    velocities[:, : tracks.means.shape[1] - 3] = tracks.means[:, 3:]
    return velocities


def _stamped(header: Any, what: str) -> None:
    if not header.stamp:
        raise DataError(f"{what} without a stamp")
    if not header.frame_id:
        raise DataError(f"{what} without a frame")


def _xyz(vector: Any) -> List[float]:
    return [vector.x, vector.y, vector.z]


def _square(covariance: Any) -> np.ndarray:
    return np.array(covariance, dtype=float).reshape(6, 6)


def particles_to_msg(particles: Particles) -> Any:
    """people_fusion/TrackParticles."""
    columns = np.concatenate([particles.positions, particles.velocities], axis=2).astype(np.float32)
    x, y, z, vx, vy = (column.ravel().tolist() for column in np.moveaxis(columns, 2, 0))
    return TrackParticles(
        header=header_to_msg(particles.stamp_ns, particles.frame_id),
        track_ids=particles.ids.tolist(),
        confirmed=particles.confirmed.tolist(),
        particles=particles.weights.shape[1],
        x=x,
        y=y,
        z=z,
        vx=vx,
        vy=vy,
        weights=particles.weights.astype(np.float32).ravel().tolist(),
    )


def particles_from_msg(message: Any) -> Particles:
    """Particles of people_fusion/TrackParticles.

    Raises:
        DataError: lists are of different lengths, or a value is not finite.
    """
    shape = len(message.track_ids), int(message.particles)
    lists = message.x, message.y, message.z, message.vx, message.vy, message.weights
    if len(message.confirmed) != shape[0] or any(len(values) != shape[0] * shape[1] for values in lists):
        raise DataError("particles in lists of different lengths")
    columns = np.array(lists, dtype=float).reshape(6, *shape)
    if not np.isfinite(columns).all():
        raise DataError("particles that are not finite")
    return Particles(
        stamp_ns=stamp_from_msg(message.header.stamp),
        frame_id=frame_from_msg(message.header.frame_id),
        ids=np.array(message.track_ids, dtype=np.int64),
        confirmed=np.array(message.confirmed, dtype=bool),
        positions=np.moveaxis(columns[:3], 0, 2),
        velocities=np.moveaxis(columns[3:5], 0, 2),
        weights=columns[5],
    )
