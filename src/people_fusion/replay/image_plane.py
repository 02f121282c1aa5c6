"""Tracks and annotated people as boxes in a camera's image (Volkhardt et al. 2013, IV)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Mapping, Optional, Sequence, Tuple, Union

import numpy as np

from people_fusion.core.camera_models import Panorama, PanoramaConfig
from people_fusion.core.cameras import Camera
from people_fusion.core.errors import DataError, RecordingError, TransformUnavailable
from people_fusion.core.image_topics import camera_info_of, is_rectified, without_transport
from people_fusion.core.poses import Pose
from people_fusion.core.sightings import person_boxes
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import TransformTree, normalise_frame
from people_fusion.evaluation.distances import in_the_image
from people_fusion.evaluation.evaluate import Evaluation, evaluate_in_image
from people_fusion.evaluation.truth import Truth
from people_fusion.replay import conversions
from people_fusion.replay.ground_truth import Instant
from people_fusion.replay.recording import Recording
from people_fusion.replay.sampling import together

EVERYTHING_S = 1e9  # history of transforms
WIDTH = 0.5  # of the height, Volkhardt et al. 2013, IV
ON_THE_FLOOR_M = 0.5  # people who are annotated lower are so by their feet ...
STANDING_M = 1.75  # ... and that tall
LEAST_M = 0.3  # height of a track's box


@dataclass(frozen=True, eq=False)
class View:
    """A camera of a recording.

    Attributes:
        topic: of its images.
        frame_id: of the camera.
        camera: its model.
        transforms: all of the recording.
    """

    topic: str
    frame_id: str
    camera: Camera
    transforms: TransformTree


def read_view(path: Union[str, Path], topic: str, panoramas: Mapping[str, PanoramaConfig]) -> View:
    """The camera of a topic of images, by its CameraInfo or by the panorama that describes its frame.

    Raises:
        RecordingError: the recording is damaged, lacks the topic, or nothing describes its camera.
    """
    with Recording(path) as recording:
        images = [each for each in recording.of_kind("Image", "CompressedImage") if _is_of(each.name, topic)]
        if not images:
            there = recording.topic(topic)  # which fails and names those that are there
            raise RecordingError(f"{path}: {there.name} ({there.type}, {there.count} messages) holds no images")
        image = images[0]
        frame_id = normalise_frame(next(iter(recording.messages([image]))).read().header.frame_id)
        camera: Camera
        if frame_id in panoramas:
            camera = Panorama(panoramas[frame_id])
        else:
            infos = [each for each in recording.of_kind("CameraInfo") if each.name == camera_info_of(image.name)]
            if not infos:
                raise RecordingError(f"{path}: neither a camera_info nor a panorama describes {topic} ({frame_id})")
            info = next(iter(recording.messages(infos))).read()
            try:
                camera = conversions.camera(info, is_rectified(image.name))
            except DataError as error:
                raise RecordingError(f"{path}: {infos[0].name}: {error}") from error
        return View(image.name, frame_id, camera, all_transforms(recording))


def all_transforms(recording: Recording) -> TransformTree:
    """Every transform of a recording, from beginning to end."""
    transforms = TransformTree(EVERYTHING_S)
    for recorded in recording.messages(recording.of_kind("TFMessage", "tfMessage")):
        for link in conversions.links(recorded.read()):
            try:
                is_static = recorded.topic.endswith("tf_static")
                transforms.add(link.parent, link.child, link.stamp_ns, link.pose(), static=is_static)
            except DataError:
                continue  # the recording's replay counts them
    return transforms


def score_in_image(
    samples: Sequence[Tuple[Instant, Tracks]], view: View, only_annotated: bool = False
) -> Tuple[Optional[Evaluation], int]:
    """Evaluation of the boxes of those who are in the image, and at how many instants the camera's place is unknown.

    Boxes are as high as a head's middle is over the floor, half as wide, and end where the image does; somebody who is
    hidden behind another or a wall is in the image too. The evaluation is None where nothing can be compared.
    """
    placed, poses = [], []
    for instant, tracks in samples:
        try:
            poses.append(view.transforms.lookup(instant.frame_id, view.frame_id, instant.stamp_ns))
        except TransformUnavailable:
            continue
        placed.append((instant, tracks))
    missing = len(samples) - len(placed)
    if not placed:
        return None, missing
    truth, estimates = together(placed)
    heads = truth.positions.copy()
    if heads.shape[1] == 2:
        heads = np.column_stack([heads, np.zeros(len(heads))])
    heads[heads[:, 2] < ON_THE_FLOOR_M, 2] = STANDING_M
    tops = estimates.means[:, :3].copy()
    if tops.shape[1] < 3:
        tops = np.zeros((0, 3))  # nobody was reported
    tops[:, 2] = np.maximum(tops[:, 2], LEAST_M)
    people = _boxes(view.camera, poses, heads, truth.frames)
    tracks_boxes = _boxes(view.camera, poses, tops, estimates.frames)
    is_person, is_track = np.isfinite(people).all(axis=1), np.isfinite(tracks_boxes).all(axis=1)
    velocities = None if truth.velocities is None else truth.velocities[is_person]
    seen = Truth(
        truth.stamps_ns, truth.frames[is_person], truth.ids[is_person], truth.positions[is_person], velocities
    )
    distance = in_the_image(people[is_person], tracks_boxes[is_track], view.camera.width if view.camera.wraps else None)
    return evaluate_in_image(seen, estimates.select(is_track), distance, only_annotated=only_annotated), missing


def _boxes(camera: Camera, poses: Sequence[Pose], tops: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """(N, 4) boxes of people with their tops (N, 3) in the world, each at its frame; NaN where not in the image."""
    boxes = np.full((len(tops), 4), np.nan)
    for frame in np.unique(frames):
        rows = frames == frame
        boxes[rows] = person_boxes(camera, poses[frame], tops[rows], tops[rows, 2], WIDTH * tops[rows, 2])
    boxes[:, [1, 3]] = np.clip(boxes[:, [1, 3]], 0.0, camera.height)
    if not camera.wraps:
        boxes[:, [0, 2]] = np.clip(boxes[:, [0, 2]], 0.0, camera.width)
    return boxes


def _is_of(recorded: str, topic: str) -> bool:
    return topic.strip("/") in (recorded.strip("/"), without_transport(recorded).strip("/"))
