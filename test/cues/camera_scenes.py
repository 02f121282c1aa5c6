"""An ideal camera on a robot, people's parts as boxes, and a detector that is told what to find."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.core.config import parameter, section
from people_fusion.core.images import Image
from people_fusion.core.poses import Pose
from people_fusion.cues.heads.boxes import BoxConfig, Boxes
from people_fusion.cues.heads.detector import DETECTORS, Detector

SECOND = 1_000_000_000
OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # level_from_camera that looks along x


class Ideal(Camera):
    """Without distortion, of an optical frame."""

    def __init__(self, width=640, height=480, focal=525.0):
        self.width, self.height, self.focal = width, height, focal
        self.middle = np.array([0.5 * (width - 1), 0.5 * (height - 1)])

    def project(self, points):
        depth = np.where(points[:, 2] > 1e-6, points[:, 2], np.nan)[:, None]
        return self.focal * points[:, :2] / depth + self.middle

    def rays(self, pixels):
        rays = np.column_stack([(pixels - self.middle) / self.focal, np.ones(len(pixels))])
        return rays / np.linalg.norm(rays, axis=1)[:, None]

    def ray_jacobians(self, pixels):
        rays = np.column_stack([(pixels - self.middle) / self.focal, np.ones(len(pixels))])
        lengths = np.linalg.norm(rays, axis=1)[:, None, None]
        outer = rays[:, :, None] * rays[:, None, :]
        return ((np.eye(3) - outer / lengths**2) / lengths / self.focal)[:, :, :2]


def tilted(degrees, yaw=0.0):
    """level_from_camera of a camera that looks down by so much."""
    angle = np.radians(degrees)
    down = np.array([[np.cos(angle), 0.0, np.sin(angle)], [0.0, 1.0, 0.0], [-np.sin(angle), 0.0, np.cos(angle)]])
    return Pose.from_xy_yaw(0.0, 0.0, yaw).rotation @ down @ OPTICAL


def boxes_of(heads, camera, level_from_camera, box, height=None):
    """(N, 4) corners of what is `height` (N,) high, beneath heads (N, 3) in level axes; square."""
    height = np.full(len(heads), box.height) if height is None else height
    middles = heads - [0.0, 0.0, box.head_above]
    up = 0.5 * height[:, None] * [0.0, 0.0, 1.0]
    top, bottom = (camera.project((middles + sign * up) @ level_from_camera) + 0.5 for sign in (1.0, -1.0))
    half = 0.5 * (bottom[:, 1] - top[:, 1])
    column = 0.5 * (top[:, 0] + bottom[:, 0])
    return np.column_stack([column - half, top[:, 1], column + half, bottom[:, 1]])


@dataclass(frozen=True)
class ToldConfig:
    box: BoxConfig = section(BoxConfig, "what a box holds")
    needs_rest: bool = parameter(False, "whether the camera must stand still")


@DETECTORS.register("told", ToldConfig)
class Told(Detector):
    """Finds the boxes that it was told of, where they are wanted."""

    part = "head"

    def __init__(self, config):
        self.config, self.box, self.needs_rest = config, config.box, config.needs_rest
        self.boxes = Boxes.none()
        self.searches, self.resets = [], 0

    def detect(self, image, search):  # noqa: ARG002
        self.searches.append(search)
        return self.boxes.take(search.wanted(self.boxes.corners))

    def reset(self):
        self.resets += 1


def image(stamp_ns=5 * SECOND, camera=None, frame_id="camera"):
    camera = camera or Ideal()
    return Image(stamp_ns, frame_id, np.zeros((camera.height, camera.width), dtype=np.uint8), camera)
