"""Which images of a recording the head cues and the RGB-D cues work on."""

from __future__ import annotations

import re
from typing import Any, Dict, FrozenSet, List, NamedTuple, Optional, Tuple

from people_fusion.core.image_topics import COMPRESSED_DEPTH, camera_info_of, without_transport
from people_fusion.core.transforms import normalise_frame
from people_fusion.replay.recording import Recording, Topic

DEPTHS = ("16UC1", "32FC1", "16uc1", "32fc1")
REGISTERED = {"depth_registered": "depth", "aligned_depth_to_color": "depth"}  # what else drivers call the same depths
PROCESSED = ("hw_registered", "sw_registered")  # by rgbd_launch
SIZES = ("sd", "qhd", "hd")  # of a Kinect 2; the first is what it measures
INFRARED = frozenset({"ir", "infra1", "infra2"})  # as 16UC1, too
PREFERRED = ("image_rect_color", "image_rect", "image_color", "image_raw", "image_mono")


class CameraSource(NamedTuple):
    """A camera of a recording.

    Attributes:
        name: topic of its images, without the transport.
        image: as recorded.
        info: its CameraInfo, or None for a camera that the preset describes.
        frame_id: of the images.
    """

    name: str
    image: Topic
    info: Optional[Topic]
    frame_id: str


class DepthSource(NamedTuple):
    """A depth camera of a recording.

    Attributes:
        name: topic of its images, without the transport.
        image: as recorded.
        info: its CameraInfo.
        frame_id: of the images.
        colour: images of the same frame, or None.
    """

    name: str
    image: Topic
    info: Topic
    frame_id: str
    colour: Optional[Topic]


def find_cameras(
    recording: Recording, connected: FrozenSet[str], described: FrozenSet[str]
) -> Tuple[List[CameraSource], List[str]]:
    """One stream of images per camera, in order of names, and notes on those that are left out.

    Args:
        recording: the bag.
        connected: frames on the robot.
        described: frames of cameras that the preset describes, so that they need no CameraInfo.
    """
    infos = {topic.name: topic for topic in recording.of_kind("CameraInfo")}
    found: Dict[str, CameraSource] = {}
    notes: List[str] = []
    topics = recording.of_kind("Image", "CompressedImage")
    for topic in sorted(topics, key=lambda each: (_rank(each), each.name)):
        first = next(iter(recording.messages([topic]))).read()
        frame_id = normalise_frame(first.header.frame_id)
        name = without_transport(topic.name)
        info = infos.get(camera_info_of(topic.name))
        if _is_depth(topic, first):
            continue
        if frame_id in found:
            notes.append(f"images {topic.name} are left out: they are of the camera of {found[frame_id].image.name}")
        elif info is None and frame_id not in described:
            notes.append(f"images {topic.name} are left out: there is no camera_info beside them")
        elif frame_id not in connected:
            notes.append(f"images {topic.name} are left out: no transform connects {frame_id}")
        else:
            found[frame_id] = CameraSource(name, topic, None if frame_id in described else info, frame_id)
    return sorted(found.values()), notes


def find_depth_cameras(recording: Recording, connected: FrozenSet[str]) -> Tuple[List[DepthSource], List[str]]:
    """One stream of depth images per sensor, in order of names, and notes on those that are left out; see find_cameras.

    Of a sensor's streams a registered one is taken first, as colour belongs to it, then the smallest of a Kinect 2's,
    then one that is not compressed.
    """
    infos = {topic.name: topic for topic in recording.of_kind("CameraInfo")}
    found: Dict[str, DepthSource] = {}
    colours: Dict[str, Topic] = {}
    notes: List[str] = []
    topics = recording.of_kind("Image", "CompressedImage")
    for topic in sorted(topics, key=lambda each: (*_sensor(each)[1:], *_rank(each), each.name)):
        first = next(iter(recording.messages([topic]))).read()
        frame_id = normalise_frame(first.header.frame_id)
        info = infos.get(camera_info_of(topic.name))
        sensor = _sensor(topic)[0]
        if _is_infrared(topic):
            continue
        if not _is_depth(topic, first):
            colours.setdefault(frame_id, topic)
        elif sensor in found:
            notes.append(f"depths {topic.name} are left out: they are of the camera of {found[sensor].image.name}")
        elif info is None:
            notes.append(f"depths {topic.name} are left out: there is no camera_info beside them")
        elif frame_id not in connected:
            notes.append(f"depths {topic.name} are left out: no transform connects {frame_id}")
        else:
            found[sensor] = DepthSource(without_transport(topic.name), topic, info, frame_id, None)
    return [each._replace(colour=colours.get(each.frame_id)) for each in sorted(found.values())], notes


def _is_depth(topic: Topic, first: Any) -> bool:
    """Whether the first message of a topic, and so all of them, is a depth image, or an infrared one like that."""
    encoding = getattr(first, "encoding", "") or getattr(first, "format", "").split(";")[0]
    return topic.name.endswith(COMPRESSED_DEPTH) or encoding in DEPTHS


def _is_infrared(topic: Topic) -> bool:
    return bool(INFRARED & set(re.split("[/_]", topic.name)))


def _sensor(topic: Topic) -> Tuple[str, bool, int]:
    """What a sensor's streams of depth have in common; whether this one is not brought to the colour's pixels, and
    which of its sizes it has."""
    names = camera_info_of(topic.name).split("/")[:-1]
    size = next((SIZES.index(name) for name in names if name in SIZES), 0)
    shared = [REGISTERED.get(name, name) for name in names if name not in (*SIZES, *PROCESSED)]
    return "/".join(shared), not set(names) & set(REGISTERED), size


def _rank(topic: Topic) -> Tuple[int, int]:
    last = without_transport(topic.name).rsplit("/", 1)[-1]
    return PREFERRED.index(last) if last in PREFERRED else len(PREFERRED), int(topic.kind == "CompressedImage")
