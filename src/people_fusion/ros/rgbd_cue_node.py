"""People in depth images: every RGB-D cue of the preset on each depth camera, in a node of its own."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass
from typing import Any, Dict, Tuple

import numpy as np
import rospy
from sensor_msgs.msg import CompressedImage, PointCloud2
from sensor_msgs.msg import Image as ImageMsg

from people_fusion.core.cameras import Camera
from people_fusion.core.config import parameter
from people_fusion.core.depth_images import DepthImage
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.core.image_topics import camera_info_of, is_rectified, without_transport
from people_fusion.core.organised_clouds import camera_of_points
from people_fusion.core.pairing import NearestInTime
from people_fusion.core.pixels import depths_of, pixels_of
from people_fusion.cues.cue import Cue
from people_fusion.cues.rgbd.drawing import annotated, coloured_cloud
from people_fusion.cues.rgbd.floor import Floor
from people_fusion.cues.rgbd.rgbd import RgbdCue
from people_fusion.ros import topics
from people_fusion.ros.camera_cues import IMAGE_BUFFER, UNCALIBRATED, CameraCues
from people_fusion.ros.clouds import cloud_from_msg, cloud_to_msg
from people_fusion.ros.conversions import frame_from_msg, stamp_from_msg
from people_fusion.ros.cues import Waiting
from people_fusion.ros.images import image_to_msg
from people_fusion.ros.node import Node, run
from people_fusion.tracking.fusion import FusionConfig

NO_COLOUR = "depth image without a colour image of its time"
WRONG_FLOOR = "floor is not where the transform tells"
WRONG_FLOOR_STDS = 2.0  # of what the transform is good for


@dataclass(frozen=True)
class RgbdCueSettings:
    """The RGB-D cue node's own parameters."""

    depths: Tuple[str, ...] = parameter(
        (), "topics of depth images; compressed where they end so, rectified where they are called so"
    )
    camera_infos: Tuple[str, ...] = parameter((), "their camera_info, in the same order; empty: beside the images")
    colours: Tuple[str, ...] = parameter(
        (), "topics of colour images of the same pixels, in the same order; empty: none"
    )
    colour_tolerance_s: float = parameter(0.04, "how far apart both may be taken, seconds", low=0.0, high=1.0)
    clouds: Tuple[str, ...] = parameter((), "topics of organised PointCloud2, in colour or not")

    def __post_init__(self) -> None:
        inputs = [*self.depths, *self.clouds]
        if not inputs or len(set(inputs)) < len(inputs):
            raise ConfigError(f"depths, clouds: expected topics that differ, got {inputs}")
        for name in ("camera_infos", "colours"):
            given = getattr(self, name)
            if given and len(given) != len(self.depths):
                raise ConfigError(f"{name}: expected {len(self.depths)} topics, got {len(given)}")


