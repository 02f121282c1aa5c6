"""Small recordings for tests: one person who walks past a scanner, in the many ways in which users record that."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Dict, Optional, Tuple

import numpy as np
from rosbags.rosbag1 import Writer
from rosbags.typesys import get_types_from_msg

from people_fusion.core.stamps import from_seconds, split
from people_fusion.replay.typestore import typestore

START_NS = 1_500_000_000 * 10**9
PERIOD_S = 0.1
LASER_AT = (0.2, 0.0, 0.3)  # in base_link
LEG_RADIUS_M, LEG_GAP_M, WALL_M = 0.06, 0.25, 8.0

DEFINITIONS = {
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "tf/msg/tfMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "leg_tracker/msg/Person": "geometry_msgs/Pose pose\nuint32 id\n",
    "leg_tracker/msg/PersonArray": "std_msgs/Header header\nleg_tracker/Person[] people\n",
    "people_msgs/msg/Person": "string name\ngeometry_msgs/Point position\ngeometry_msgs/Point velocity\n"
    "float64 reliability\n",
    "people_msgs/msg/People": "std_msgs/Header header\npeople_msgs/Person[] people\n",
    "odd_msgs/msg/Nothing": "std_msgs/Header header\nfloat64 value\n",
}


def person_at(seconds: float) -> Tuple[float, float]:
    """Where the person is in the scanner's frame: he walks across at 0.8 m/s."""
    return 3.0, -2.0 + 0.8 * seconds


def ranges_at(seconds: float, beams: int, angle_min: float, increment: float) -> np.ndarray:
    """(B,) distances of a round wall and two round legs side by side."""
    angles = angle_min + increment * np.arange(beams)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    distances = np.full(beams, WALL_M)
    x, y = person_at(seconds)
    for side in (-0.5, 0.5):
        centre = np.array([x, y + side * LEG_GAP_M])
        along = directions @ centre
        across_squared = centre @ centre - along**2
        hit = (along > 0) & (across_squared < LEG_RADIUS_M**2)
        distances[hit] = along[hit] - np.sqrt(LEG_RADIUS_M**2 - across_squared[hit])
    return distances


