"""Camera models against OpenCV's, and against their own derivatives."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.core.camera_models import Fisheye, Panorama, PanoramaConfig, Pinhole
from people_fusion.core.errors import DataError

SIZE, FOCAL, MIDDLE = (640, 480), (525.0, 520.0), (319.5, 241.0)
MATRIX = np.array([[FOCAL[0], 0.0, MIDDLE[0]], [0.0, FOCAL[1], MIDDLE[1]], [0.0, 0.0, 1.0]])
PLUMB_BOB = (0.262, -0.953, -0.0054, 0.0026, 1.163)  # a Kinect's
RATIONAL = (0.5, 0.1, 1e-3, -2e-3, 0.02, 0.6, 0.2, 0.01)
EQUIDISTANT = (0.02, -0.01, 0.003, -0.0005)
CAMERAS = {
    "ideal": Pinhole(*SIZE, FOCAL, MIDDLE),
    "plumb_bob": Pinhole(*SIZE, FOCAL, MIDDLE, PLUMB_BOB),
    "rational": Pinhole(*SIZE, FOCAL, MIDDLE, RATIONAL),
    "fisheye": Fisheye(*SIZE, (300.0, 300.0), MIDDLE, EQUIDISTANT),
    "panorama": Panorama(PanoramaConfig()),
    "half panorama": Panorama(PanoramaConfig(field=180.0, left_edge=90.0, rows_per_slope=300.0)),
}


@pytest.fixture(params=CAMERAS.values(), ids=CAMERAS.keys())
def camera(request):
    return request.param


def pixels_of(camera, count=500, seed=1):
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(0, camera.width - 1, count), rng.uniform(0, camera.height - 1, count)])


def ahead(count=500, seed=2, spread=0.5):
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 8.0, count)
    return np.column_stack([rng.uniform(-spread, spread, (count, 2)) * depth[:, None], depth])


def test_pixel_is_where_its_ray_is_seen(camera):
    pixels = pixels_of(camera)
    rays = camera.rays(pixels)
    assert np.isfinite(rays).all()
    assert np.allclose(np.linalg.norm(rays, axis=1), 1.0)
    assert np.allclose(camera.project(3.0 * rays), pixels, atol=1e-5)


def test_ray_jacobians_are_the_derivatives(camera):
    pixels, step = pixels_of(camera, 200), 1e-4
    for axis in range(2):
        offset = step * np.eye(2)[axis]
        numeric = (camera.rays(pixels + offset) - camera.rays(pixels - offset)) / (2.0 * step)
        assert np.allclose(camera.ray_jacobians(pixels)[:, :, axis], numeric, atol=1e-8)


@pytest.mark.parametrize("distortion", [(), PLUMB_BOB[:4], PLUMB_BOB, RATIONAL])
def test_pinhole_sees_what_opencv_sees(distortion):
    points = ahead()
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), MATRIX, np.array(distortion))
    seen = Pinhole(*SIZE, FOCAL, MIDDLE, distortion).project(points)
    assert np.allclose(seen, expected[:, 0], atol=1e-6)


def test_pinhole_looks_where_opencv_looks():
    pixels = pixels_of(CAMERAS["plumb_bob"])
    expected = cv2.undistortPointsIter(pixels[:, None], MATRIX, np.array(PLUMB_BOB), None, None, (3, 200, 1e-12))[:, 0]
    rays = CAMERAS["plumb_bob"].rays(pixels)
    assert np.allclose(rays[:, :2] / rays[:, 2:], expected, atol=1e-6)


def test_fisheye_sees_what_opencv_sees():
    points = ahead(spread=1.5)
    matrix = np.array([[300.0, 0.0, MIDDLE[0]], [0.0, 300.0, MIDDLE[1]], [0.0, 0.0, 1.0]])
    expected, _ = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), matrix, np.array(EQUIDISTANT))
    assert np.allclose(CAMERAS["fisheye"].project(points), expected[:, 0], atol=1e-6)


def test_what_is_behind_a_pinhole_is_not_seen():
    assert np.isnan(CAMERAS["ideal"].project(np.array([[0.1, 0.1, -2.0], [0.0, 0.0, 0.0]]))).all()


def test_fisheye_sees_sideways():
    wide = Fisheye(640, 640, (180.0, 180.0), (319.5, 319.5), (0.0, 0.0, 0.0, 0.0))
    seen = wide.project(np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    assert np.allclose(seen, [[319.5 + 90.0 * math.pi, 319.5], [319.5, 319.5]])


def test_barrel_distortion_does_not_fold_what_is_beside_into_the_image():
    barrel = Pinhole(*SIZE, FOCAL, MIDDLE, (-0.4, 0.0, 0.0, 0.0))
    seen = barrel.project(np.array([[0.3, 0.0, 1.0], [1.5, 0.0, 1.0], [3.0, 0.0, 1.0]]))
    assert np.isfinite(seen[0]).all() and np.isnan(seen[1:]).all()
    assert np.isnan(barrel.rays(np.array([[3000.0, 240.0]]))).all()


@settings(max_examples=50, deadline=None)
@given(st.floats(-math.pi, math.pi), st.floats(0.3, 8.0), st.floats(-1.0, 1.0))
def test_panorama_goes_round_clockwise_from_behind_to_behind(direction, distance, height):
    panorama = CAMERAS["panorama"]
    point = np.array([[distance * math.cos(direction), distance * math.sin(direction), height]])
    ((column, row),) = panorama.project(point)
    assert -0.5 <= column < panorama.width - 0.5 + 1e-6
    assert (column + 0.5) / panorama.width == pytest.approx((0.5 - direction / (2.0 * math.pi)) % 1.0, abs=1e-9)
    assert (row < 119.5) == (height > 0.0) or abs(height) < 1e-9
    around = panorama.rays(np.array([[column + panorama.width, row]]))
    assert np.allclose(around * np.linalg.norm(point), point, atol=1e-6)


def test_straight_up_is_nowhere_in_a_panorama():
    assert np.isnan(CAMERAS["panorama"].project(np.array([[0.0, 0.0, 1.0]]))[0, 1])


@pytest.mark.parametrize(
    "arguments",
    [
        (0, 480, FOCAL, MIDDLE), (640, -1, FOCAL, MIDDLE), (640, 480, (0.0, 500.0), MIDDLE),
        (640, 480, (math.nan, 500.0), MIDDLE), (640, 480, FOCAL, (math.inf, 0.0)),
        (640, 480, FOCAL, MIDDLE, (0.1,)), (640, 480, FOCAL, MIDDLE, (math.nan, 0.0, 0.0, 0.0)),
    ],
)  # fmt: skip
def test_camera_that_cannot_be_is_refused(arguments):
    with pytest.raises(DataError, match="camera"):
        Pinhole(*arguments)


def test_fisheye_needs_its_four_coefficients():
    with pytest.raises(DataError, match="fish-eye"):
        Fisheye(640, 480, FOCAL, MIDDLE, (0.1, 0.2))
