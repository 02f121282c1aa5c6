"""Tracks and detections as rviz markers. Pure functions of core types, but for trails, which need a memory."""

from __future__ import annotations

import colorsys
import math
from collections import deque
from typing import Any, Deque, Dict, List, Set, Tuple

import numpy as np
from geometry_msgs.msg import Point, Vector3
from geometry_msgs.msg import Pose as PoseMsg
from geometry_msgs.msg import Quaternion as QuaternionMsg
from rospy import Duration
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from people_fusion.core.gaussians import chi_square_threshold
from people_fusion.core.measurements import Measurement
from people_fusion.core.stamps import from_seconds
from people_fusion.core.tracks import NOBODY, Legs, Particles, Tracks
from people_fusion.ros.conversions import header_to_msg

BODY, HEAD, VELOCITY, IDENTITY = "body", "head", "velocity", "identity"
ELLIPSE, TRAIL, CANDIDATE = "covariance", "trail", "candidate"
DETECTION, LEG = "detection", "leg"
PARTICLE = "particle"
SHIN, SHIN_ELLIPSE = "shin", "shin covariance"

LIFETIME = Duration.from_sec(2.0)  # markers of a tracker that has died go by themselves
TRAIL_S = 10.0
TRAIL_STEP = 0.1  # metres between the points of a trail
ELLIPSE_PROBABILITY = 0.95
ELLIPSE_CORNERS = 32
BODY_RADIUS, HEAD_RADIUS, HEAD_HEIGHTS = 0.2, 0.12, (0.5, 2.2)  # metres
SHIN_RADIUS, SHIN_HEIGHT = 0.06, 0.45  # metres
VELOCITY_SECONDS = 1.0  # an arrow ends where the person will be then
VISIBLE_SPEED = 0.1  # metres a second
PALEST = 0.15
FAINTEST = 0.08  # opacity of particles
HIDDEN = 0.3  # opacity of legs that are not seen
GOLDEN = (math.sqrt(5.0) - 1.0) / 2.0
WHITE, GREY = ColorRGBA(1.0, 1.0, 1.0, 1.0), ColorRGBA(0.6, 0.6, 0.6, 0.6)
ORANGE, YELLOW = ColorRGBA(1.0, 0.5, 0.0, 0.9), ColorRGBA(1.0, 0.9, 0.1, 0.9)
FLOOR = 0.02  # height of what lies on the floor, metres


class TrackMarkers:
    """Markers of tracks from one update to the next: trails, and the removal of what has gone.

    Args:
        on_legs: bodies end above the shins, which `leg_markers` shows.
    """

    def __init__(self, on_legs: bool = False) -> None:
        self._floor = SHIN_HEIGHT if on_legs else 0.0
        self._shown: Set[Tuple[str, int]] = set()
        self._trails: Dict[int, Deque[Tuple[int, float, float]]] = {}
        self._frame_id = ""

    def update(self, tracks: Tracks) -> Any:
        """MarkerArray that shows the tracks and removes what is no longer there."""
        if tracks.frame_id != self._frame_id:
            self._trails.clear()
            self._frame_id = tracks.frame_id
        confirmed = tracks.select(tracks.confirmed)
        self._lengthen(confirmed)
        trails = {name: np.array([(x, y) for _, x, y in trail]) for name, trail in self._trails.items()}
        markers = track_markers(confirmed, trails, self._floor) + candidate_markers(tracks.select(~tracks.confirmed))
        shown = {(marker.ns, marker.id) for marker in markers}
        header = header_to_msg(tracks.stamp_ns, tracks.frame_id)
        gone = [
            Marker(header=header, ns=namespace, id=number, action=Marker.DELETE)
            for namespace, number in sorted(self._shown - shown)
        ]
        self._shown = shown
        return MarkerArray(markers=gone + markers)

    def clear(self) -> Any:
        """MarkerArray that removes all markers."""
        self._shown.clear()
        self._trails.clear()
        return clear()

    def _lengthen(self, tracks: Tracks) -> None:
        alive = set(tracks.ids.tolist())
        self._trails = {name: trail for name, trail in self._trails.items() if name in alive}
        oldest_ns = tracks.stamp_ns - from_seconds(TRAIL_S)
        for name, (x, y) in zip(tracks.ids.tolist(), tracks.means[:, :2].tolist()):
            trail = self._trails.setdefault(name, deque())
            if not trail or math.hypot(x - trail[-1][1], y - trail[-1][2]) > TRAIL_STEP:
                trail.append((tracks.stamp_ns, x, y))
            while trail[0][0] < oldest_ns:
                trail.popleft()
                if not trail:
                    trail.append((tracks.stamp_ns, x, y))


