"""Rooms: walls, pillars and furniture as segments and circles, and the map that a robot made of some of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import List, NamedTuple, Optional, Tuple

import numpy as np
from scipy import ndimage

from people_fusion.core.config import load_yaml, parameter, parse
from people_fusion.core.errors import ConfigError
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose
from people_fusion.simulation import planar

Point = Tuple[float, float]
CEILING_M = 2.8
CORNERS = np.array([(0.5, 0.5), (-0.5, 0.5), (-0.5, -0.5), (0.5, -0.5)])
BOARD_M, BACK_M, GAP_M = 0.03, 0.04, 0.15  # thickness of boards and backrests, and what is left open between them


@dataclass(frozen=True)
class WallConfig:
    """Flat surfaces: a wall, a showcase, a box."""

    points: Tuple[Point, ...] = parameter((), "corners in order, metres")
    closed: bool = parameter(False, "whether the last corner is joined to the first")
    mapped: bool = parameter(True, "whether the robot's map has it")
    height: float = parameter(CEILING_M, "cameras look over what is lower, metres", 0.5, CEILING_M)

    def __post_init__(self) -> None:
        if len(self.points) < 2:
            raise ConfigError(f"room/walls: a wall needs two points or more, got {self.points!r}")


@dataclass(frozen=True)
class PillarConfig:
    """Something round: a pillar, a post, a bin."""

    at: Point = parameter((0.0, 0.0), "centre, metres")
    radius: float = parameter(0.2, "metres", low=0.005)
    mapped: bool = parameter(True, "whether the robot's map has it")
    height: float = parameter(CEILING_M, "as of walls, metres", 0.5, CEILING_M)


@dataclass(frozen=True)
class FurnitureConfig:
    """A chair or table, of which the scanner sees four legs."""

    at: Point = parameter((0.0, 0.0), "centre, metres")
    yaw: float = parameter(0.0, "radians")
    size: Point = parameter((0.45, 0.45), "between the legs, metres")
    leg_radius: float = parameter(0.02, "metres", low=0.005)
    mapped: bool = parameter(False, "whether the robot's map has it")
    board: float = parameter(0.0, "upper side of its seat or table top, which cameras see; 0: none, metres", low=0.0)
    back: float = parameter(0.0, "upper end of its backrest, opposite to where it faces; 0: none, metres", low=0.0)


@dataclass(frozen=True)
class RoomConfig:
    """A room from shapes, from an occupancy grid, or from both."""

    grid: Optional[str] = parameter(None, "YAML file of a map as map_server has it; its occupied cells are walls")
    walls: Tuple[WallConfig, ...] = parameter((), "flat surfaces")
    pillars: Tuple[PillarConfig, ...] = parameter((), "round things")
    furniture: Tuple[FurnitureConfig, ...] = parameter((), "things on four legs")
    map_resolution: float = parameter(0.05, "edge of a cell of the robot's map, metres", low=0.01, high=0.5)


@dataclass(frozen=True)
class MapFileConfig:
    """The YAML file of a map_server map."""

    image: str = parameter("", "PGM file, relative to the YAML file")
    resolution: float = parameter(0.05, "metres", low=1e-3)
    origin: Tuple[float, float, float] = parameter((0.0, 0.0, 0.0), "of the lower left corner: x, y, yaw")
    negate: int = parameter(0, "1 where white is occupied", low=0, high=1)
    occupied_thresh: float = parameter(0.65, "occupied above", low=0.0, high=1.0)
    free_thresh: float = parameter(0.196, "free below", low=0.0, high=1.0)
    mode: str = parameter("trinary", "only `trinary` is read", choices=("trinary",))


class Low(NamedTuple):
    """Something convex over which a camera may look.

    Attributes:
        height: metres.
        segments, circles: which of the plan it is made of.
    """

    height: float
    segments: np.ndarray
    circles: np.ndarray


class Board(NamedTuple):
    """A part of furniture that cameras see and scanners do not.

    Attributes:
        base, height: its lower and its upper side, metres.
        segments: (4, 2, 2) its outline, metres.
    """

    base: float
    height: float
    segments: np.ndarray


class Plan:
    """What stands still.

    Attributes:
        segments: (S, 2, 2) metres.
        centres, radii: (C, 2), (C,) of circles, metres.
        mapped_segments, mapped_circles: (S,), (C,) whether the robot's map has them.
        low: things that do not reach the ceiling. Lasers do not ask how high anything is.
        boards: of furniture.
    """

    def __init__(self, config: RoomConfig) -> None:
        self._resolution = config.map_resolution
        pieces = [(_outline(wall.points, wall.closed), wall.mapped) for wall in config.walls]
        if config.grid is not None:
            pieces.append((_cell_edges(read_map(config.grid)), True))
        self.segments = np.concatenate([piece for piece, _ in pieces]) if pieces else np.zeros((0, 2, 2))
        self.mapped_segments = np.repeat([mapped for _, mapped in pieces], [len(piece) for piece, _ in pieces]).astype(
            bool
        )
        starts = np.cumsum([0] + [len(piece) for piece, _ in pieces])
        walls = [
            Low(wall.height, np.arange(start, stop), np.arange(0))
            for wall, start, stop in zip(config.walls, starts, starts[1:])
        ]
        pillars = [Low(pillar.height, np.arange(0), np.array([row])) for row, pillar in enumerate(config.pillars)]
        self.low = [thing for thing in walls + pillars if thing.height < CEILING_M]
        self.boards = [board for item in config.furniture for board in _boards(item)]
        circles = [(pillar.at, pillar.radius, pillar.mapped) for pillar in config.pillars]
        for item in config.furniture:
            for corner in planar.apply(np.array([*item.at, item.yaw]), CORNERS * item.size):
                circles.append(((float(corner[0]), float(corner[1])), item.leg_radius, item.mapped))
        self.centres = np.array([at for at, _, _ in circles]).reshape(-1, 2)
        self.radii = np.array([radius for _, radius, _ in circles])
        self.mapped_circles = np.array([mapped for _, _, mapped in circles], dtype=bool)
        if len(self.segments) + len(self.radii) == 0:
            raise ConfigError("room: there is nothing in it; give `walls`, `pillars`, `furniture` or `grid`")

    @property
    def bounds(self) -> np.ndarray:
        """(2, 2) lower and upper corner of everything, metres."""
        points = [self.segments.reshape(-1, 2), self.centres - self.radii[:, None], self.centres + self.radii[:, None]]
        stacked = np.concatenate(points)
        return np.stack([stacked.min(axis=0), stacked.max(axis=0)])

    def occupied(self, lower: np.ndarray, shape: Tuple[int, int], resolution: float, mapped_only: bool) -> np.ndarray:
        """(height, width) bool, cells that a surface passes through; `lower` is the corner of cell (0, 0)."""
        segments = self.segments[self.mapped_segments] if mapped_only else self.segments
        circles = self.mapped_circles if mapped_only else np.ones(len(self.radii), bool)
        grid = np.zeros(shape, dtype=bool)
        points = []
        for first, second in segments:
            count = int(np.ceil(np.linalg.norm(second - first) / (resolution / 4.0))) + 1
            points.append(first + np.linspace(0.0, 1.0, count)[:, None] * (second - first))
        for centre, radius in zip(self.centres[circles], self.radii[circles]):
            count = int(np.ceil(2.0 * np.pi * radius / (resolution / 4.0))) + 4
            points.append(centre + radius * planar.direction(np.linspace(0.0, 2.0 * np.pi, count)))
        if points:
            columns, rows = np.floor((np.concatenate(points) - lower) / resolution).astype(int).T
            grid[rows, columns] = True
        return grid

    def grid(self, seen_from: np.ndarray) -> OccupancyGrid:
        """The robot's map: mapped surfaces occupied, what can be reached from `seen_from` (2,) free, else unknown."""
        resolution = self._resolution
        lower = np.floor((self.bounds[0] - 0.5) / resolution) * resolution
        width, height = (int(cells) for cells in np.ceil((self.bounds[1] + 0.5 - lower) / resolution))
        occupied = self.occupied(lower, (height, width), resolution, mapped_only=True)
        reachable = connected(~occupied, lower, resolution, seen_from)
        occupancy = np.where(occupied, 100, np.where(reachable, 0, -1)).astype(np.int8)
        return OccupancyGrid("map", resolution, Pose(np.eye(3), np.array([*lower, 0.0])), occupancy)

    def push_out(self, points: np.ndarray, clearance: np.ndarray) -> np.ndarray:
        """(N, 2) shifts that move points (N, 2) out to `clearance` (N,) from all surfaces."""
        shift = np.zeros_like(points)
        for away, distance, margin in self._gaps(points):
            depth = np.maximum(clearance[:, None] + margin - distance, 0.0)
            shift += np.sum(away * depth[..., None], axis=1)
        return shift

    def repulsion(self, points: np.ndarray, reach: float) -> np.ndarray:
        """(N, 2) sum of unit vectors away from surfaces, weighted exp(-gap / reach)."""
        force = np.zeros_like(points)
        for away, distance, margin in self._gaps(points):
            force += np.sum(away * np.exp(-np.maximum(distance - margin, 0.0) / reach)[..., None], axis=1)
        return force

    def gap(self, points: np.ndarray) -> np.ndarray:
        """(N,) distance of points (N, 2) from the nearest surface, negative within a circle."""
        gaps = [distance - margin for _, distance, margin in self._gaps(points)]
        return np.concatenate(gaps, axis=1).min(axis=1)

    def _gaps(self, points: np.ndarray) -> Tuple[Tuple[np.ndarray, np.ndarray, np.ndarray], ...]:
        """For segments and circles: unit vectors (N, K, 2) from the nearest point to `points`, distances, radii."""
        first, along = self.segments[:, 0], self.segments[:, 1] - self.segments[:, 0]
        offset = points[:, None] - first
        share = np.clip(np.sum(offset * along, axis=-1) / np.maximum(np.sum(along**2, axis=-1), 1e-12), 0.0, 1.0)
        from_segment = offset - share[..., None] * along
        from_circle = points[:, None] - self.centres
        gaps = []
        for away, margin in ((from_segment, np.zeros(len(first))), (from_circle, self.radii)):
            distance = np.sqrt(np.sum(away**2, axis=-1))
            gaps.append((away / np.maximum(distance, 1e-9)[..., None], distance, margin))
        return tuple(gaps)


