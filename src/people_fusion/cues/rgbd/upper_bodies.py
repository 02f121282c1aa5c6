"""Heads and shoulders: whether a place in the depth image looks like a person's from there, by metric size.

A candidate is the top of something. Samples on an upright plane through it, square to the line of sight, are looked up
in the image: each is of the candidate's body, behind it (seen through), before it (hidden), or unknown. A person is
body at the head and the chest, seen through beside and above the head, and not seen through beneath.
"""

from __future__ import annotations

from typing import NamedTuple, Tuple

import numpy as np

from people_fusion.core.depth_images import DepthImage
from people_fusion.core.poses import Pose
from people_fusion.cues.rgbd.sensors import DepthSensor

BODY, BEHIND, BEFORE, UNKNOWN, OUTSIDE = range(5)
BODY_BEFORE_M, BODY_BEHIND_M = 0.3, 0.22  # a body's surface is this near to the plane through its face, along depth
BEHIND_STDS = 2.0  # and this much of the sensor's error more
HEAD_DEPTH = 0.085  # from the surface that is seen of a head to its middle, along the line of sight, metres
HEAD_DROP = 0.12  # from its top, hair included, to its middle, metres
CROWN = 0.012  # of the top is too narrow to be seen, metres
FACE, HEAD_EXTENT = 0.07, 0.17  # half width of a face, and how deep a head may be, metres
STEP = 0.03  # of samples, metres

_ACROSS = np.arange(-14, 15) * STEP  # u, to the left
_DOWN = np.arange(-5, 20) * STEP  # v, from the top
_V, _U = np.meshgrid(_DOWN, _ACROSS, indexing="ij")
_HEAD = (np.hypot(_U / 0.08, (_V - 0.11) / 0.10) < 1.0).ravel()
_BESIDE = (_V > -0.01) & (_V < 0.17) & (np.abs(_U) > 0.165) & (np.abs(_U) < 0.29)
_LEFT, _RIGHT = (_BESIDE & (_U > 0)).ravel(), (_BESIDE & (_U < 0)).ravel()
_ABOVE = ((np.abs(_U) < 0.07) & (_V < -0.05)).ravel()
_HEAD_ROWS = np.flatnonzero((_DOWN > 0.05) & (_DOWN < 0.13))
_NECK_ROWS = np.flatnonzero((_DOWN > 0.17) & (_DOWN < 0.32))
_SHOULDER_ROWS = np.flatnonzero((_DOWN > 0.30) & (_DOWN < 0.5))
_CHEST_ROWS = np.flatnonzero(_DOWN > 0.35)
_CHEST_COLUMNS, _CHEST_ASIDE = 9, 5  # samples: its width, and how far it may be from beneath the head to either side
_MIDDLE = len(_ACROSS) // 2

# What each sample says for the part, by BODY, BEHIND, BEFORE, UNKNOWN, OUTSIDE.
_FILLED = np.array([1.0, 0.0, 0.4, 0.5, 0.3], dtype=np.float32)
_FILLED_OR_HIDDEN = np.array([1.0, 0.0, 0.8, 0.4, 0.5], dtype=np.float32)
_FREE = np.array([0.0, 1.0, 0.4, 0.8, 0.7], dtype=np.float32)
_FREE_ABOVE = np.array([0.0, 1.0, 0.4, 1.0, 0.8], dtype=np.float32)
_NOT_SEEN_THROUGH = np.array([1.0, 0.0, 1.0, 0.8, 0.8], dtype=np.float32)

_FINE_DOWN = np.arange(-12, 11) * 0.01
_FINE_ACROSS = np.array([-0.03, 0.0, 0.03])
_FACE_DOWN = np.array([0.04, 0.07, 0.10, 0.13, 0.16])
_FACE_ACROSS = np.arange(-8, 9) * 0.02
_LEGS_ACROSS = np.arange(-5, 6) * 0.07  # of who leans, legs are not beneath the head ...
_LEGS_BEHIND = 0.6  # ... nor at its distance, metres


