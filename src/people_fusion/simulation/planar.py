"""Poses in the plane as arrays (..., 3) of x, y, yaw: what a robot on a floor needs."""

from __future__ import annotations

import numpy as np


def compose(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(..., 3) parent_from_child times child_from_grandchild; the yaws add up and are not wrapped."""
    return np.concatenate([apply(first, second[..., :2]), first[..., 2:] + second[..., 2:]], axis=-1)


def inverse(pose: np.ndarray) -> np.ndarray:
    """(..., 3) child_from_parent."""
    turned = rotate(-pose[..., 2], pose[..., :2])
    return np.concatenate([-turned, -pose[..., 2:]], axis=-1)


def apply(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(..., 2) points of the child in the parent."""
    return pose[..., :2] + rotate(pose[..., 2], points)


def rotate(angle: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """(..., 2) vectors turned by `angle` (...), radians."""
    cos, sin = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


def direction(angle: np.ndarray) -> np.ndarray:
    """(..., 2) unit vectors."""
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def wrap(angle: np.ndarray) -> np.ndarray:
    """Angles within [-pi, pi)."""
    return (angle + np.pi) % (2.0 * np.pi) - np.pi
