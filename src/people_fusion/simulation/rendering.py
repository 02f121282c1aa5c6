"""Pictures of solids by casting a ray through every pixel, so that any camera model is right by itself."""

from __future__ import annotations

from typing import List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.core.poses import Pose
from people_fusion.simulation.rendering_people import EAR, HAIR, SHIRT, SKIN, Look, Solids, face_factors, hairy
from people_fusion.simulation.rendering_room import Backdrop

FINE = 2  # rays per pixel, across and down
CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
TO_LAMP = np.array([0.25, 0.35, 0.9]) / np.linalg.norm([0.25, 0.35, 0.9])  # in the world
AMBIENT, FROM_LAMP, FROM_ABOVE, FROM_CAMERA = 0.52, 0.26, 0.12, 0.26
CHUNK = 1 << 16  # pixels whose rays are found at once


class Figure(NamedTuple):
    """One person to be painted.

    Attributes:
        solids: in the world.
        look: colours and face.
        head_from_world: of the head.
        light: factor of brightness where the person is.
    """

    solids: Solids
    look: Look
    head_from_world: Pose
    light: float


class Patch(NamedTuple):
    """One person on some pixels.

    Attributes:
        rows, columns: (h,), (w,) of the image; columns go on beyond the seam of a panorama.
        colours: (h, w, 3) float32, times the cover.
        cover: (h, w) share of the pixel, without what walls hide.
        head: (h, w) share of the pixel on which the head would be seen if nothing hid it.
    """

    rows: np.ndarray
    columns: np.ndarray
    colours: np.ndarray
    cover: np.ndarray
    head: np.ndarray