class BagBuilder:
    """Writes messages to a bag; stamps and arrivals in seconds since the start."""

    def __init__(self, path: Path, clock_offset_s: float = 0.0) -> None:
        self.path = path
        self.store = typestore()
        for name, text in DEFINITIONS.items():
            types = get_types_from_msg(text, name)
            self.store.register({key: value for key, value in types.items() if key == name})
        self._offset_s = clock_offset_s
        self._writer = Writer(path)
        self._writer.open()
        self._connections: Dict[Tuple[str, str], Any] = {}

    def __enter__(self) -> BagBuilder:
        return self

    def __exit__(self, *_: Any) -> None:
        self._writer.close()

    def make(self, kind: str, *fields: Any) -> Any:
        package, name = kind.split("/")
        return self.store.types[f"{package}/msg/{name}"](*fields)

    def add(self, topic: str, kind: str, seconds: float, *fields: Any) -> None:
        """Write a message that arrives at `seconds`."""
        full = kind.replace("/", "/msg/")
        if (topic, kind) not in self._connections:
            self._connections[topic, kind] = self._writer.add_connection(topic, full, typestore=self.store)
        data = self.store.serialize_ros1(self.make(kind, *fields), full)
        arrival_ns = START_NS + from_seconds(seconds + self._offset_s)
        self._writer.write(self._connections[topic, kind], arrival_ns, data)

    def time(self, seconds: Optional[float]) -> Any:
        stamp_ns = 0 if seconds is None else START_NS + from_seconds(seconds)
        return self.make("builtin_interfaces/Time", *split(stamp_ns))

    def header(self, seconds: Optional[float], frame_id: str) -> Any:
        return self.make("std_msgs/Header", 0, self.time(seconds), frame_id)

    def pose(self, x: float, y: float, z: float = 0.0, w: float = 1.0) -> Any:
        point = self.make("geometry_msgs/Point", float(x), float(y), float(z))
        return self.make("geometry_msgs/Pose", point, self.make("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, w))

    def scan(
        self,
        seconds: float,
        topic: str = "/scan",
        frame_id: str = "laser",
        beams: int = 541,
        field_of_view_deg: float = 270.0,
        latency_s: float = 0.02,
        stamped: bool = True,
        walked_s: Optional[float] = None,
    ) -> None:
        """Write a scan of the person where he is at `seconds`, or after `walked_s`."""
        increment = np.deg2rad(field_of_view_deg) / max(beams - 1, 1)
        angle_min = -np.deg2rad(field_of_view_deg) / 2
        ranges = ranges_at(seconds if walked_s is None else walked_s, beams, angle_min, increment)
        self.add(
            topic,
            "sensor_msgs/LaserScan",
            seconds + latency_s,
            self.header(seconds if stamped else None, frame_id),
            angle_min,
            angle_min + increment * (beams - 1),
            increment,
            0.0,
            PERIOD_S,
            0.05,
            10.0,
            ranges.astype(np.float32),
            np.zeros(0, np.float32),
        )

    def link(
        self,
        seconds: float,
        parent: str,
        child: str,
        at: Tuple[float, float, float] = (0.0, 0.0, 0.0),
        kind: str = "tf2_msgs/TFMessage",
        topic: str = "/tf",
        latency_s: float = 0.005,
    ) -> None:
        turn = self.make("geometry_msgs/Quaternion", 0.0, 0.0, 0.0, 1.0)
        transform = self.make("geometry_msgs/Transform", self.make("geometry_msgs/Vector3", *at), turn)
        stamped = self.make("geometry_msgs/TransformStamped", self.header(seconds, parent), child, transform)
        self.add(topic, kind, seconds + latency_s, [stamped])

    def odometry_links(self, seconds: float, slash: str = "", kind: str = "tf2_msgs/TFMessage") -> None:
        """odom -> base_link -> laser of a robot that drives along x at 0.5 m/s."""
        self.link(seconds, slash + "odom", slash + "base_link", (0.5 * seconds, 0.0, 0.0), kind)
        self.link(seconds, slash + "base_link", slash + "laser", LASER_AT, kind)

    def odometry(self, seconds: float, child: str = "base_link") -> None:
        """Odometry of a robot that drives along x at 0.5 m/s."""
        zeros = np.zeros(36)
        pose = self.make("geometry_msgs/PoseWithCovariance", self.pose(0.5 * seconds, 0.0), zeros)
        still = self.make("geometry_msgs/Vector3", 0.0, 0.0, 0.0)
        twist = self.make("geometry_msgs/TwistWithCovariance", self.make("geometry_msgs/Twist", still, still), zeros)
        header = self.header(seconds, "odom")
        self.add("/odom", "nav_msgs/Odometry", seconds + 0.005, header, child, pose, twist)

    def person_array(
        self, seconds: float, frame_id: str = "laser", topic: str = "/ground_truth", latency_s: float = 0.03
    ) -> None:
        person = self.make("leg_tracker/Person", self.pose(*person_at(seconds)), 7)
        self.add(topic, "leg_tracker/PersonArray", seconds + latency_s, self.header(seconds, frame_id), [person])


def walk(
    path: Path,
    duration_s: float = 6.0,
    tf_kind: Optional[str] = "tf2_msgs/TFMessage",
    slash: str = "",
    clock_offset_s: float = 0.0,
    truth: bool = True,
    tf_latency_s: float = 0.005,
    **scan: Any,
) -> Path:
    """A recording of the person who walks past; `scan` is handed to BagBuilder.scan."""
    with BagBuilder(path, clock_offset_s) as bag:
        for step in range(int(duration_s / PERIOD_S)):
            seconds = step * PERIOD_S
            if tf_kind is not None:
                for part in range(5):
                    moment = seconds + part * PERIOD_S / 5
                    position = (0.5 * moment, 0.0, 0.0)
                    bag.link(moment, f"{slash}odom", f"{slash}base_link", position, tf_kind, latency_s=tf_latency_s)
                bag.link(seconds, f"{slash}base_link", f"{slash}laser", LASER_AT, tf_kind)
            bag.scan(seconds, frame_id=f"{slash}laser", **scan)
            if truth and step % 5 == 0:
                bag.person_array(seconds, f"{slash}laser")
    return path
