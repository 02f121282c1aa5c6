"""Pictures of solids by casting a ray through every pixel, so that any camera model is right by itself."""

from __future__ import annotations

from typing import List, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.core.poses import Pose
from people_fusion.simulation.rendering_people import HAIR, SHIRT, Look, Solids, face_factors, hairy
from people_fusion.simulation.rendering_room import Backdrop

FINE = 2  # rays per pixel, across and down ...
LARGE = 70  # ... of people whose heads have fewer rows
CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
TO_LAMP = np.array([0.25, 0.35, 0.9]) / np.linalg.norm([0.25, 0.35, 0.9])  # in the world
AMBIENT, FROM_LAMP, FROM_ABOVE, FROM_CAMERA = 0.52, 0.26, 0.12, 0.26
TRUNK = np.array([0.15, 0.27, 0.6])  # half axes of what cloth hangs on, metres
CHUNK = 1 << 16  # pixels whose rays are found at once
PAIRS = np.triu_indices(3)
LEAST_FLAT = 1e-6  # of rays that go straight up or down


class Figure(NamedTuple):
    """One person to be painted.

    Attributes:
        solids: in the world.
        look: colours and face.
        head_from_world: of the head.
        body: (3, 3) rotation of the body in the world.
        light: factor of brightness where the person is.
    """

    solids: Solids
    look: Look
    head_from_world: Pose
    body: np.ndarray
    light: float


class Patch(NamedTuple):
    """One person on some pixels.

    Attributes:
        rows, columns: (h,), (w,) of the image.
        colours: (h, w, 3) float32, times the cover.
        cover: (h, w) share of the pixel, without what walls hide.
        head: (h, w) share of the pixel on which the head would be seen if nothing hid it.
        free_head: (h, w) share of the pixel on which the head is seen if nobody hides it.
        ranges: (h, w) along one ray of the pixel, infinite where it passes, metres.
    """

    rows: np.ndarray
    columns: np.ndarray
    colours: np.ndarray
    cover: np.ndarray
    head: np.ndarray
    free_head: np.ndarray
    ranges: np.ndarray


class Painting(NamedTuple):
    """A picture of people before a backdrop.

    Attributes:
        colours: (H, W, 3) float32, blue, green, red, 0 to 255.
        shares: (N,) of that part of each head that is in the image what nothing hides.
        ranges: (H, W) from the camera to what is seen, along one ray of each pixel, metres.
    """

    colours: np.ndarray
    shares: np.ndarray
    ranges: np.ndarray