def track_markers(tracks: Tracks, trails: Dict[int, np.ndarray], floor: float = 0.0) -> List[Any]:
    """Markers of confirmed tracks; opacity is existence.

    Args:
        tracks: at least their ids are in `trails`.
        trails: by id: (P, 2) where the track was.
        floor: height at which tall bodies begin, metres.
    """
    if len(tracks) == 0:
        return []
    header = header_to_msg(tracks.stamp_ns, tracks.frame_id)
    colours = [
        identity_colour(name, max(PALEST, min(1.0, existence)))
        for name, existence in zip(tracks.ids.tolist(), tracks.existence.tolist())
    ]
    heads = tracks.means[:, :3].copy()
    heads[:, 2] = np.clip(heads[:, 2], *HEAD_HEIGHTS)
    speeds = np.hypot(tracks.means[:, 3], tracks.means[:, 4])
    tips = heads.copy()
    tips[:, :2] += VELOCITY_SECONDS * tracks.means[:, 3:5]
    markers = []
    for i, name in enumerate(tracks.ids.tolist()):
        number, colour, (x, y, z) = name & 0x7FFFFFFF, colours[i], heads[i].tolist()
        tall = z - HEAD_RADIUS
        low = min(floor, tall / 2)
        body = _marker(header, BODY, number, Marker.CYLINDER, (2 * BODY_RADIUS, 2 * BODY_RADIUS, tall - low), colour)
        body.pose.position = Point(x, y, (low + tall) / 2)
        text = _marker(header, IDENTITY, number, Marker.TEXT_VIEW_FACING, (0.0, 0.0, 0.25), WHITE)
        text.pose.position = Point(x, y, z + 0.35)
        text.text = f"{name}  {100 * tracks.existence[i]:.0f}%"
        markers += [body, text]
        if speeds[i] > VISIBLE_SPEED:
            arrow = _marker(header, VELOCITY, number, Marker.ARROW, (0.06, 0.14, 0.2), colour)
            arrow.points = [Point(x, y, tall / 2), Point(*tips[i, :2].tolist(), tall / 2)]
            markers.append(arrow)
    balls = _marker(header, HEAD, 0, Marker.SPHERE_LIST, (2 * HEAD_RADIUS,) * 3, GREY)
    balls.points, balls.colors = _points(heads), colours
    lines = _marker(header, ELLIPSE, 0, Marker.LINE_LIST, (0.03, 0.0, 0.0), GREY)
    outlines = ellipses(tracks.means[:, :2], tracks.covariances[:, :2, :2])
    _add_lines(lines, outlines, colours)
    markers += [balls, lines]
    ways = [trails[name] for name in tracks.ids.tolist()]
    if any(len(way) > 1 for way in ways):
        paths = _marker(header, TRAIL, 0, Marker.LINE_LIST, (0.04, 0.0, 0.0), GREY)
        _add_lines(paths, ways, colours)
        markers.append(paths)
    return markers


def candidate_markers(tracks: Tracks) -> List[Any]:
    """Covariance ellipses of tracks that are not confirmed: to see what the tracker thinks about."""
    if len(tracks) == 0:
        return []
    header = header_to_msg(tracks.stamp_ns, tracks.frame_id)
    lines = _marker(header, CANDIDATE, 0, Marker.LINE_LIST, (0.02, 0.0, 0.0), GREY)
    colours = [ColorRGBA(0.6, 0.6, 0.6, max(PALEST, min(1.0, e))) for e in tracks.existence.tolist()]
    _add_lines(lines, ellipses(tracks.means[:, :2], tracks.covariances[:, :2, :2]), colours)
    return [lines]


def detection_markers(measurement: Measurement, number: int = 0) -> Any:
    """MarkerArray of a measurement's detections, with their ellipses, and legs, in its sensor's frame.

    Every cue has its own namespaces; what was there before is replaced or removed.
    """
    header = header_to_msg(measurement.stamp_ns, measurement.frame_id)
    rings = _marker(header, f"{DETECTION} {measurement.cue}", number, Marker.LINE_LIST, (0.02, 0.0, 0.0), ORANGE)
    outlines = ellipses(measurement.positions[:, :2], measurement.covariances[:, :2, :2])
    _add_lines(rings, outlines, [ORANGE] * len(measurement), height=0.0)
    legs = _marker(header, f"{LEG} {measurement.cue}", number, Marker.SPHERE_LIST, (0.12, 0.12, 0.12), YELLOW)
    legs.points = _points(np.column_stack([measurement.legs, np.zeros(len(measurement.legs))]))
    for marker in (rings, legs):
        if not marker.points:
            marker.action = Marker.DELETE
    return MarkerArray(markers=[rings, legs])