class RgbdCues(CameraCues):
    """The RGB-D cues of one process.

    Colour images are never waited for: a depth image has the one that is there when the depth image's transforms are.
    """

    def __init__(self, node: Node, settings: RgbdCueSettings, config: FusionConfig) -> None:
        super().__init__(node, config, "RGB-D cues")
        if not config.rgbd_cues:
            raise ConfigError("rgbd_cues: the preset names none")
        self._colours: Dict[str, NearestInTime[Any]] = {}
        self._points: Dict[str, rospy.Publisher] = {}
        self._counts: Counter = Counter()
        self._floors: Dict[str, Floor] = {}
        self._unseen: Counter = Counter()
        self._sizes: Dict[str, Tuple[Camera, Camera]] = {}  # as told, and of the images' size
        for place, topic in enumerate(settings.depths):
            base = without_transport(topic)
            info = settings.camera_infos[place] if settings.camera_infos else camera_info_of(topic)
            self._calibrate(topic, info, is_rectified(topic))
            self._look_at(topic, CompressedImage if topic != base else ImageMsg, base, config.rgbd_cues)
            if settings.colours and settings.colours[place]:
                self._pair(topic, settings.colours[place], settings.colour_tolerance_s)
        for topic in settings.clouds:
            self._look_at(topic, PointCloud2, topic, config.rgbd_cues)
        for name in self.cues:
            self._points[name] = rospy.Publisher(
                f"{topics.DEBUG}/{name}/{topics.DEBUG_POINTS}", PointCloud2, queue_size=1
            )
        node.diagnostics.add_events(lambda: dict(self._counts))
        node.diagnostics.add_facts(self._floor_facts)
        self.start()

    def reset(self) -> None:
        """Time has jumped."""
        super().reset()
        for colours in self._colours.values():
            colours.clear()

    def read(self, topic: str, message: Any) -> DepthImage:
        """See CameraCues."""
        stamp_ns, frame_id = stamp_from_msg(message.header.stamp), frame_from_msg(message.header.frame_id)
        if hasattr(message, "point_step"):
            cloud = cloud_from_msg(message)
            return DepthImage(stamp_ns, frame_id, cloud.depths, self._camera_of(topic, cloud.points), cloud.colour)
        depths = depths_of(message)
        return DepthImage(stamp_ns, frame_id, depths, self._resized(topic, *depths.shape))

    def measure(self, waiting: Waiting) -> None:
        """Measure and tell, and show what was done where somebody looks."""
        cue, image = waiting.cue, waiting.data
        picture, points = self._debug[cue.name], self._points[cue.name]
        is_seen, is_walked_around = picture.get_num_connections() > 0, points.get_num_connections() > 0
        needs_colour = isinstance(cue, RgbdCue) and cue.config.colour
        if image.colour is None and (needs_colour or is_seen or is_walked_around):
            image = self._coloured(cue, image, needs_colour)
        former = getattr(cue, "look", None)
        super().measure(waiting._replace(data=image))
        if not isinstance(cue, RgbdCue) or cue.look is None or cue.look is former:
            return
        self._note_floor(cue, cue.look.floor)
        if is_seen:
            picture.publish(image_to_msg(annotated(image, cue.look), image.stamp_ns, image.frame_id))
        if is_walked_around:
            points.publish(cloud_to_msg(*coloured_cloud(image, cue.look), image.stamp_ns, image.frame_id))

    def _pair(self, topic: str, colour_topic: str, tolerance_s: float) -> None:
        colours: NearestInTime = NearestInTime(tolerance_s)
        kind = CompressedImage if colour_topic != without_transport(colour_topic) else ImageMsg

        def on_colour(message: Any) -> None:
            self.node.diagnostics.heard(colour_topic)
            colours.put(stamp_from_msg(message.header.stamp), message)

        self._colours[topic] = colours
        self.node.subscribe(colour_topic, kind, on_colour, 1, IMAGE_BUFFER)

    def _resized(self, topic: str, height: int, width: int) -> Camera:
        """The camera of images of this size; the same object until something changes, as cues keep what they make."""
        camera = self.cameras.get(topic)
        if camera is None:
            raise DataError(UNCALIBRATED)
        told, resized = self._sizes.get(topic, (None, camera))
        if told is not camera or (resized.width, resized.height) != (width, height):
            resized = camera.resized(width, height)
            self._sizes[topic] = camera, resized
        return resized

    def _camera_of(self, topic: str, points: np.ndarray) -> Camera:
        """The camera of a cloud, told by the first one of its size that tells it."""
        height, width = points.shape[:2]
        camera = self.cameras.get(topic)
        if camera is None or (camera.width, camera.height) != (width, height):
            camera = self.cameras[topic] = camera_of_points(points)
        return camera

    def _coloured(self, cue: Cue, image: DepthImage, is_needed: bool) -> DepthImage:
        """A depth image with the colours that go with it, as far as there are any."""
        colours = self._colours.get(self._topics[cue.name])
        if colours is None:
            return image
        message = colours.at(image.stamp_ns)
        if message is None:
            self._counts[NO_COLOUR] += is_needed
            return image
        try:
            return image.coloured(pixels_of(message), frame_from_msg(message.header.frame_id))
        except DataError as error:
            self.node.diagnostics.bad(error.reason, f"{cue.name}: {error}")
            return image

    def _note_floor(self, cue: RgbdCue, floor: Floor) -> None:
        self._floors[cue.name] = floor
        limits = WRONG_FLOOR_STDS * np.array([cue.config.floor_height_std, cue.config.floor_tilt_std])
        if (np.array([abs(floor.plane[0]), _tilt(floor)]) > limits).any():
            self._counts[f"{cue.name}: {WRONG_FLOOR}"] += 1
        if math.isnan(floor.rms):
            self._unseen[cue.name] += 1

    def _floor_facts(self) -> Dict[str, str]:
        facts: Dict[str, str] = {}
        for name, floor in list(self._floors.items()):
            facts[f"{name}: floor residual, m"] = f"{floor.rms:.3f}"  # nan: too little of it is seen
            facts[f"{name}: floor corrected by, m"] = f"{floor.plane[0]:+.3f}"
            facts[f"{name}: floor tilted by, degrees"] = f"{math.degrees(_tilt(floor)):.1f}"
            facts[f"{name}: images without floor"] = str(self._unseen[name])
        return facts


def _tilt(floor: Floor) -> float:
    """Radians."""
    return math.atan(math.hypot(floor.plane[1], floor.plane[2]))


def _build(settings: RgbdCueSettings, config: FusionConfig) -> Node:
    colours = [topic for topic in settings.colours if topic]
    node = Node(config, [*settings.depths, *settings.clouds, *colours])
    RgbdCues(node, settings, config)
    return node


def main() -> int:
    """Entry of scripts/rgbd_cue; returns the exit status."""
    return run("rgbd_cue", RgbdCueSettings, _build)
