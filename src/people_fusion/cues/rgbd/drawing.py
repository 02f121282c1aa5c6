"""What the RGB-D cue made of a depth image, drawn into it and as a coloured cloud."""

from __future__ import annotations

from typing import NamedTuple, Tuple

import numpy as np

from people_fusion.core.depth_images import DepthImage
from people_fusion.cues.rgbd.floor import SURE_M, SURE_PER_M
from people_fusion.cues.rgbd.rgbd import DepthLook

PERSON, NO_PERSON, FLOOR = (80, 220, 60), (130, 130, 130), (200, 120, 60)  # blue, green, red
PEOPLE = ((60, 200, 80), (50, 140, 255), (220, 80, 200), (40, 220, 240), (230, 200, 60), (90, 90, 240))
RADIUS = 0.5  # metres around the middle of a head within which a person's points are
HEAD_BOX = (0.14, 0.03, -0.28)  # half width, upper and lower edge from the top of the head, metres
BODY_HALF_WIDTH = 0.3  # metres
FARTHEST = 8.0  # black in the picture, metres
TINT = 0.5  # of the floor
STRIDE = 2  # of the rows and columns that make a cloud
NOTHING, REST, IS_FLOOR = -3, -2, -1  # people from 0 on


class ColouredCloud(NamedTuple):
    """Points (N, 3) of the camera's frame, metres, and their colours (N, 3) blue, green, red, uint8."""

    points: np.ndarray
    colours: np.ndarray


def annotated(image: DepthImage, look: DepthLook) -> np.ndarray:
    """(H, W, 3) the image in colour, or its depths: the floor, each candidate with its confidence and height.

    Args:
        image: that the cue looked at.
        look: see RgbdCue.
    """
    import cv2  # 100 MB: not for those who see no images

    canvas = _picture(image)
    _, codes = _parts(image, look, STRIDE)
    height, width = image.depths.shape
    floor = cv2.resize((codes == IS_FLOOR).astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0
    canvas[floor] = ((1.0 - TINT) * canvas[floor] + TINT * np.array(FLOOR)).astype(np.uint8)
    heights = look.floor.heights(look.candidates.tops)
    for row in np.argsort(np.isin(np.arange(len(heights)), look.kept), kind="stable"):  # people over what is none
        is_person = row in look.kept
        colour = PERSON if is_person else NO_PERSON
        top = look.candidates.tops[row]
        corners = _box(image, look, top, HEAD_BOX)
        if not np.isfinite(corners).all():
            continue
        if is_person:
            body = _box(image, look, top, (BODY_HALF_WIDTH, HEAD_BOX[1], -float(heights[row])))
            _rectangle(canvas, body, colour, 1)
        _rectangle(canvas, corners, colour, 2 if is_person else 1)
        text = f"{look.confidences[row]:.2f}" + (f" {heights[row]:.2f} m" if is_person else "")
        place = (int(corners[0]), max(int(corners[1]) - 4, 10))
        cv2.putText(canvas, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)
    return canvas


def coloured_cloud(image: DepthImage, look: DepthLook, stride: int = STRIDE) -> ColouredCloud:
    """The points of every `stride`-th row and column: floor and people in colours of their own, the rest as seen."""
    points, codes = _parts(image, look, stride)
    colours = _picture(image)[::stride, ::stride].copy()
    colours[codes == IS_FLOOR] = FLOOR
    people = codes >= 0
    colours[people] = np.array(PEOPLE, dtype=np.uint8)[codes[people] % len(PEOPLE)]
    there = codes != NOTHING
    return ColouredCloud(points[there], colours[there])


def _picture(image: DepthImage) -> np.ndarray:
    """(H, W, 3) colour, or near depths bright and none black."""
    if image.colour is not None:
        return image.colour.copy()
    grey = np.nan_to_num(255.0 * np.clip(1.0 - image.depths / FARTHEST, 0.05, 1.0)).astype(np.uint8)
    return np.repeat(grey[:, :, None], 3, axis=2)


def _parts(image: DepthImage, look: DepthLook, stride: int) -> Tuple[np.ndarray, np.ndarray]:
    """Points (h, w, 3) of the camera's frame and of what they are (h, w)."""
    depths = image.depths[::stride, ::stride]
    height, width = image.depths.shape
    rows, columns = np.mgrid[0:height:stride, 0:width:stride]
    rays = image.camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    points = ((rays / rays[:, 2:]) * depths.reshape(-1, 1)).astype(np.float32)
    level = look.level_from_camera.apply(points)
    heights = look.floor.heights(level)
    with np.errstate(invalid="ignore"):
        codes = np.where(np.isfinite(depths.ravel()) & (depths.ravel() > 0.0), REST, NOTHING)
        near = SURE_M + SURE_PER_M * np.hypot(level[:, 0], level[:, 1])
        codes[(codes == REST) & (np.abs(heights) < near)] = IS_FLOOR
        for person, row in enumerate(look.kept):
            middle, top = look.candidates.middles[row], look.candidates.tops[row]
            around = np.hypot(level[:, 0] - middle[0], level[:, 1] - middle[1]) < RADIUS
            codes[(codes == REST) & around & (level[:, 2] < top[2] + HEAD_BOX[1])] = person
    return points.reshape(*depths.shape, 3), codes.reshape(depths.shape)


def _box(image: DepthImage, look: DepthLook, top: np.ndarray, extent: Tuple[float, float, float]) -> np.ndarray:
    """(4,) left, top, right and bottom of an upright rectangle beneath a top, square to the line of sight, pixels."""
    half_width, upper, lower = extent
    across = np.array([-top[1], top[0], 0.0]) / max(float(np.hypot(top[0], top[1])), 1e-6)
    corners = [top + side * half_width * across + [0.0, 0.0, end] for side in (-1.0, 1.0) for end in (upper, lower)]
    pixels = image.camera.project(
        (np.array(corners) - look.level_from_camera.translation) @ look.level_from_camera.rotation
    )
    return np.concatenate([pixels.min(axis=0), pixels.max(axis=0)])


def _rectangle(canvas: np.ndarray, corners: np.ndarray, colour: Tuple[int, int, int], width: int) -> None:
    import cv2

    if not np.isfinite(corners).all():
        return
    limit = 4 * np.array([canvas.shape[1], canvas.shape[0]] * 2)
    left, top, right, bottom = (int(edge) for edge in np.clip(corners, -limit, limit))
    cv2.rectangle(canvas, (left, top), (right, bottom), colour, width)