class Painter:
    """Paints people over a backdrop.

    Args:
        camera: the model.
        level_from_camera: (3, 3) its rotation on the robot.
    """

    def __init__(self, camera: Camera, level_from_camera: np.ndarray) -> None:
        self._camera = camera
        rays = _fine_rays(camera)
        level = rays @ np.float32(level_from_camera.T)
        self._flat = np.hypot(level[..., 0], level[..., 1])
        self._rays = rays

    def paint(
        self, backdrop: Backdrop, figures: Sequence[Figure], camera_from_world: Pose
    ) -> Tuple[np.ndarray, np.ndarray]:
        """(H, W, 3) float32 picture, and (N,) share of each head in the image that nothing hides.

        Args:
            backdrop: the room.
            figures: N of them, in any order.
            camera_from_world: where the camera is.
        """
        picture = backdrop.colours.copy()
        # What is left of each pixel by all who are nearer than those painted so far.
        free = np.ones(picture.shape[:2], dtype=np.float32)
        shares = np.zeros(len(figures))
        distances = [np.linalg.norm(camera_from_world.apply(each.solids.centres[0])) for each in figures]
        patches: List[Patch] = []
        for number in np.argsort(distances, kind="stable"):
            patch = self._patch(figures[number], camera_from_world, backdrop)
            if patch is None:
                continue
            place = np.ix_(patch.rows, patch.columns % self._camera.width)
            seen = patch.head * free[place]
            # A pixel's head and its hiding wall are told apart by the patch's own cover.
            shares[number] = (seen * (patch.cover > 0.5)).sum() / max(float(patch.head.sum()), 1e-6)
            free[place] *= 1.0 - patch.cover
            patches.append(patch)
        for patch in reversed(patches):
            place = np.ix_(patch.rows, patch.columns % self._camera.width)
            picture[place] = picture[place] * (1.0 - patch.cover[..., None]) + patch.colours
        return picture, shares

    def _patch(self, figure: Figure, camera_from_world: Pose, backdrop: Backdrop) -> Optional[Patch]:
        """One person, or None where the camera sees nothing of it."""
        solids, turn = figure.solids, camera_from_world.rotation
        centres = camera_from_world.apply(solids.centres)
        shapes = solids.shapes @ turn.T
        bounds, is_seen = self._bounds(centres, shapes)
        if not is_seen.any():
            return None
        top, left = bounds[is_seen, :2].min(axis=0)
        bottom, right = bounds[is_seen, 2:].max(axis=0)
        shape = (FINE * (bottom - top), FINE * (right - left))
        depth, owner = np.full(shape, np.inf, dtype=np.float32), np.full(shape, -1, dtype=np.int8)
        for number in np.flatnonzero(is_seen):
            t, l, b, r = bounds[number]
            rows, columns = slice(FINE * (t - top), FINE * (b - top)), slice(FINE * (l - left), FINE * (r - left))
            looks = self._looks(t, l, b, r)
            self._cast(figure, number, centres[number], shapes[number], turn, looks, depth[rows, columns],
                       owner[rows, columns])
        hit = owner >= 0
        if not hit.any():
            return None
        looks = self._looks(top, left, bottom, right)
        colours = np.zeros((*shape, 3), dtype=np.float32)
        points = looks[hit] * depth[hit][:, None]
        colours[hit] = _shaded(figure, owner[hit], points, centres, shapes, turn, camera_from_world)
        head = solids.is_head[owner] | np.isin(solids.materials[owner], [EAR])
        head |= (solids.materials[owner] == HAIR) & (owner < 7)
        head &= hit
        flat = self._flat[FINE * top : FINE * bottom][:, self._fine_columns(left, right)]
        walls = backdrop.distances[top:bottom][:, np.arange(left, right) % self._camera.width]
        covers = hit & (np.where(hit, depth, 0.0) * flat < np.repeat(np.repeat(walls, FINE, 0), FINE, 1))
        colours[~covers] = 0.0
        return Patch(
            np.arange(top, bottom), np.arange(left, right), _binned(colours), _binned(covers), _binned(head)
        )

    def _cast(
        self,
        figure: Figure,
        number: int,
        centre: np.ndarray,
        shape: np.ndarray,
        turn: np.ndarray,
        looks: np.ndarray,
        depth: np.ndarray,
        owner: np.ndarray,
    ) -> None:
        """Let one ellipsoid cover what is farther away."""
        along = looks @ np.float32(shape.T)
        start = np.float32(-shape @ centre)
        a, b = np.einsum("ijk,ijk->ij", along, along), along @ start
        inside = b * b - a * np.float32(start @ start - 1.0)
        found = np.flatnonzero((inside > 0.0) & (b < 0.0))
        if not len(found):
            return
        distances = (-b.ravel()[found] - np.sqrt(inside.ravel()[found])) / a.ravel()[found]
        if figure.solids.materials[number] == HAIR:
            world = looks.reshape(-1, 3)[found] * distances[:, None]
            keep = hairy(_in_head(world, figure, turn, centre, number))
            found, distances = found[keep], distances[keep]
        nearer = distances < depth.ravel()[found]
        rows, columns = np.unravel_index(found[nearer], depth.shape)
        depth[rows, columns], owner[rows, columns] = distances[nearer], number

    def _bounds(self, centres: np.ndarray, shapes: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """(K, 4) top, left, bottom, right in pixels that hold each ellipsoid, (K,) whether any is in the image."""
        camera = self._camera
        corners = centres[:, None] + CORNERS @ np.swapaxes(np.linalg.inv(shapes), 1, 2)
        pixels = camera.project(corners.reshape(-1, 3)).reshape(len(centres), len(CORNERS), 2)
        middles = camera.project(centres)
        if camera.wraps:
            base = middles[0, 0]
            pixels[..., 0] -= np.round((pixels[..., 0] - base) / camera.width) * camera.width
        unknown = ~np.isfinite(pixels).all(axis=2).all(axis=1)
        low, high = np.floor(pixels.min(axis=1)), np.ceil(pixels.max(axis=1)) + 1.0
        low[unknown], high[unknown] = 0.0, [camera.width, camera.height]
        limits = (-camera.width // 2, camera.width + camera.width // 2) if camera.wraps else (0, camera.width)
        left, right = np.clip(low[:, 0], *limits), np.clip(high[:, 0], *limits)
        top, bottom = np.clip(low[:, 1], 0, camera.height), np.clip(high[:, 1], 0, camera.height)
        bounds = np.column_stack([top, left, bottom, right]).astype(int)
        behind = unknown & ~np.isfinite(middles).all(axis=1)
        return bounds, (bounds[:, 2] > bounds[:, 0]) & (bounds[:, 3] > bounds[:, 1]) & ~behind

    def _looks(self, top: int, left: int, bottom: int, right: int) -> np.ndarray:
        return np.asarray(self._rays[FINE * top : FINE * bottom][:, self._fine_columns(left, right)])

    def _fine_columns(self, left: int, right: int) -> np.ndarray:
        return np.arange(FINE * left, FINE * right) % (FINE * self._camera.width)


def _in_head(
    points: np.ndarray, figure: Figure, turn: np.ndarray, centre: np.ndarray, number: int
) -> np.ndarray:
    """Points of the camera's frame in the head's; an ellipsoid's centre is known in both."""
    world = (points - np.float32(centre)) @ np.float32(turn)
    return np.asarray(
        world @ np.float32(figure.head_from_world.rotation.T)
        + np.float32(figure.head_from_world.apply(figure.solids.centres[number]))
    )


def _shaded(
    figure: Figure,
    owner: np.ndarray,
    points: np.ndarray,
    centres: np.ndarray,
    shapes: np.ndarray,
    turn: np.ndarray,
    camera_from_world: Pose,
) -> np.ndarray:
    """(P, 3) colours of points (P, 3) of the camera's frame on the solids `owner` (P,)."""
    solids, look = figure.solids, figure.look
    squares = np.float32(np.swapaxes(shapes, 1, 2) @ shapes)
    normals = np.einsum("pij,pj->pi", squares[owner], points - np.float32(centres)[owner])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    lamp = np.float32(turn @ TO_LAMP)
    up = np.float32(turn[:, 2])
    to_camera = -np.einsum("pi,pi->p", normals, points) / np.linalg.norm(points, axis=1)
    light = AMBIENT + FROM_LAMP * np.maximum(normals @ lamp, 0.0) + FROM_ABOVE * (normals @ up)
    light += FROM_CAMERA * np.maximum(to_camera, 0.0)
    materials = solids.materials[owner]
    colours = np.float32(look.colours)[materials]
    skin = (materials == SKIN) & (owner < 3)
    if skin.any():
        colours[skin] *= face_factors(_in_head(points[skin], figure, turn, centres[0], 0), look)
    if look.stripes:
        shirt = materials == SHIRT
        heights = (points[shirt] - np.float32(centres[0])) @ up
        colours[shirt] *= (1.0 + look.stripes * np.sign(np.sin(110.0 * heights)))[:, None]
    return np.asarray(colours * (light * np.float32(figure.light))[:, None])


def _fine_rays(camera: Camera) -> np.ndarray:
    """(FINE * H, FINE * W, 3) float32; zero where the camera sees nothing."""
    offset = 0.5 / FINE - 0.5
    rows = np.arange(FINE * camera.height) / FINE + offset
    columns = np.arange(FINE * camera.width) / FINE + offset
    rays = np.empty((len(rows) * len(columns), 3), dtype=np.float32)
    for first in range(0, len(rays), CHUNK):
        numbers = np.arange(first, min(first + CHUNK, len(rays)))
        pixels = np.column_stack([columns[numbers % len(columns)], rows[numbers // len(columns)]])
        rays[numbers] = np.nan_to_num(camera.rays(pixels))
    return rays.reshape(len(rows), len(columns), 3)


def _binned(values: np.ndarray) -> np.ndarray:
    """Means of FINE x FINE."""
    total = values[0::FINE, 0::FINE].astype(np.float32)
    for row in range(FINE):
        for column in range(FINE):
            if row or column:
                total += values[row::FINE, column::FINE]
    return total / np.float32(FINE * FINE)
