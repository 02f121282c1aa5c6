"""How a simulated room looks: floor, walls with pictures and skirting, ceiling with lamps."""

from __future__ import annotations

from typing import NamedTuple, Optional, Tuple

import numpy as np

from people_fusion.core.cameras import Camera
from people_fusion.simulation import planar, rays
from people_fusion.simulation.plan import CEILING_M, Plan

PICTURES_M, SKIRTING_M = (1.25, 1.95), 0.09
PANEL_M, TILE_M, LAMP_M = 1.6, 0.5, 1.8
FAR_M = 60.0  # where beams end
THIN_M = 0.05  # radius below which circles are legs of furniture, which is not painted
TEXTURE = 512  # texels, a centimetre each
CHANCES = 97  # values of the table that panels take theirs from


class Backdrop(NamedTuple):
    """What is behind the people.

    Attributes:
        colours: (H, W, 3) float32, blue, green, red, 0 to 255.
        distances: (H, W) along the floor to what hides people, metres.
        reaches: (H, W) along the floor to what is seen, floor and ceiling, too, metres.
    """

    colours: np.ndarray
    distances: np.ndarray
    reaches: np.ndarray


class _Surfaces(NamedTuple):
    """Segments (S, 2, 2) and circles, (C, 2) and (C,), metres, and (S + C,) the numbers of their colours."""

    segments: np.ndarray
    centres: np.ndarray
    radii: np.ndarray
    numbers: np.ndarray