def clear() -> Any:
    """MarkerArray that removes all markers of its topic."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])


def leg_markers(legs: Legs) -> Any:
    """MarkerArray of legs in the colour of their person, grey without one, pale where they are not seen.

    It removes what was on its topic before: legs are too many and too short-lived to be remembered.
    """
    header = header_to_msg(legs.stamp_ns, legs.frame_id)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    lines = _marker(header, SHIN_ELLIPSE, 0, Marker.LINE_LIST, (0.015, 0.0, 0.0), GREY)
    colours = []
    for i, (name, owner, seen) in enumerate(zip(legs.ids.tolist(), legs.owners.tolist(), legs.seen.tolist())):
        opacity = 1.0 if seen else HIDDEN
        colour = ColorRGBA(0.6, 0.6, 0.6, opacity) if owner == NOBODY else identity_colour(owner, opacity)
        size = (2 * SHIN_RADIUS, 2 * SHIN_RADIUS, SHIN_HEIGHT)
        shin = _marker(header, SHIN, name & 0x7FFFFFFF, Marker.CYLINDER, size, colour)
        shin.pose.position = Point(*legs.positions[i].tolist(), SHIN_HEIGHT / 2)
        markers.append(shin)
        colours.append(colour)
    _add_lines(lines, ellipses(legs.positions, legs.covariances), colours)
    return MarkerArray(markers=[*markers, lines] if len(legs) else markers)


def particle_markers(particles: Particles) -> Any:
    """MarkerArray of particles as points in the colour of their track, those of candidates grey; opacity is weight.

    It removes what was on its topic before.
    """
    header = header_to_msg(particles.stamp_ns, particles.frame_id)
    markers = [Marker(header=header, action=Marker.DELETEALL)]
    strengths = particles.weights / np.maximum(particles.weights.max(axis=1, keepdims=True), 1e-300)
    for i, (name, confirmed) in enumerate(zip(particles.ids.tolist(), particles.confirmed.tolist())):
        points = _marker(header, PARTICLE, name & 0x7FFFFFFF, Marker.POINTS, (0.02, 0.02, 0.0), GREY)
        colour = identity_colour(name, 1.0) if confirmed else GREY
        points.points = _points(particles.positions[i])
        points.colors = [
            ColorRGBA(colour.r, colour.g, colour.b, opacity)
            for opacity in np.maximum(strengths[i], FAINTEST).tolist()
        ]
        markers.append(points)
    return MarkerArray(markers=markers)


def ellipses(means: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """(N, C, 2) closed outlines of the regions that hold 95 % of Gaussians (N, 2), (N, 2, 2), metres."""
    eigenvalues, eigenvectors = np.linalg.eigh(covariances)
    axes = eigenvectors * np.sqrt(np.maximum(eigenvalues, 0.0))[:, None, :]
    angles = np.linspace(0.0, 2.0 * math.pi, ELLIPSE_CORNERS + 1)
    radius = math.sqrt(chi_square_threshold(ELLIPSE_PROBABILITY, 2))
    circle = radius * np.stack([np.cos(angles), np.sin(angles)])
    return means[:, None, :] + np.swapaxes(axes @ circle, 1, 2)


def identity_colour(track_id: int, opacity: float) -> Any:
    """A colour far from those of the neighbouring identities (multiples of the golden ratio round the hue circle)."""
    return ColorRGBA(*colorsys.hsv_to_rgb((track_id * GOLDEN) % 1.0, 0.75, 0.95), opacity)


def _marker(
    header: Header, namespace: str, number: int, shape: int, scale: Tuple[float, float, float], colour: ColorRGBA
) -> Any:
    return Marker(
        header=header,
        ns=namespace,
        id=number,
        type=shape,
        action=Marker.ADD,
        pose=PoseMsg(Point(), QuaternionMsg(0.0, 0.0, 0.0, 1.0)),
        scale=Vector3(*scale),
        color=colour,
        lifetime=LIFETIME,
    )


def _add_lines(marker: Any, outlines: Any, colours: List[Any], height: float = FLOOR) -> None:
    """Append polylines (each (P, 2)), each in its colour, to a LINE_LIST."""
    for outline, colour in zip(outlines, colours):
        if len(outline) > 1:
            ends = np.repeat(outline, 2, axis=0)[1:-1]
            marker.points += _points(np.column_stack([ends, np.full(len(ends), height)]))
            marker.colors += [colour] * len(ends)


def _points(positions: np.ndarray) -> List[Any]:
    return [Point(x, y, z) for x, y, z in positions.tolist()]