class Painter:
    """Paints people over a backdrop.

    Args:
        camera: the model.
        level_from_camera: (3, 3) its rotation on the robot.
    """

    def __init__(self, camera: Camera, level_from_camera: np.ndarray) -> None:
        self._camera = camera
        self._grids = {fine: _Grid(camera, level_from_camera, fine) for fine in (1, FINE)}

    def paint(self, backdrop: Backdrop, figures: Sequence[Figure], camera_from_world: Pose) -> Painting:
        """What a camera sees.

        Args:
            backdrop: the room.
            figures: N of them, in any order.
            camera_from_world: where the camera is.
        """
        picture, flat = backdrop.colours.copy(), self._grids[1].flat
        ranges = backdrop.reaches / np.maximum(flat, LEAST_FLAT)
        free = np.ones(picture.shape[:2], dtype=np.float32)  # of each pixel, of all who are nearer
        shares = np.zeros(len(figures))
        distances = [np.linalg.norm(camera_from_world.apply(each.solids.centres[0])) for each in figures]
        patches: List[Patch] = []
        for number in np.argsort(distances, kind="stable"):
            patch = self._patch(figures[number], camera_from_world, backdrop)
            if patch is None:
                continue
            place = np.ix_(patch.rows, patch.columns)
            shares[number] = (patch.free_head * free[place]).sum() / max(float(patch.head.sum()), 1e-6)
            free[place] *= 1.0 - patch.cover
            patches.append(patch)
        for patch in reversed(patches):
            place = np.ix_(patch.rows, patch.columns)
            picture[place] = picture[place] * (1.0 - patch.cover[..., None]) + patch.colours
            ranges[place] = np.minimum(ranges[place], patch.ranges)
        return Painting(picture, shares, ranges)

    def _patch(self, figure: Figure, camera_from_world: Pose, backdrop: Backdrop) -> Optional[Patch]:
        """One person, or None where the camera sees nothing of it."""
        turn = camera_from_world.rotation
        centres, shapes = camera_from_world.apply(figure.solids.centres), figure.solids.shapes @ turn.T
        bounds, is_seen = self._bounds(centres, shapes)
        if not is_seen.any():
            return None
        top, left = bounds[is_seen, :2].min(axis=0)
        bottom, right = bounds[is_seen, 2:].max(axis=0)
        fine = FINE if bounds[0, 2] - bounds[0, 0] < LARGE else 1
        grid = self._grids[fine]
        columns = np.arange(left, right) % self._camera.width
        rays, flat, products = grid.piece(slice(top, bottom), left, right)
        depth, owner = np.full(flat.shape, np.inf, dtype=np.float32), np.full(flat.shape, -1, dtype=np.int8)
        for number in np.flatnonzero(is_seen):
            low, high = fine * (bounds[number, :2] - [top, left]), fine * (bounds[number, 2:] - [top, left])
            part = (slice(low[0], high[0]), slice(low[1], high[1]))
            _cast(
                number,
                centres[number],
                shapes[number],
                rays[part],
                products[part],
                depth[part],
                owner[part],
                figure,
                turn,
            )
        hit = owner >= 0
        if not hit.any():
            return None
        owners = owner[hit]
        colours = np.zeros((*hit.shape, 3), dtype=np.float32)
        colours[hit] = _shaded(figure, owners, rays[hit] * depth[hit][:, None], centres, shapes, turn)
        head = np.zeros(hit.shape, dtype=bool)
        head[hit] = figure.solids.on_head[owners]
        walls = backdrop.distances[top:bottom][:, columns].repeat(fine, axis=0).repeat(fine, axis=1)
        covers = hit & (np.where(hit, depth, np.float32(0.0)) * flat < walls)
        colours[~covers] = 0.0
        colours, cover, of_head, free = (_binned(each, fine) for each in (colours, covers, head, head & covers))
        ranges = np.where(covers, depth, np.float32(np.inf))[::fine, ::fine]
        return Patch(np.arange(top, bottom), columns, colours, cover, of_head, free, ranges)

    def _bounds(self, centres: np.ndarray, shapes: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """(K, 4) top, left, bottom, right in pixels that hold each ellipsoid, (K,) whether any of it is in the image;
        left and right go on beyond the seam of a panorama."""
        camera = self._camera
        corners = centres[:, None] + CORNERS @ np.swapaxes(np.linalg.inv(shapes), 1, 2)
        pixels = camera.project(corners.reshape(-1, 3)).reshape(len(centres), len(CORNERS), 2)
        is_behind = ~np.isfinite(camera.project(centres)).all(axis=1)
        unknown = ~np.isfinite(pixels).all(axis=(1, 2))
        if camera.wraps:
            pixels[..., 0] -= np.round((pixels[..., 0] - pixels[0, 0, 0]) / camera.width) * camera.width
        low, high = np.floor(pixels.min(axis=1)), np.ceil(pixels.max(axis=1)) + 1.0
        low[unknown], high[unknown] = 0.0, [camera.width, camera.height]
        turns = camera.width // 2 if camera.wraps else 0
        low, high = (np.clip(ends, [-turns, 0], [camera.width + turns, camera.height]) for ends in (low, high))
        bounds = np.column_stack([low[:, ::-1], high[:, ::-1]]).astype(int)
        return bounds, (high > low).all(axis=1) & ~(unknown & is_behind)


class _Grid:
    """Rays of a camera, so many a pixel across and down.

    Attributes:
        rays: (H, W, 3) unit vectors, zero where the camera sees nothing.
        flat: (H, W) their length along the floor.
        products: (H, W, 6) of their components, of each with itself and with those after it.
    """

    def __init__(self, camera: Camera, level_from_camera: np.ndarray, fine: int) -> None:
        self._fine = fine
        rows, columns = (np.arange(fine * size) / fine + 0.5 / fine - 0.5 for size in (camera.height, camera.width))
        rays = np.empty((len(rows) * len(columns), 3), dtype=np.float32)
        for first in range(0, len(rays), CHUNK):
            numbers = np.arange(first, min(first + CHUNK, len(rays)))
            pixels = np.column_stack([columns[numbers % len(columns)], rows[numbers // len(columns)]])
            rays[numbers] = np.nan_to_num(camera.rays(pixels))
        self.rays = rays.reshape(len(rows), len(columns), 3)
        level = self.rays @ _single(level_from_camera.T)
        self.flat = np.hypot(level[..., 0], level[..., 1])
        self.products = self.rays[..., PAIRS[0]] * self.rays[..., PAIRS[1]]

    def piece(self, rows: slice, left: int, right: int) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rays, flat and products of some of the image's rows and columns, also beyond the seam."""
        fine, width = self._fine, self.flat.shape[1]
        tall = slice(fine * rows.start, fine * rows.stop)
        if left >= 0 and fine * right <= width:
            wide = slice(fine * left, fine * right)
            return self.rays[tall, wide], self.flat[tall, wide], self.products[tall, wide]
        columns = np.arange(fine * left, fine * right) % width
        return self.rays[tall][:, columns], self.flat[tall][:, columns], self.products[tall][:, columns]


def _cast(
    number: int,
    centre: np.ndarray,
    shape: np.ndarray,
    rays: np.ndarray,
    products: np.ndarray,
    depth: np.ndarray,
    owner: np.ndarray,
    figure: Figure,
    turn: np.ndarray,
) -> None:
    """Let one ellipsoid cover what is farther away: |A (t r - c)| = 1 is a t^2 - 2 b t + e = 0."""
    square = shape.T @ shape
    across = square @ centre
    rest = centre @ across - 1.0
    form = np.outer(across, across) - rest * square  # r form r = b^2 - a e
    inside = products @ _single(form[PAIRS] * np.where(PAIRS[0] == PAIRS[1], 1.0, 2.0))
    found = np.nonzero(inside > 0.0)
    hits = rays[found]
    b = hits @ _single(across)
    a = ((hits @ _single(shape.T)) ** 2).sum(axis=1)
    distances = (b - np.sqrt(inside[found])) / a
    nearer = (b > 0.0) & (distances < depth[found])
    if figure.solids.materials[number] == HAIR:
        points = _in_head(hits * distances[:, None], figure, turn, centre, number)
        nearer &= hairy(points / _single(figure.look.scale))
    rows, columns = found[0][nearer], found[1][nearer]
    depth[rows, columns], owner[rows, columns] = distances[nearer], number


def _in_head(points: np.ndarray, figure: Figure, turn: np.ndarray, centre: np.ndarray, number: int) -> np.ndarray:
    """Points of the camera's frame in the head's; `centre` is that of solid `number` in the camera's."""
    middle = figure.head_from_world.apply(figure.solids.centres[number])
    return np.asarray((points - _single(centre)) @ _single(turn @ figure.head_from_world.rotation.T) + _single(middle))


def _shaded(
    figure: Figure, owner: np.ndarray, points: np.ndarray, centres: np.ndarray, shapes: np.ndarray, turn: np.ndarray
) -> np.ndarray:
    """(P, 3) colours of points (P, 3) of the camera's frame on the solids `owner` (P,)."""
    solids, look = figure.solids, figure.look
    materials = solids.materials[owner]
    squares = _single(np.swapaxes(shapes, 1, 2) @ shapes)[owner]
    normals = _unit((squares @ (points - _single(centres)[owner])[:, :, None])[:, :, 0])
    shirt = materials == SHIRT
    # Cloth is smooth over what is below it.
    body = turn @ figure.body
    trunk = _single(body / TRUNK**2 @ body.T)
    around = _unit((points[shirt] - _single(centres[0] - 0.45 * turn[:, 2])) @ trunk)
    normals[shirt] = _unit(0.4 * normals[shirt] + 0.6 * around)
    light = AMBIENT + FROM_LAMP * np.maximum(normals @ _single(turn @ TO_LAMP), 0.0)
    light += FROM_ABOVE * (normals @ _single(turn[:, 2]))
    light += FROM_CAMERA * np.maximum(-(normals * _unit(points)).sum(axis=1), 0.0)
    colours = _single(look.colours)[materials]
    face = solids.is_face[owner]
    colours[face] *= face_factors(_in_head(points[face], figure, turn, centres[0], 0), look)
    if look.stripes:
        heights = (points[shirt] - _single(centres[0])) @ _single(turn[:, 2])
        colours[shirt] *= (1.0 + look.stripes * np.sign(np.sin(110.0 * heights)))[:, None]
    return np.asarray(colours * (light * np.float32(figure.light))[:, None])


def _single(values: np.ndarray) -> np.ndarray:
    return np.asarray(values, dtype=np.float32)


def _unit(vectors: np.ndarray) -> np.ndarray:
    """(N, 3) of length 1."""
    return np.asarray(vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)[:, None])


def _binned(values: np.ndarray, fine: int) -> np.ndarray:
    """Means of fine x fine, float32."""
    total = np.zeros((values.shape[0] // fine, values.shape[1] // fine, *values.shape[2:]), dtype=np.float32)
    for row in range(fine):
        for column in range(fine):
            total += values[row::fine, column::fine]
    return total / np.float32(fine * fine)