class Light:
    """Brightness over the floor: one side is nearer to the windows."""

    def __init__(self, strength: float, rng: np.random.Generator) -> None:
        self._gradient = strength * planar.direction(np.array(rng.uniform(-np.pi, np.pi)))

    def at(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Factor of brightness at places."""
        return np.asarray(1.0 + np.tanh(self._gradient[0] * x + self._gradient[1] * y))


class RoomPainter:
    """Paints a plan as a camera sees it that moves over the floor.

    Args:
        plan: what stands in the room.
        camera: the model.
        level_from_camera: (3, 3) its rotation on the robot.
        height: of the camera over the floor, metres.
        light: of the room.
        rng: of the walls' colours and pictures, the same for all cameras.
    """

    def __init__(
        self,
        plan: Plan,
        camera: Camera,
        level_from_camera: np.ndarray,
        height: float,
        light: Light,
        rng: np.random.Generator,
    ) -> None:
        self._height, self._light = height, light
        columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        looks = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float)) @ level_from_camera.T
        looks = np.where(np.isfinite(looks), looks, 0.0)
        flat = np.maximum(np.hypot(looks[:, 0], looks[:, 1]), 1e-6)
        shape = (camera.height, camera.width)
        self._slopes = (looks[:, 2] / flat).astype(np.float32).reshape(shape)
        self._directions = (looks[:, :2] / flat[:, None]).astype(np.float32).reshape(*shape, 2)
        self._beams = 4 * camera.width  # half a pixel or finer at the usual fields of view
        azimuths = np.arctan2(looks[:, 1], looks[:, 0]).reshape(shape)
        self._beam_of_pixel = np.round((azimuths + np.pi) * (self._beams / (2.0 * np.pi))).astype(int) % self._beams
        self._used = np.unique(self._beam_of_pixel)
        surfaces = len(plan.segments) + len(plan.radii) + 1
        colours = rng.uniform(105.0, 225.0, (surfaces, 1)) * rng.uniform(0.85, 1.0, (surfaces, 3))
        low = [thing.segments for thing in plan.low], [thing.circles for thing in plan.low]
        tall_segments = np.setdiff1d(np.arange(len(plan.segments)), np.concatenate([[], *low[0]]))
        tall_circles = np.setdiff1d(np.flatnonzero(plan.radii >= THIN_M), np.concatenate([[], *low[1]]))
        self._tall = _of_plan(plan, tall_segments, tall_circles)
        self._low = [(0.0, each.height, _of_plan(plan, each.segments, each.circles)) for each in plan.low]
        for board in plan.boards:
            numbers = np.full(len(board.segments), surfaces - 1)
            outline = _Surfaces(board.segments, np.zeros((0, 2)), np.zeros(0), numbers)
            self._low.append((board.base, board.height, outline))
        self._colours = colours.astype(np.float32)
        self._noise = _noise(rng)
        self._chances = rng.random((CHANCES, 5)).astype(np.float32)
        self._floor = (rng.uniform(80.0, 150.0) * rng.uniform(0.8, 1.0, 3)).astype(np.float32)
        self._last: Optional[Tuple[np.ndarray, Backdrop]] = None

    def paint(self, pose: np.ndarray) -> Backdrop:
        """The room seen from the pose (3,) of the camera's level frame in the plane; not to be changed."""
        if self._last is None or not np.array_equal(self._last[0], pose):
            self._last = (np.array(pose), self._painted(pose))
        return self._last[1]

    def _painted(self, pose: np.ndarray) -> Backdrop:
        table = self._cast(pose, self._tall)
        distances, surfaces, along, _ = (column[self._beam_of_pixel] for column in table)
        surfaces = surfaces.astype(int)
        cos, sin = np.float32(np.cos(pose[2])), np.float32(np.sin(pose[2]))
        ahead, left = self._directions[..., 0], self._directions[..., 1]
        levels = self._height + distances * self._slopes
        on_floor, on_ceiling = levels < 0.0, levels > CEILING_M
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where(on_floor, -self._height / self._slopes, distances)
            reach = np.where(on_ceiling, (CEILING_M - self._height) / self._slopes, reach)
        x = np.float32(pose[0]) + reach * (cos * ahead - sin * left)
        y = np.float32(pose[1]) + reach * (sin * ahead + cos * left)
        colours = np.empty((*levels.shape, 3), dtype=np.float32)
        walls = ~(on_floor | on_ceiling)
        colours[walls] = self._walls(surfaces[walls], along[walls], levels[walls])
        colours[on_floor] = self._floors(x[on_floor], y[on_floor])
        colours[on_ceiling] = _ceiling(x[on_ceiling], y[on_ceiling])
        for base, height, shape in self._low:
            self._paint_low(base, height, self._cast(pose, shape), reach, distances, colours)
        x = np.float32(pose[0]) + reach * (cos * ahead - sin * left)
        y = np.float32(pose[1]) + reach * (sin * ahead + cos * left)
        light = np.asarray(self._light.at(x, y) * np.clip(1.1 - 0.03 * reach, 0.6, 1.1), dtype=np.float32)
        return Backdrop(colours * light[..., None], distances, reach)

    def _paint_low(
        self,
        base: float,
        height: float,
        table: np.ndarray,
        reach: np.ndarray,
        distances: np.ndarray,
        colours: np.ndarray,
    ) -> None:
        """Paint a thing from `base` to `height` over what is behind it, `table` of `_cast`; `reach` and `distances` are
        those of what is seen from now on."""
        near, surfaces, along, far = (column[self._beam_of_pixel] for column in table)
        with np.errstate(divide="ignore", invalid="ignore"):
            over = (self._height - height) / -self._slopes  # where the ray is as high as the thing
        levels = self._height + near * self._slopes
        side = (near < reach) & (levels >= base) & (levels < height)
        top = (self._slopes < 0.0) & (over > near) & (over < np.minimum(far, reach))
        colours[side] = self._walls(surfaces[side].astype(int), along[side], levels[side])
        colours[top] = 0.9 * self._colours[surfaces[top].astype(int)]
        for which, there in ((side, near), (top, over)):
            reach[which] = there[which]
            distances[which] = np.minimum(distances, there)[which]

    def _cast(self, pose: np.ndarray, shape: _Surfaces) -> np.ndarray:
        """(4, B) of every beam: distance, number of the surface, place along it, and where it leaves; metres."""
        segments, radii = shape.segments, shape.radii
        azimuths = self._used * (2.0 * np.pi / self._beams) - np.pi + pose[2]
        directions = planar.direction(azimuths)
        origins = np.broadcast_to(pose[:2], directions.shape)
        centres = np.broadcast_to(shape.centres, (len(origins), len(radii), 2))
        ranges, hits, _ = rays.cast(origins, directions, segments, centres, radii)
        leaves = rays.leave(origins, directions, segments, centres, radii)
        ranges = np.minimum(ranges, FAR_M)
        points = origins + ranges[:, None] * directions
        along = 3.0 * azimuths  # about a circle
        flat = (hits >= 0) & (hits < len(segments))
        first, second = segments[hits[flat], 0], segments[hits[flat], 1]
        way = second - first
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        along[flat] = np.sum((points[flat] - first) * way, axis=1)
        surfaces = np.append(shape.numbers, -1)[hits]
        table = np.zeros((4, self._beams), dtype=np.float32)
        table[:, self._used] = ranges, surfaces, along, leaves
        return table

    def _walls(self, surfaces: np.ndarray, along: np.ndarray, levels: np.ndarray) -> np.ndarray:
        colours = self._colours[surfaces] * (1.0 + 0.07 * self._grain(along, levels))[:, None]
        colours *= (0.82 + 0.07 * np.clip(levels, 0.0, CEILING_M))[:, None]
        panels = np.floor(along / PANEL_M).astype(int)
        chance = self._chances[(31 * surfaces + 7 * panels) % CHANCES]
        within = along - panels * PANEL_M
        half = 0.25 + 0.3 * chance[:, 1]
        off = np.abs(within - 0.5 * PANEL_M)
        bottom = PICTURES_M[0] - 0.3 * chance[:, 2]
        has = (chance[:, 0] < 0.45) & (off < half) & (levels > bottom) & (levels < PICTURES_M[1])
        edge = has & ((off > half - 0.03) | (levels < bottom + 0.03) | (levels > PICTURES_M[1] - 0.03))
        picture = self._grain(3.0 * along + 50.0 * chance[:, 3], 3.0 * levels)[has]
        colours[has] = 110.0 + 70.0 * picture[:, None] + 120.0 * (chance[has, 2:5] - 0.5)
        colours[edge] = 35.0
        colours[levels < SKIRTING_M] *= 0.55
        return colours

    def _floors(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        tiles = self._chances[(13 * np.floor(x / TILE_M).astype(int) + 5 * np.floor(y / TILE_M).astype(int)) % CHANCES]
        joint = np.minimum(np.abs(x / TILE_M - np.round(x / TILE_M)), np.abs(y / TILE_M - np.round(y / TILE_M)))
        shade = (0.93 + 0.14 * tiles[:, 0] + 0.1 * self._grain(x, y)) * np.where(joint < 0.012, 0.75, 1.0)
        return np.asarray(self._floor * shade[:, None])

    def _grain(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        columns, rows = (100.0 * x).astype(int) % TEXTURE, (100.0 * y).astype(int) % TEXTURE
        return np.asarray(self._noise[rows, columns])


def _of_plan(plan: Plan, segments: np.ndarray, circles: np.ndarray) -> _Surfaces:
    segments, circles = segments.astype(int), circles.astype(int)
    numbers = np.concatenate([segments, len(plan.segments) + circles])
    return _Surfaces(plan.segments[segments], plan.centres[circles], plan.radii[circles], numbers)


def _ceiling(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    off = np.maximum(
        np.abs(x / LAMP_M - np.round(x / LAMP_M)) * LAMP_M, 0.5 * np.abs(y / LAMP_M - np.round(y / LAMP_M)) * LAMP_M
    )
    return np.asarray(np.where(off < 0.16, 252.0, 205.0)[:, None])


def _noise(rng: np.random.Generator) -> np.ndarray:
    """(TEXTURE, TEXTURE) smooth and rough together, about -1 to 1, which goes on round the edges."""
    import cv2  # 100 MB: not for those who simulate no images

    total = np.zeros((TEXTURE, TEXTURE), dtype=np.float32)
    for cells in (8, 32, 128, TEXTURE):
        layer = np.pad(rng.standard_normal((cells, cells)).astype(np.float32), 2, mode="wrap")
        size = TEXTURE * (cells + 4) // cells
        margin = (size - TEXTURE) // 2
        layer = cv2.resize(layer, (size, size), interpolation=cv2.INTER_CUBIC)
        total += layer[margin : margin + TEXTURE, margin : margin + TEXTURE]
    return total / 4.0
