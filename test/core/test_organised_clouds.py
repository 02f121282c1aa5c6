from __future__ import annotations

import numpy as np
import pytest

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.errors import DataError
from people_fusion.core.organised_clouds import camera_of_points, organised_cloud

K = np.array([[131.0, 0.0, 79.0], [0.0, 133.0, 61.5], [0.0, 0.0, 1.0]])
HEIGHT, WIDTH = 120, 160


def scene(rng, lost=0.2):
    """Points as a pinhole sees them."""
    depths = rng.uniform(0.6, 6.0, (HEIGHT, WIDTH)).astype(np.float32)
    depths[rng.random(depths.shape) < lost] = np.nan
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    rays = Pinhole(WIDTH, HEIGHT, K).rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    return ((rays / rays[:, 2:]).reshape(HEIGHT, WIDTH, 3) * depths[..., None]).astype(np.float32), depths


def packed(points, colour=None, big_endian=False, floats="f4", padding=12):
    """Arguments of organised_cloud for these points, rows filled up by some bytes."""
    order = ">" if big_endian else "<"
    size = np.dtype(floats).itemsize
    kinds = {"f4": 7, "f8": 8}
    names = [(axis, order + floats) for axis in "xyz"] + ([("rgb", order + "u4")] if colour is not None else [])
    cells = np.zeros(points.shape[:2], dtype=[("pad", "V4"), *names])
    for column, axis in enumerate("xyz"):
        cells[axis] = points[..., column]
    fields = {axis: (4 + size * n, kinds[floats]) for n, axis in enumerate("xyz")}
    if colour is not None:
        blue, green, red = np.moveaxis(colour.astype(np.uint32), 2, 0)
        cells["rgb"] = red << 16 | green << 8 | blue
        fields["rgb"] = (4 + 3 * size, 7)
    step = cells.dtype.itemsize
    rows = np.zeros((len(cells), cells.shape[1] * step + padding), dtype=np.uint8)
    rows[:, : cells.shape[1] * step] = cells.view(np.uint8).reshape(len(cells), -1)
    return [*points.shape[:2], step, rows.shape[1], big_endian, fields, rows.tobytes()]


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("floats", ["f4", "f8"])
def test_depths_and_colour_come_back(big_endian, floats):
    rng = np.random.default_rng(1)
    points, depths = scene(rng)
    colour = rng.integers(0, 256, points.shape).astype(np.uint8)
    cloud = organised_cloud(*packed(points, colour, big_endian, floats))
    np.testing.assert_array_equal(cloud.depths, depths)
    np.testing.assert_array_equal(cloud.colour, colour)
    assert cloud.depths.dtype == np.float32


def test_a_cloud_without_colour_has_none_and_points_behind_are_no_depths():
    points, _ = scene(np.random.default_rng(1), lost=0.0)
    points[3, 4] *= -1.0
    points[5, 6, 0] = np.inf
    cloud = organised_cloud(*packed(points))
    assert cloud.colour is None
    assert np.argwhere(np.isnan(cloud.depths)).tolist() == [[3, 4], [5, 6]]


def test_the_last_row_need_not_be_filled_up():
    points, depths = scene(np.random.default_rng(2))
    arguments = packed(points)
    arguments[-1] = arguments[-1][:-12]
    np.testing.assert_array_equal(organised_cloud(*arguments).depths, depths)


@pytest.mark.parametrize(
    ("place", "value", "reason"),
    [
        (0, 1, "not organised"),
        (1, 0, "not organised"),
        (0, 1000, "does not fit its size"),
        (2, 8, "does not fit its size"),
        (3, 100, "does not fit its size"),
        (5, {"x": (0, 7), "y": (4, 7)}, "without x, y and z"),
        (5, {"x": (0, 7), "y": (4, 7), "z": (8, 2)}, "without x, y and z"),
        (6, b"", "does not fit its size"),
    ],
)
def test_a_cloud_that_cannot_be_is_refused(place, value, reason):
    arguments = packed(scene(np.random.default_rng(3))[0])
    arguments[place] = value
    with pytest.raises(DataError, match=reason):
        organised_cloud(*arguments)


def test_the_camera_is_told_by_the_points():
    rng = np.random.default_rng(4)
    points, _ = scene(rng, lost=0.5)
    camera = camera_of_points(points)
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    places = rng.uniform([-1.0, -1.0, 1.0], [1.0, 1.0, 5.0], (50, 3))
    np.testing.assert_allclose(camera.project(places), Pinhole(WIDTH, HEIGHT, K).project(places), atol=1e-3)


def test_too_few_points_or_another_frames_axes_tell_no_camera():
    points, _ = scene(np.random.default_rng(5))
    with pytest.raises(DataError, match="too few points"):
        camera_of_points(np.full_like(points, np.nan))
    for turned in (points[..., [2, 0, 1]], points * [-1.0, 1.0, 1.0], points * [1.0, -1.0, 1.0]):
        with pytest.raises(DataError, match="not those of an image"):
            camera_of_points(turned)
