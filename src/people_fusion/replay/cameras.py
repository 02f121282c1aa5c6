"""Which images of a recording the head cues work on."""

from __future__ import annotations

from typing import Dict, FrozenSet, List, NamedTuple, Optional, Tuple

from people_fusion.core.image_topics import camera_info_of, without_transport
from people_fusion.core.transforms import normalise_frame
from people_fusion.replay.recording import Recording, Topic

DEPTHS = ("16UC1", "32FC1", "16uc1", "32fc1")
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
        if topic.name.endswith("/compressedDepth") or getattr(first, "encoding", "") in DEPTHS:
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


def _rank(topic: Topic) -> Tuple[int, int]:
    last = without_transport(topic.name).rsplit("/", 1)[-1]
    return PREFERRED.index(last) if last in PREFERRED else len(PREFERRED), int(topic.kind == "CompressedImage")
