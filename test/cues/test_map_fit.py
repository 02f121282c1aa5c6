"""The pose of a scan by what it sees of the map."""

from __future__ import annotations

import numpy as np
import pytest

from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose
from people_fusion.cues.legs import map_fit

RESOLUTION = 0.05


def room(half=4.0, origin_yaw=0.0):
    """An empty square room about the map's origin, whose grid may lie turned; cells' centres are on the walls."""
    count = 2 * round((half + 0.5) / RESOLUTION) + 1
    places = (np.arange(count) - count // 2) * RESOLUTION
    walls = abs(np.maximum(abs(places)[None], abs(places)[:, None]) - half) < 0.5 * RESOLUTION
    turned, corner = Pose.from_xy_yaw(0.0, 0.0, origin_yaw), -count / 2.0 * RESOLUTION
    origin = turned @ Pose.from_xy_yaw(corner, corner, 0.0)
    return OccupancyGrid("map", RESOLUTION, origin, np.where(walls, 100, 0).astype(np.int8))


def square(half=4.0, count=60):
    along = np.linspace(-half, half, count)
    edge = np.full(count, half)
    sides = [(along, edge), (along, -edge), (edge, along), (-edge, along)]
    return np.concatenate([np.column_stack(side) for side in sides])


def covariance(position_std=0.05, yaw_std=0.02):
    return np.diag([position_std**2, position_std**2, 0.0, 0.0, 0.0, yaw_std**2])


def misplaced(points, origin, error):
    """Points as a robot at `origin` believes them to be whose pose is off by `error` x, y, yaw."""
    pose = Pose.from_xy_yaw(*error)
    return (points - origin - error[:2]) @ pose.rotation[:2, :2] + origin


@pytest.mark.parametrize("origin_yaw", [0.0, 0.7])
def test_pose_error_is_found_by_the_walls(origin_yaw):
    grid, origin = room(origin_yaw=origin_yaw), np.array([0.5, -1.0])
    truth = square() @ Pose.from_xy_yaw(0.0, 0.0, origin_yaw).rotation[:2, :2].T
    seen = misplaced(truth, origin, np.array([0.08, -0.05, 0.03]))
    assert abs(seen - truth).max() > 0.15
    found, left = map_fit.corrected(seen, origin, covariance(), grid, 65)
    assert abs(found - truth).max() < 0.03
    assert np.sqrt(np.diag(left)).max() < 0.015


def test_people_do_not_draw_the_walls():
    origin, truth = np.zeros(2), square()
    people = np.random.default_rng(1).uniform(-2.5, 2.5, (80, 2))
    seen = misplaced(np.concatenate([truth, people]), origin, np.array([0.06, 0.04, -0.02]))
    found, _ = map_fit.corrected(seen, origin, covariance(), room(), 65)
    assert abs(found[: len(truth)] - truth).max() < 0.03


def test_localisation_that_is_sure_is_believed():
    seen = square() + [0.1, 0.0]
    found, left = map_fit.corrected(seen, np.zeros(2), np.zeros((6, 6)), room(), 65)
    assert np.array_equal(found, seen) and not left.any()
    found, _ = map_fit.corrected(seen, np.zeros(2), covariance(1e-4, 1e-4), room(), 65)
    assert found == pytest.approx(seen, abs=0.001)


def test_correction_is_a_compromise_of_map_and_localisation():
    def correction(position_std):
        seen = square(count=10) + [0.1, 0.0]
        found, _ = map_fit.corrected(seen, np.zeros(2), covariance(position_std, 1e-6), room(), 65)
        return (seen - found)[:, 0].mean()

    assert 0.001 < correction(0.003) < 0.04 < 0.08 < correction(0.1) < 0.12


def test_one_wall_says_nothing_along_itself():
    wall = np.column_stack([np.linspace(-1.0, 1.0, 60), np.full(60, 4.0)])
    found, left = map_fit.corrected(wall + [0.06, 0.06], np.zeros(2), covariance(0.05, 1e-6), room(), 65)
    assert (found - wall).mean(axis=0) == pytest.approx([0.06, 0.0], abs=0.015)
    assert np.sqrt(left[0, 0]) > 0.045 > 0.02 > np.sqrt(left[1, 1])


def test_far_outside_an_empty_or_unknown_map_nothing_is_moved():
    empty = OccupancyGrid("map", RESOLUTION, Pose.identity(), np.zeros((40, 40), dtype=np.int8))
    for grid, points in ((empty, square(0.5) + 1.0), (room(), square() + 100.0), (room(), np.zeros((0, 2)))):
        found, left = map_fit.corrected(points, np.zeros(2), covariance(), grid, 65)
        assert found == pytest.approx(points) and left == pytest.approx(map_fit.planar(covariance()), abs=1e-8)
