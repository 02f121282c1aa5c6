"""Depth images of people made of ellipsoids, in a room with a floor, walls and boxes; every ray is exact."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Tuple

import numpy as np
from camera_scenes import SECOND, Ideal, tilted

from people_fusion.core.depth_images import DepthImage
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import TransformSource
from people_fusion.simulation.rendering_people import Look, stand

HEAD_DROP = 0.11
ALONG_DISPARITY = 1.4e-3  # std of depths over their square, 1/m


@dataclass(frozen=True)
class Person:
    """Stands or sits at x, y, metres, and looks at `facing`, radians; `height` of the top of the head, `skull` its half
    axes ahead, aside and up, and so far it `bends` before the body."""

    x: float
    y: float
    height: float = 1.75
    facing: float = np.pi
    sits: bool = False
    skull: Tuple[float, float, float] = (0.095, 0.078, HEAD_DROP)
    bends: float = 0.0

    @property
    def head(self):
        """Middle of the head."""
        ahead = self.bends * np.array([np.cos(self.facing), np.sin(self.facing)])
        return np.array([self.x + ahead[0], self.y + ahead[1], self.height - self.skull[2]])

    def solids(self):
        """Ellipsoids {x: |A (x - c)| <= 1}: pairs of c (3,) and A (3, 3)."""
        h = self.height
        upper = [
            ((self.bends, 0.0, h - self.skull[2]), self.skull),
            ((0.5 * self.bends - 0.01, 0.0, h - 0.24), (0.055, 0.055, 0.12)),
            ((-0.02, 0.0, h - 0.40), (0.11, 0.215, 0.12)),
            ((0.0, 0.0, h - 0.62), (0.12, 0.17, 0.34)),
            ((0.0, 0.23, h - 0.62), (0.05, 0.05, 0.32)),
            ((0.0, -0.23, h - 0.62), (0.05, 0.05, 0.32)),
        ]
        if self.sits:
            seat = h - 0.82
            legs = [((0.22, side, seat), (0.28, 0.08, 0.08)) for side in (0.1, -0.1)] + [
                ((0.45, side, seat / 2), (0.06, 0.06, seat / 2)) for side in (0.1, -0.1)
            ]
        else:
            legs = [((0.0, side, 0.24 * h), (0.09, 0.08, 0.26 * h)) for side in (0.1, -0.1)]
        cos, sin = np.cos(self.facing), np.sin(self.facing)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        place = np.array([self.x, self.y, 0.0])
        return [(place + turn @ np.array(middle), turn.T / np.array(axes)[:, None]) for middle, axes in upper + legs]


@dataclass(frozen=True, eq=False)
class Drawn:
    """A simulated person, with hair and a body of its own; `head` is the middle of the head."""

    head: np.ndarray
    facing: float
    sits: bool
    look: Look

    def solids(self):
        """See Person."""
        ahead = np.array([np.cos(self.facing), np.sin(self.facing)])
        aside = np.array([-ahead[1], ahead[0]])
        feet = self.head[:2] + 0.4 * self.sits * ahead
        legs = np.array([[*(feet + side * aside), 0.25] for side in (0.1, -0.1)])
        solids = stand(self.head, self.facing, self.facing, legs, self.look)
        return zip(solids.centres, solids.shapes)


@dataclass(frozen=True)
class Box:
    """From one corner to the other, metres."""

    low: Tuple[float, float, float]
    high: Tuple[float, float, float]


TABLE = Box((1.4, -0.8, 0.68), (1.9, 0.8, 0.74))


def pose_of(height=1.5, down=0.0, yaw=0.0, x=0.0, y=0.0):
    """level_from_camera."""
    return Pose(tilted(down, yaw), np.array([x, y, height]))


def depths_of(pose, people=(), boxes=(), wall=5.5, camera=None, noise=0.0, rng=None, reach=9.5):
    """(H, W) float32 depths that a camera at `pose` sees."""
    camera = camera or Ideal()
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    rays = (rays / rays[:, 2:]) @ pose.rotation.T
    origin = pose.translation
    with np.errstate(all="ignore"):
        depths = np.where(rays[:, 2] < 0, -origin[2] / rays[:, 2], np.inf)
        if wall is not None:
            depths = np.minimum(depths, np.where(rays[:, 0] > 0, (wall - origin[0]) / rays[:, 0], np.inf))
        for box in boxes:
            one, other = (np.array(box.low) - origin) / rays, (np.array(box.high) - origin) / rays
            first, last = np.minimum(one, other).max(axis=1), np.maximum(one, other).min(axis=1)
            depths = np.where((first < last) & (first > 0), np.minimum(depths, first), depths)
        for person in people:
            for centre, shape in person.solids():
                d, o = rays @ shape.T, shape @ (origin - centre)
                a, b, c = (d * d).sum(axis=1), d @ o, o @ o - 1.0
                hit = (-b - np.sqrt(b * b - a * c)) / a
                depths = np.where(hit > 0, np.fmin(depths, hit), depths)
    if noise:
        depths[np.isinf(depths)] = np.nan
        depths = depths + noise * depths**2 * rng.standard_normal(len(depths))
    depths = np.where((depths > 0.4) & (depths < reach), depths, np.nan)
    return depths.reshape(rows.shape).astype(np.float32)


def image_of(pose, people=(), boxes=(), camera=None, stamp_ns=10 * SECOND, **scene):
    """See depths_of."""
    camera = camera or Ideal()
    return DepthImage(stamp_ns, "depth", depths_of(pose, people, boxes, camera=camera, **scene), camera)


class Stand(TransformSource):
    """A robot that stands; the camera is where it was told, or where one wrongly believes."""

    def __init__(self, pose):
        self.pose = pose

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        return self.pose