class View(NamedTuple):
    """A depth image and where it was taken from.

    Attributes:
        image: the image.
        sensor: the kind of camera.
        level_from_camera: pose in level axes that look where the camera looks, the floor by the transform at z = 0.
    """

    image: DepthImage
    sensor: DepthSensor
    level_from_camera: Pose

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """(N, 2) column and row of points (N, 3) of level axes."""
        rotation, origin = self.level_from_camera.rotation, self.level_from_camera.translation
        return self.image.camera.project((points - origin) @ rotation)

    def look(self, points: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Codes (...) of points (..., 3) of level axes, and how far behind them (...) the image sees, metres."""
        rotation, origin = self.level_from_camera.rotation, self.level_from_camera.translation
        shape = points.shape[:-1]
        local = (points.reshape(-1, 3) - origin) @ rotation
        pixels = self.image.camera.project(local)
        height, width = self.image.depths.shape
        with np.errstate(invalid="ignore"):
            inside = (np.abs(pixels + 0.5 - [0.5 * width, 0.5 * height]) < [0.5 * width, 0.5 * height]).all(axis=1)
        pixels[~inside] = 0.0
        columns, rows = (pixels + 0.5).astype(np.int32).T
        depths = self.image.depths[rows, columns]
        behind = depths - local[:, 2]
        slack = BEHIND_STDS * self.sensor.stds(local[:, 2])
        with np.errstate(invalid="ignore"):
            is_behind, is_before = behind > BODY_BEHIND_M + slack, behind < -BODY_BEFORE_M - slack
        codes = np.where(is_behind, BEHIND, np.where(is_before, BEFORE, BODY))
        codes[np.isnan(behind)] = UNKNOWN
        codes[~inside] = OUTSIDE
        return codes.reshape(shape), np.where(inside, behind, np.nan).reshape(shape)


class UpperBodies(NamedTuple):
    """Candidates, measured.

    Attributes:
        tops: (N, 3) of the heads, on the surface that is seen, level axes, metres.
        middles: (N, 3) of the heads.
        scores: (N, 6) in [0, 1]: head, chest, the emptier side of the head, the other, above it, beneath the chest.
        widths: (N, 3) of head, neck and shoulders as far as they are seen, metres.
    """

    tops: np.ndarray
    middles: np.ndarray
    scores: np.ndarray
    widths: np.ndarray

    def take(self, rows: np.ndarray) -> UpperBodies:
        """Some of them, by mask or index."""
        return UpperBodies(*(each[rows] for each in self))


def measure(view: View, tops: np.ndarray, floor_heights: np.ndarray) -> UpperBodies:
    """What candidates look like.

    Args:
        view: the image.
        tops: (N, 3) highest points, level axes, metres.
        floor_heights: (N,) z of the floor beneath.
    """
    tops = tops.astype(float)
    ahead, across = _axes(tops)
    for _ in range(2):
        tops = _aligned(view, tops, ahead, across)
    samples = _plane(tops, across, _U.ravel(), _V.ravel())
    codes, _ = view.look(samples)
    sides = np.stack([_mean(_FREE, codes[:, side]) for side in (_LEFT, _RIGHT)])
    scores = np.stack(
        [
            _mean(_FILLED, codes[:, _HEAD]),
            _chest(codes.reshape(len(tops), len(_DOWN), len(_ACROSS))),
            sides.max(axis=0),
            sides.min(axis=0),
            _mean(_FREE_ABOVE, codes[:, _ABOVE]),
            _support(*view.look(_beneath(tops, across, floor_heights))),
        ],
        axis=1,
    )
    grid = codes.reshape(len(tops), len(_DOWN), len(_ACROSS)) == BODY
    heads, necks = np.median(_runs(grid[:, _HEAD_ROWS]), axis=1), _runs(grid[:, _NECK_ROWS]).min(axis=1)
    widths = np.stack([heads, necks, STEP * grid[:, _SHOULDER_ROWS].sum(axis=2).max(axis=1)], axis=1)
    middles = tops + HEAD_DEPTH * np.pad(ahead, ((0, 0), (0, 1))) - [0.0, 0.0, HEAD_DROP]
    return UpperBodies(tops, middles, scores, widths)


def _axes(tops: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Unit vectors (N, 2) on the floor along the line of sight and square to it, to the left."""
    ahead = tops[:, :2] / np.maximum(np.hypot(tops[:, 0], tops[:, 1]), 1e-6)[:, None]
    return ahead, np.column_stack([-ahead[:, 1], ahead[:, 0]])


def _plane(tops: np.ndarray, across: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(N, K, 3) samples u (K,) to the left and v (K,) down from the tops."""
    samples = np.empty((len(tops), len(u), 3))
    samples[:, :, :2] = tops[:, None, :2] + u[:, None] * across[:, None]
    samples[:, :, 2] = tops[:, None, 2] - v
    return samples


def _beneath(tops: np.ndarray, across: np.ndarray, floor_heights: np.ndarray) -> np.ndarray:
    """(N, 6, L, 3) samples between the chest and the shins."""
    lowest = np.maximum(tops[:, 2] - floor_heights - 0.25, 0.6)
    downs = 0.6 + (lowest[:, None] - 0.6) * np.linspace(0.0, 1.0, 6)
    samples = np.empty((len(tops), 6, len(_LEGS_ACROSS), 3))
    samples[..., :2] = (tops[:, None, :2] + _LEGS_ACROSS[:, None] * across[:, None])[:, None]
    samples[..., 2] = (tops[:, None, 2] - downs)[:, :, None]
    return samples


def _support(codes: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """(N,) share of the levels of `_beneath` at which something is."""
    with np.errstate(invalid="ignore"):
        codes = np.where((codes == BEHIND) & (behind < _LEGS_BEHIND), BODY, codes)
    return np.asarray(_NOT_SEEN_THROUGH[codes].max(axis=2).mean(axis=1))


def _chest(codes: np.ndarray) -> np.ndarray:
    """(N,) how much of a chest is filled, beneath the head or somewhat aside of it."""
    filled = _FILLED_OR_HIDDEN[codes[:, _CHEST_ROWS]].mean(axis=1)
    first = _MIDDLE - _CHEST_COLUMNS // 2
    windows = [filled[:, first + aside :][:, :_CHEST_COLUMNS] for aside in range(-_CHEST_ASIDE, _CHEST_ASIDE + 1)]
    return np.asarray(np.stack(windows).mean(axis=2).max(axis=0))


def _aligned(view: View, tops: np.ndarray, ahead: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Tops moved to the middle of the face across the line of sight, to its surface along it, and to its upper end."""
    v, u = (axis.ravel() for axis in np.meshgrid(_FACE_DOWN, _FACE_ACROSS, indexing="ij"))
    codes, behind = view.look(_plane(tops, across, u, v))
    is_body = codes == BODY
    deeper = _medians(np.where(is_body, behind, np.nan)[:, np.abs(u) < FACE])
    with np.errstate(invalid="ignore"):
        is_body &= np.abs(behind - deeper[:, None]) < HEAD_EXTENT
    aside = (is_body * u).sum(axis=1) / np.maximum(is_body.sum(axis=1), 1)
    tops = tops.copy()
    tops[:, :2] += aside[:, None] * across + deeper[:, None] * ahead
    v, u = (axis.ravel() for axis in np.meshgrid(_FINE_DOWN, _FINE_ACROSS, indexing="ij"))
    codes, _ = view.look(_plane(tops, across, u, v))
    is_body = (codes == BODY).reshape(len(tops), len(_FINE_DOWN), len(_FINE_ACROSS)).sum(axis=2) >= 2
    is_body &= np.roll(is_body, -1, axis=1)  # two rows, against lone pixels
    first = np.where(is_body.any(axis=1), is_body.argmax(axis=1), -_FINE_DOWN.argmin() + 12)
    tops[:, 2] += CROWN - _FINE_DOWN[np.minimum(first, len(_FINE_DOWN) - 1)]
    return tops


def _medians(values: np.ndarray) -> np.ndarray:
    """(N,) of what is not NaN in (N, K); 0 where all is."""
    ordered = np.sort(values, axis=1)  # NaN last
    middle = (values == values).sum(axis=1) // 2
    return np.asarray(np.nan_to_num(ordered[np.arange(len(values)), np.minimum(middle, values.shape[1] - 1)]))


def _mean(values: np.ndarray, codes: np.ndarray) -> np.ndarray:
    return np.asarray(values[codes].mean(axis=1))


def _runs(is_body: np.ndarray) -> np.ndarray:
    """(N, R) widths of the runs of body (N, R, U) through the middle, metres."""
    left = np.cumprod(is_body[:, :, _MIDDLE:], axis=2).sum(axis=2)
    right = np.cumprod(is_body[:, :, _MIDDLE::-1], axis=2).sum(axis=2)
    return np.asarray(np.maximum(left + right - 1, 0) * STEP)
