"""The occupancy grid."""

import numpy as np
import pytest

from people_fusion.core.errors import DataError
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose


def grid(cells, origin=None, resolution=0.1):
    return OccupancyGrid("map", resolution, origin or Pose.identity(), np.array(cells, dtype=np.int8))


def wall():
    """A single occupied cell, row 7, column 12, of 20 x 30 cells of 10 cm."""
    cells = np.zeros((20, 30), dtype=np.int8)
    cells[7, 12] = 100
    return cells


def test_point_in_an_occupied_cell_is_occupied():
    points = np.array([[1.25, 0.75], [1.201, 0.701], [1.299, 0.799], [1.19, 0.75], [1.25, 0.81]])
    np.testing.assert_array_equal(grid(wall()).occupied_at(points), [True, True, True, False, False])


def test_point_outside_the_map_or_not_finite_is_free():
    points = np.array([[-0.05, 0.5], [3.05, 0.5], [0.5, 2.05], [np.nan, 0.5], [np.inf, 0.5], [1e30, 0.5], [0.5, 0.5]])
    np.testing.assert_array_equal(grid(np.full((20, 30), 100)).occupied_at(points), [False] * 6 + [True])
    assert grid(wall()).occupied_at(np.zeros((0, 2))).shape == (0,)


def test_origin_moves_and_turns_the_map():
    origin = Pose.from_xy_yaw(5.0, -3.0, 2.0, z=0.4)
    points = origin.apply(np.array([[1.25, 0.75, 0.0], [1.35, 0.75, 0.0]]))
    np.testing.assert_array_equal(grid(wall(), origin).occupied_at(points[:, :2]), [True, False])


def test_unknown_and_faint_cells_are_free():
    cells = [[-1, 0, 64, 65, 100]]
    points = np.column_stack([0.1 * np.arange(5) + 0.05, np.full(5, 0.05)])
    np.testing.assert_array_equal(grid(cells).occupied_at(points), [False, False, False, True, True])
    np.testing.assert_array_equal(grid(cells).occupied_at(points, threshold=50), [False, False, True, True, True])


@pytest.mark.parametrize("radius", [0.0, 0.05, 0.1, 0.2, 0.33])
def test_dilation_covers_the_cells_within_the_radius(radius):
    rows, columns = np.mgrid[:20, :30]
    expected = 0.1 * np.hypot(rows - 7, columns - 12) <= radius + 1e-9
    mask = grid(wall()).dilated(radius)
    np.testing.assert_array_equal(mask, expected)
    centres = 0.1 * np.column_stack([columns.ravel() + 0.5, rows.ravel() + 0.5])
    np.testing.assert_array_equal(grid(wall()).occupied_at(centres, radius), expected.ravel())


def test_distances_are_made_once_and_leaves_the_map_alone():
    walled = grid(wall())
    assert walled.distances() is walled.distances()
    assert walled.distances() is not walled.distances(threshold=99)
    np.testing.assert_array_equal(walled.occupancy, wall())
    with pytest.raises(ValueError, match="read-only"):
        walled.distances()[0, 0] = 1.0


def test_dilation_of_an_empty_map_is_empty():
    assert not grid(np.zeros((3, 4))).dilated(1.0).any()


def test_cells_come_row_by_row():
    made = OccupancyGrid.from_cells("map", 0.1, Pose.identity(), 3, 2, [0, 0, 0, 100, 0, 0], stamp_ns=7)
    np.testing.assert_array_equal(made.occupied_at(np.array([[0.05, 0.15], [0.25, 0.05]])), [True, False])
    assert made.stamp_ns == 7


@pytest.mark.parametrize(("width", "height", "count"), [(3, 2, 5), (3, 2, 7), (0, 0, 0), (0, 5, 0)])
def test_wrong_number_of_cells_is_refused(width, height, count):
    with pytest.raises(DataError, match="cells"):
        OccupancyGrid.from_cells("map", 0.1, Pose.identity(), width, height, np.zeros(count, dtype=np.int8))


@pytest.mark.parametrize("resolution", [0.0, -0.1, np.nan, np.inf])
def test_map_without_resolution_is_refused(resolution):
    with pytest.raises(DataError, match="resolution"):
        grid(wall(), resolution=resolution)
