"""Heads that a detector finds in the colour of a depth image: whoever bends or leans has no head over shoulders."""

from __future__ import annotations

from typing import List, NamedTuple

import numpy as np

from people_fusion.core.depth_images import DepthImage
from people_fusion.core.images import Image
from people_fusion.core.poses import Pose
from people_fusion.cues.heads.detector import Detector, Search
from people_fusion.cues.rgbd.sensors import DepthSensor

SIZE_STDS = 3.0  # by which a box may be too high or too low for its distance
INNER_ROWS, INNER_COLUMNS = 0.25, 0.3  # of a box on each side that may be seen past a head
LEAST_SEEN = 0.5  # of the pixels within have a depth


class ColourHeads(NamedTuple):
    """Heads in the colour image that are as large as their depth says heads are.

    Attributes:
        tops: (N, 3) of the boxes, on the surface that is seen, level axes, metres.
        confidences: (N,) of the detector.
    """

    tops: np.ndarray
    confidences: np.ndarray


def colour_heads(detector: Detector, image: DepthImage, sensor: DepthSensor, level_from_camera: Pose) -> ColourHeads:
    """What the detector finds, placed by depth.

    Args:
        detector: of heads.
        image: with colour.
        sensor: the kind of camera.
        level_from_camera: pose in level axes that look where the camera looks.
    """
    pixels, camera, box = image.colour, image.camera, detector.box
    assert pixels is not None
    view = Image(image.stamp_ns, image.frame_id, pixels, camera)
    found = detector.detect(view, Search.everywhere(view, 1.0, pixels.shape[0]))
    tops: List[np.ndarray] = []
    confidences: List[float] = []
    for (left, top, right, bottom), confidence in zip(found.corners, found.confidences):
        height, width = bottom - top, right - left
        rows = slice(max(int(top + INNER_ROWS * height), 0), int(bottom - INNER_ROWS * height) + 1)
        columns = slice(max(int(left + INNER_COLUMNS * width), 0), int(right - INNER_COLUMNS * width) + 1)
        inner = image.depths[rows, columns]
        seen = inner[(inner > sensor.min_range) & (inner < sensor.max_range)]  # false for NaN
        if len(seen) == 0 or len(seen) < LEAST_SEEN * inner.size:
            continue
        middle = 0.5 * (left + right)
        upper, lower = (ray / ray[2] for ray in camera.rays(np.array([[middle, top], [middle, bottom]])))
        depth = float(np.median(seen))
        if abs(depth * np.linalg.norm(lower - upper) - box.height) < SIZE_STDS * box.height_std:
            tops.append(level_from_camera.apply((depth * upper)[None])[0])
            confidences.append(float(confidence))
    return ColourHeads(np.array(tops).reshape(-1, 3), np.array(confidences))
