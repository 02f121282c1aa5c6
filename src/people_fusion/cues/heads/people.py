"""From boxes in an image to heads in space, and back: where in the image heads may be, and how large.

Everything here is seen from the camera with the axes of a level frame: z up, the floor at a known depth below. A part
of a person stands upright: seen at the horizontal distance d, its top and bottom at elevations a and b, it is
d (tan a - tan b) high.
"""

from __future__ import annotations

from typing import NamedTuple, Optional, Tuple

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.cues.heads.boxes import BoxConfig
from people_fusion.cues.heads.detector import Search

COLUMNS = 9  # across the image, at which the rows of a search are taken
SLACK = 2.0  # standard deviations
SEARCHED = 0.9  # confidence of the finds whose sizes are searched


class Heads(NamedTuple):
    """Heads (N,) seen from the camera, in level axes.

    Attributes:
        positions: (N, 3) metres; NaN where a box cannot be what the detector looks for.
        covariances: (N, 3, 3).
    """

    positions: np.ndarray
    covariances: np.ndarray


def heads_of_boxes(
    corners: np.ndarray,
    camera: Camera,
    level_from_camera: np.ndarray,
    box: BoxConfig,
    confidences: Optional[np.ndarray] = None,
) -> Heads:
    """Middles of the heads whose parts are in boxes (N, 4).

    The distance follows from the box's height and that of what it holds, and is as uncertain in proportion, wide along
    the ray (Volkhardt 2013, III-B). Errors of a box grow with it, so that sideways and up they are metres. Boxes of
    finds in doubt are worse ones: too large, too small or beside what they should hold (docs/cameras.md).

    Args:
        corners: (N, 4) as Boxes.corners.
        camera: that took the image.
        level_from_camera: (3, 3) rotation.
        box: what the boxes hold.
        confidences: (N,) as Boxes.confidences; None: all sure.
    """
    columns = 0.5 * (corners[:, 0] + corners[:, 2]) - 0.5  # corners are edges of pixels, rays go through their middles
    rows = np.stack([corners[:, 1], corners[:, 3], 0.5 * (corners[:, 1] + corners[:, 3])]) - 0.5
    rays = np.stack([camera.rays(np.column_stack([columns, row])) for row in rows]) @ level_from_camera.T
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = np.hypot(rays[..., 0], rays[..., 1])
        top, bottom = rays[:2, :, 2] / flat[:2]
        distances = box.height / (top - bottom)
        distances[~((top > bottom) & np.isfinite(distances))] = np.nan
        directions = rays[2, :, :2] / flat[2, :, None]
    middle = 0.5 * (top + bottom)
    # Straight ahead one metre, one metre to the side, one metre up.
    ahead = np.column_stack([directions, middle])
    aside = np.column_stack([-directions[:, 1], directions[:, 0], np.zeros(len(corners))])
    positions = distances[:, None] * ahead + [0.0, 0.0, box.head_above]
    along_std = distances * box.height_std / box.height
    covariances = _outer(along_std[:, None] * ahead) + box.across_std**2 * _outer(aside)
    covariances[:, 2, 2] += box.head_above_std**2
    if confidences is not None:
        covariances *= box.widths(confidences)[:, None, None] ** 2
    return Heads(positions, covariances)


