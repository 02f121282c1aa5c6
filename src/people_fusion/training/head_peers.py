"""Detectors of others on our photographs: OpenCV's face cascade, YuNet, and the head SVMs of Poschmann."""

from __future__ import annotations

from pathlib import Path
from typing import List, Sequence

import numpy as np

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import Boxes
from people_fusion.cues.heads.detector import Detector, Search
from people_fusion.cues.heads.head_model import read_poschmann_model
from people_fusion.training.head_learning import example
from people_fusion.training.head_sources import Photograph, considered, squares
from people_fusion.training.head_trials import detections

SMALLEST_FACE = 0.5  # of the least head


def reference(path: Path, images: Sequence[Photograph], least: float) -> List[Boxes]:
    """Detections of one of Poschmann's SVMs.

    Raises:
        ConfigError: the file is missing or is not such a model.
    """
    model = read_poschmann_model(path)
    return detections(model, [example(image, model.window, (), least) for image in images])


def faces(detector: Detector, images: Sequence[Photograph], classes: Sequence[str], least: float) -> List[Boxes]:
    """Heads where a detector finds faces, in grey.

    What of a head a face's box spans is learned on these very photographs, in the detector's favour: place and size of
    the head relative to the face, as medians over heads whose middle part holds one face.
    """
    found = [detector.detect(_image(image), _search(image, least)) for image in images]
    relative: List[np.ndarray] = [np.zeros((0, 3))]
    for image, boxes in zip(images, found):
        for head in squares(image.boxes)[considered(image, classes, least)]:
            place = (_middles(boxes.corners) - head[:2]) / (head[2] - head[0])
            inside = np.flatnonzero(((place > 0.25) & (place < 0.85)).all(axis=1))
            if len(inside) == 1:
                face = boxes.corners[inside[0]]
                size = face[3] - face[1]
                offset = _middles(head[None]) - _middles(face[None])
                relative.append(np.append(offset, [[head[3] - head[1]]], axis=1) / size)
    across, down, larger = np.median(np.concatenate(relative), axis=0) if len(relative) > 1 else (0.0, 0.0, 1.0)
    heads = []
    for boxes in found:
        size = (boxes.corners[:, 3] - boxes.corners[:, 1])[:, None]
        middle = _middles(boxes.corners) + size * [across, down]
        corners = np.hstack([middle - 0.5 * larger * size, middle + 0.5 * larger * size])
        # As the head detectors, which look for nothing smaller.
        heads.append(boxes._replace(corners=corners).take(corners[:, 3] - corners[:, 1] >= 0.9 * least))
    return heads


def _middles(corners: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (corners[:, :2] + corners[:, 2:]))


def _image(photograph: Photograph) -> Image:
    height, width = photograph.grey.shape
    intrinsics = np.array([[width, 0.0, 0.5 * width], [0.0, width, 0.5 * height], [0.0, 0.0, 1.0]])
    return Image(0, "camera", photograph.grey, Pinhole(width, height, intrinsics))


def _search(photograph: Photograph, least: float) -> Search:
    return Search.everywhere(_image(photograph), SMALLEST_FACE * least, float(photograph.grey.shape[0]))