def read_map(path: str) -> OccupancyGrid:
    """A map_server map (YAML beside a PGM image).

    Raises:
        ConfigError: a file is missing or is not what it should be; the message names it.
    """
    config = parse(MapFileConfig, load_yaml(path), str(path))
    image = Path(path).parent / config.image
    pixels = _read_pgm(image)
    dark = pixels if config.negate else 1.0 - pixels
    occupancy = np.where(dark > config.occupied_thresh, 100, np.where(dark < config.free_thresh, 0, -1)).astype(np.int8)
    x, y, yaw = config.origin
    cos, sin = np.cos(yaw), np.sin(yaw)
    origin = Pose(np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]]), np.array([x, y, 0.0]))
    return OccupancyGrid("map", config.resolution, origin, occupancy[::-1])


def _read_pgm(path: Path) -> np.ndarray:
    """(height, width) in [0, 1] of a PGM file, 8 bit, plain or raw."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    try:
        fields: List[bytes] = []
        end = 0
        while len(fields) < 4:
            line_end = data.index(b"\n", end)
            if data[end : end + 1] == b"#":
                end = line_end + 1
                continue
            start = end
            while not data[end : end + 1].isspace():
                end += 1
            if end > start:
                fields.append(data[start:end])
            end += 1
        kind, (width, height, white) = fields[0], (int(field) for field in fields[1:])
        body = data[end:]
        values = np.frombuffer(body, np.uint8) if kind == b"P5" else np.array(body.split(), dtype=float)
        if kind not in (b"P2", b"P5") or not 0 < white < 256:
            raise ValueError(f"kind {kind!r}, white {white}")
        return values[: width * height].reshape(height, width) / white
    except (ValueError, IndexError) as error:
        raise ConfigError(f"{path}: not an 8 bit PGM image ({error})") from error


def _boards(item: FurnitureConfig) -> List[Board]:
    """The board over the legs, and the backrest behind it."""
    place = np.array([*item.at, item.yaw])
    outline = CORNERS * item.size
    boards = []
    if item.board > 0.0:
        boards.append(Board(item.board - BOARD_M, item.board, _closed(planar.apply(place, outline))))
    if item.back > 0.0:
        behind = CORNERS * [BACK_M, item.size[1]] - [0.5 * item.size[0], 0.0]
        boards.append(Board(item.board + GAP_M, item.back, _closed(planar.apply(place, behind))))
    return boards


def _closed(corners: np.ndarray) -> np.ndarray:
    """(S, 2, 2) segments round corners (S, 2)."""
    return np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)


def _outline(points: Tuple[Point, ...], closed: bool) -> np.ndarray:
    """(S, 2, 2) segments from corner to corner."""
    corners = np.array(points + points[:1] if closed else points, dtype=float)
    return np.stack([corners[:-1], corners[1:]], axis=1)


def _cell_edges(grid: OccupancyGrid) -> np.ndarray:
    """(S, 2, 2) borders between occupied and other cells, straight runs joined."""
    occupied = np.pad(grid.occupancy >= 50, 1)
    runs = []
    for flip, mask in ((False, occupied), (True, occupied.T)):
        border = mask[1:] != mask[:-1]
        ends = np.diff(np.pad(border, ((0, 0), (1, 1))).astype(np.int8), axis=1)
        rows, starts = np.nonzero(ends == 1)
        _, stops = np.nonzero(ends == -1)
        first, second = np.stack([starts - 1, rows], axis=1), np.stack([stops - 1, rows], axis=1)
        run = np.stack([first, second], axis=1) * grid.resolution
        runs.append(run[..., ::-1] if flip else run)
    edges = np.concatenate(runs)
    return edges @ grid.origin.rotation[:2, :2].T + grid.origin.translation[:2]


def connected(free: np.ndarray, lower: np.ndarray, resolution: float, start: np.ndarray) -> np.ndarray:
    """(height, width) bool, free cells that can be reached from `start`."""
    labels, _ = ndimage.label(free)
    column, row = np.floor((np.asarray(start) - lower) / resolution).astype(int)
    if not (0 <= row < free.shape[0] and 0 <= column < free.shape[1]) or labels[row, column] == 0:
        raise ConfigError(f"room: {tuple(np.round(start, 2))} is not on free floor")
    return labels == labels[row, column]