def ground_search(
    camera: Camera,
    level_from_camera: np.ndarray,
    camera_height: float,
    box: BoxConfig,
    head_heights: Tuple[float, float],
    ranges: Tuple[float, float],
    step: float = 2.0**0.5,
) -> Search:
    """Where the boxes of people may be who stand or sit on the floor, for one shell of distances after the other.

    Args:
        camera, level_from_camera, box: see heads_of_boxes.
        camera_height: over the floor, metres.
        head_heights: least and largest height of heads over the floor, metres.
        ranges: least and largest horizontal distance, metres.
        step: ratio of a shell's distances.
    """
    count = max(int(np.ceil(np.log(ranges[1] / ranges[0]) / np.log(step))), 1)
    edges = np.geomspace(*ranges, count + 1)
    columns = np.linspace(0.0, camera.width - 1.0, COLUMNS)
    # A column's direction is taken at the rows' middle: a camera that is rolled by much sees more than is searched.
    rays = camera.rays(np.column_stack([columns, np.full(COLUMNS, 0.5 * (camera.height - 1))])) @ level_from_camera.T
    with np.errstate(divide="ignore", invalid="ignore"):
        directions = rays[:, :2] / np.hypot(rays[:, 0], rays[:, 1])[:, None]
    directions = directions[np.isfinite(directions).all(axis=1)]
    slack = SLACK * box.head_above_std
    middles = np.array([head_heights[0] - box.head_above - slack, head_heights[1] - box.head_above + slack])
    corners, heights = [], []
    for near, far in zip(edges[:-1], edges[1:]):
        points, spans = _stacks(directions, (near, far), middles - camera_height, box.height)
        rows = camera.project(points @ level_from_camera)[:, 1]
        tall = np.abs(np.diff(camera.project(spans @ level_from_camera)[:, 1].reshape(-1, 2), axis=1))
        if not (np.isfinite(rows).any() and np.isfinite(tall).any()):
            continue
        low, high = np.nanmin(rows), np.nanmax(rows)
        if high < 0.0 or low > camera.height - 1.0:
            continue
        spread = _spread(box)
        corners.append([0.0, max(low, 0.0), float(camera.width), min(high, float(camera.height))])
        heights.append([float(np.nanmin(tall)) / spread, float(np.nanmax(tall)) * spread])
    return Search(np.array(corners).reshape(-1, 4), np.array(heights).reshape(-1, 2))


def search_around(
    heads: np.ndarray, covariances: np.ndarray, camera: Camera, level_from_camera: np.ndarray, box: BoxConfig
) -> Search:
    """Where the boxes of people are whose heads (P, 3) with covariances (P, 3, 3) are believed to be, as `Heads` has
    them."""
    spread = _spread(box)
    half = 0.5 * box.height
    middles = heads - [0.0, 0.0, box.head_above]
    pixels, top, bottom = (
        camera.project((middles + [0.0, 0.0, up]) @ level_from_camera) for up in (0.0, half, -half)
    )
    flat = np.hypot(heads[:, 0], heads[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        tall = bottom[:, 1] - top[:, 1]
        stds = np.sqrt(np.maximum(np.linalg.eigvalsh(covariances)[:, -1], 0.0))
        reach = SLACK * np.hypot(stds, np.hypot(box.across_std, box.head_above_std)) * tall / box.height
        nearer = np.clip(1.0 + SLACK * stds / np.maximum(flat, 1e-6), 1.0, 4.0)
    known = np.isfinite(pixels).all(axis=1) & np.isfinite(tall) & (tall > 0.0)
    corners = np.column_stack([pixels - reach[:, None], pixels + reach[:, None]])[known]
    heights = np.column_stack([tall / (spread * nearer), tall * spread * nearer])[known]
    inside = (corners[:, 3] > 0.0) & (corners[:, 1] < camera.height)
    if not camera.wraps:
        inside &= (corners[:, 2] > 0.0) & (corners[:, 0] < camera.width)
    return Search(corners[inside], heights[inside])


def _spread(box: BoxConfig) -> float:
    """By what factor boxes of one distance may be higher or lower than usual."""
    return 1.0 + SLACK * float(box.widths(np.array(SEARCHED))) * box.height_std / box.height


def _stacks(
    directions: np.ndarray, distances: Tuple[float, float], heights: np.ndarray, span: float
) -> Tuple[np.ndarray, np.ndarray]:
    """Points (D * 4, 3) at both distances and both heights in each direction; top and bottom of what is `span` high
    there (D * 4 * 2, 3)."""
    points = np.array(
        [[*(distance * direction), height] for direction in directions for distance in distances for height in heights]
    ).reshape(-1, 3)
    ends = np.array([[0.0, 0.0, 0.5 * span], [0.0, 0.0, -0.5 * span]])
    return points, (points[:, None] + ends).reshape(-1, 3)


def _outer(vectors: np.ndarray) -> np.ndarray:
    """(N, 3, 3) of (N, 3)."""
    return vectors[:, :, None] * vectors[:, None, :]
