"""How far the localisation is off, by what the scan itself sees of the map (likelihood field, Thrun et al. 2005, 6.4).

A wall that seems to stand out of the map because the robot is not quite where it believes to be is no person. The
correction is for telling the background alone; nobody else's transforms are touched.
"""

from __future__ import annotations

from typing import Tuple

import numpy as np

from people_fusion.core.grids import OccupancyGrid

STEPS = 2  # of Gauss and Newton
POINTS = 120  # about so many are looked at
FIT_STD = 0.05  # metres; more than the noise, as neighbours share the errors of the map
SPREAD = 0.1  # metres; residuals beyond it are of people and things that the map does not have
REACH = 3.0  # standard deviations of the localisation
PLANAR = np.array([0, 1, 5])  # x, y and rotZ of a pose's covariance
TINY = 1e-9


def corrected(
    points: np.ndarray, origin: np.ndarray, covariance: np.ndarray, grid: OccupancyGrid, occupied: int
) -> Tuple[np.ndarray, np.ndarray]:
    """Points of a scan moved and turned about the scanner as far as the map and the localisation's covariance suggest.

    Args:
        points: (N, 2) in the map's frame, metres.
        origin: (2,) the scanner there.
        covariance: (6, 6) of the robot's pose in the map; the scanner's is taken to be the same.
        grid: the map.
        occupied: occupancy from which a cell is an obstacle.

    Returns:
        (N, 2) points, and the covariance (3, 3) of x, y and yaw that is left.
    """
    prior = planar(covariance)
    if not len(points) or not prior.any():
        return points, prior
    information = np.linalg.inv(prior + TINY * np.eye(3))
    error, posterior = np.zeros(3), prior
    some = points[:: max(1, len(points) // POINTS)]
    reach = SPREAD + REACH * np.sqrt(variances(some - origin, prior))
    for _ in range(STEPS):
        moved = _moved(some, origin, error)
        distances, slopes = _field(grid, moved, occupied)
        near = np.flatnonzero(distances < reach)
        arms, slopes, distances = moved[near] - origin - error[:2], slopes[near], distances[near]
        jacobian = np.column_stack([slopes, slopes[:, 1] * arms[:, 0] - slopes[:, 0] * arms[:, 1]])
        weights = 1.0 / (FIT_STD * (1.0 + (distances / SPREAD) ** 2)) ** 2
        posterior = np.linalg.inv(information + jacobian.T @ (weights[:, None] * jacobian))
        error = error - posterior @ (information @ error + jacobian.T @ (weights * distances))
    return _moved(points, origin, error), posterior


def planar(covariance: np.ndarray) -> np.ndarray:
    """(3, 3) of x, y and yaw."""
    return covariance[np.ix_(PLANAR, PLANAR)]


def variances(arms: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(N,) of points' places, mean of both axes, by the covariance (3, 3) of the pose that they are seen from."""
    turned = covariance[2, 2] * np.sum(arms**2, axis=1)
    return (covariance[0, 0] + covariance[1, 1]) / 2.0 + turned


def _moved(points: np.ndarray, origin: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Points (N, 2) turned about the scanner and moved by `error` (3,): x, y and yaw."""
    cos, sin = np.cos(error[2]), np.sin(error[2])
    moved: np.ndarray = (points - origin) @ np.array([[cos, sin], [-sin, cos]]) + origin + error[:2]
    return moved


def _field(grid: OccupancyGrid, points: np.ndarray, occupied: int) -> Tuple[np.ndarray, np.ndarray]:
    """(N,) distances to the nearest obstacle, interpolated between cells' centres, and their gradient (N, 2).

    Beside the map the distance is +inf and the gradient 0.
    """
    distances = grid.distances(occupied)
    rotation = grid.origin.rotation[:2, :2]
    places = (points - grid.origin.translation[:2]) @ rotation / grid.resolution - 0.5
    height, width = distances.shape
    cells = np.floor(places).astype(int)
    inside = ((cells >= 0) & (cells < (width - 1, height - 1))).all(axis=1)
    cells[~inside] = 0
    (x, y), (column, row) = (places - cells).T, cells.T
    near, right = distances[row, column], distances[row, column + 1]
    above, across = distances[row + 1, column], distances[row + 1, column + 1]
    with np.errstate(invalid="ignore"):  # a map without obstacles is infinitely far from them
        found = (1 - y) * ((1 - x) * near + x * right) + y * ((1 - x) * above + x * across)
        along = (1 - y) * (right - near) + y * (across - above)
        upwards = (1 - x) * (above - near) + x * (across - right)
    known = inside & np.isfinite(found)
    slopes = np.where(known[:, None], np.column_stack([along, upwards]), 0.0)
    return np.where(known, found, np.inf), slopes @ rotation.T / grid.resolution
