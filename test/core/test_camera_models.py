"""Camera models against OpenCV's, against themselves, and against numeric differentiation."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from people_fusion.core.camera_models import Fisheye, Panorama, PanoramaConfig, Pinhole
from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.core.poses import rotation_from_vector

K = np.array([[525.0, 0.0, 313.0], [0.0, 530.0, 236.5], [0.0, 0.0, 1.0]])
PLUMB_BOB = (-0.28, 0.09, 0.0012, -0.0007, -0.01)
RATIONAL = (0.45, -2.6, 0.0006, -0.0002, 1.5, 0.33, -2.4, 1.43)  # of an Azure Kinect
WIDE = (-0.02, 0.006, -0.003, 0.0004)
WIDE_K = np.array([[200.0, 0.0, 318.0], [0.0, 201.0, 241.0], [0.0, 0.0, 1.0]])
TURN = rotation_from_vector(np.array([0.02, -0.01, 0.03]))

CAMERAS = {
    "ideal": Pinhole(640, 480, K),
    "plumb_bob": Pinhole(640, 480, K, PLUMB_BOB),
    "pincushion": Pinhole(640, 480, K, (0.25, 0.05, 0.002, 0.003)),
    "rational": Pinhole(640, 480, K, RATIONAL),
    "rectified_stereo": Pinhole(640, 480, K, PLUMB_BOB, TURN),
    "fisheye": Fisheye(640, 480, WIDE_K, WIDE),
    "full_circle": Panorama(PanoramaConfig()),
    "half_circle": Panorama(PanoramaConfig(700, 200, 1.9, 3.0, 80.0, 210.0)),
}


@pytest.fixture(params=sorted(CAMERAS))
def camera(request):
    return CAMERAS[request.param]


def pixels_of(camera, rng, count=1000):
    return rng.uniform([-0.5, -0.5], [camera.width - 0.5, camera.height - 0.5], (count, 2))


def in_front(rng, count=1000, tangent=0.6):
    depths = rng.uniform(0.5, 10.0, count)
    return np.column_stack([rng.uniform(-tangent, tangent, (count, 2)), np.ones(count)]) * depths[:, None]


@pytest.mark.parametrize("D", [(), PLUMB_BOB[:4], PLUMB_BOB, RATIONAL])
def test_pinhole_sees_points_where_opencv_does(D):
    points = in_front(np.random.default_rng(1))
    expected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, np.array(D or [0.0] * 4))[0][:, 0]
    np.testing.assert_allclose(Pinhole(640, 480, K, D).project(points), expected, atol=1e-9)


@pytest.mark.parametrize("D", [PLUMB_BOB, RATIONAL])
@pytest.mark.parametrize("R", [None, TURN])
def test_pinhole_looks_where_opencv_does(D, R):
    camera = Pinhole(640, 480, K, D, R)
    pixels = pixels_of(camera, np.random.default_rng(2))
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    plain = cv2.undistortPointsIter(pixels[:, None], K, np.array(D), R, None, criteria)[:, 0]
    rays = camera.rays(pixels)
    np.testing.assert_allclose(rays[:, :2] / rays[:, 2:], plain, atol=1e-8)


def test_fisheye_sees_points_where_opencv_does():
    camera = CAMERAS["fisheye"]
    points = in_front(np.random.default_rng(3), tangent=6.0)
    expected = cv2.fisheye.projectPoints(points[:, None], np.zeros(3), np.zeros(3), WIDE_K, np.array(WIDE))[0][:, 0]
    np.testing.assert_allclose(camera.project(points), expected, atol=1e-9)


def test_fisheye_looks_where_opencv_does():
    camera = CAMERAS["fisheye"]
    pixels = camera.project(in_front(np.random.default_rng(4), tangent=1.5))
    plain = cv2.fisheye.undistortPoints(pixels[:, None], WIDE_K, np.array(WIDE))[:, 0]
    rays = camera.rays(pixels)
    np.testing.assert_allclose(rays[:, :2] / rays[:, 2:], plain, atol=1e-6)


def test_fisheye_sees_what_is_behind_it():
    camera = CAMERAS["fisheye"]
    behind = np.array([[1.0, 0.2, -0.1], [-0.5, 1.0, -0.3]])
    rays = camera.rays(camera.project(behind))
    np.testing.assert_allclose(rays, behind / np.linalg.norm(behind, axis=1)[:, None], atol=1e-9)


def test_every_pixel_comes_back_from_its_ray(camera):
    pixels = pixels_of(camera, np.random.default_rng(5))
    rays = camera.rays(pixels)
    assert np.isfinite(rays).all()
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(camera.project(3.7 * rays), pixels, atol=1e-6)


def test_ray_jacobians_are_the_derivatives_of_the_rays(camera):
    pixels = pixels_of(camera, np.random.default_rng(6))
    step = 1e-4 * np.eye(2)
    numeric = np.stack([(camera.rays(pixels + d) - camera.rays(pixels - d)) / 2e-4 for d in step], axis=2)
    np.testing.assert_allclose(camera.ray_jacobians(pixels), numeric, atol=1e-8)


def test_middle_and_nothing_are_ordinary(camera):
    middle = np.array([[0.5 * (camera.width - 1), 0.5 * (camera.height - 1)]])
    assert np.isfinite(camera.ray_jacobians(middle)).all()
    none = np.zeros((0, 2))
    assert camera.rays(none).shape == (0, 3)
    assert camera.ray_jacobians(none).shape == (0, 3, 2)
    assert camera.project(np.zeros((0, 3))).shape == (0, 2)


def test_optical_axis_is_the_principal_point():
    for name, matrix in (("ideal", K), ("plumb_bob", K), ("fisheye", WIDE_K)):
        camera = CAMERAS[name]
        axis = camera.project(np.array([[0.0, 0.0, 2.0]]))
        np.testing.assert_allclose(axis[0], matrix[:2, 2], atol=1e-12)
        np.testing.assert_allclose(camera.rays(axis), [[0.0, 0.0, 1.0]], atol=1e-12)
        assert np.isfinite(camera.ray_jacobians(axis)).all()


def test_what_is_no_point_or_pixel_is_nowhere(camera):
    for value in (np.nan, np.inf):
        assert np.isnan(camera.project(np.full((1, 3), value))).all()
        assert np.isnan(camera.rays(np.full((1, 2), value))).any()
    assert np.isnan(camera.project(np.zeros((1, 3)))).all()


@pytest.mark.parametrize("name", ["ideal", "plumb_bob", "rational"])
def test_pinhole_sees_nothing_behind_it(name):
    points = np.array([[0.1, 0.0, -1.0], [0.1, 0.0, 0.0], [1.0, 1.0, -3.0]])
    assert np.isnan(CAMERAS[name].project(points)).all()


def test_points_beyond_the_fold_of_a_lens_do_not_return_into_the_image():
    camera = Pinhole(640, 480, K, (-0.28, 0.0, 0.0, 0.0))
    fold = math.sqrt(1.0 / (3.0 * 0.28))  # where r (1 - 0.28 r^2) stops to grow
    tangents = np.linspace(0.0, 8.0, 400)
    pixels = camera.project(np.column_stack([tangents, np.zeros(400), np.ones(400)]))
    assert np.isnan(pixels[tangents > fold]).all()
    seen = tangents < 0.99 * fold
    assert np.isfinite(pixels[seen]).all()
    assert (np.diff(pixels[seen, 0]) > 0.0).all()
    folded = cv2.projectPoints(np.array([[1.88, 0.0, 1.0]]), np.zeros(3), np.zeros(3), K, np.array([-0.28, 0, 0, 0]))
    assert 0 < folded[0][0, 0, 0] < 640, "OpenCV folds it"
    assert np.isnan(camera.rays(np.array([[700.0 + 313.0, 236.5]]))).all()


def test_fisheye_stops_where_its_image_stops_to_grow():
    camera = Fisheye(640, 480, K, (-0.2, 0.0, 0.0, 0.0))
    fold = math.sqrt(1.0 / 0.6)
    angles = np.linspace(0.0, math.pi, 500)
    pixels = camera.project(np.column_stack([np.sin(angles), np.zeros(500), np.cos(angles)]))
    assert np.isnan(pixels[angles > fold]).all()
    assert np.isfinite(pixels[angles < 0.99 * fold]).all()


def coefficients(count, limit):
    return arrays(float, count, elements=st.floats(-limit, limit))


@given(coefficients(5, 0.5), st.integers(0, 2**32 - 1))
def test_any_plumb_bob_lens_is_one_to_one_where_it_says_so(D, seed):
    D[2:4] *= 0.1
    returns(Pinhole(640, 480, K, D), seed)


@given(coefficients(8, 1.0), st.integers(0, 2**32 - 1))
def test_any_rational_lens_is_one_to_one_where_it_says_so(D, seed):
    D[2:4] *= 0.02
    returns(Pinhole(640, 480, K, D), seed)


@given(coefficients(4, 0.2), st.integers(0, 2**32 - 1))
def test_any_fisheye_is_one_to_one_where_it_says_so(D, seed):
    returns(Fisheye(640, 480, K, D), seed)


def returns(camera, seed):
    """Points return as the rays of their pixels; pixels with a ray return as its pixel."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(200, 3)) * [1.0, 1.0, 0.7] + [0.0, 0.0, 0.7]
    directions = points / np.linalg.norm(points, axis=1)[:, None]
    pixels = camera.project(points)
    seen = np.isfinite(pixels).all(axis=1)
    rays = camera.rays(pixels[seen])
    known = np.isfinite(rays).all(axis=1)
    assert known.mean() > 0.98 if len(known) else True
    np.testing.assert_allclose(rays[known], directions[seen][known], atol=1e-5)
    pixels = rng.uniform([-700.0, -500.0], [1300.0, 1000.0], (200, 2))
    rays = camera.rays(pixels)
    known = np.isfinite(rays).all(axis=1)
    np.testing.assert_allclose(camera.project(rays[known]), pixels[known], atol=1e-5)


def test_panorama_is_seen_clockwise_from_its_left_edge():
    camera = Panorama(PanoramaConfig(width=360, height=100, left_edge=math.pi))
    forward, left, right, up = ([[2.0, 0.0, 0.0]], [[0.0, 2.0, 0.0]], [[0.0, -2.0, 0.0]], [[1.0, 0.0, 0.5]])
    columns, rows = camera.project(np.array(forward + left + right + up)).T
    np.testing.assert_allclose(columns, [179.5, 89.5, 269.5, 179.5], atol=1e-9)
    np.testing.assert_allclose(rows, [49.5, 49.5, 49.5, 49.5 - 0.5 * 360 / (2 * math.pi)], atol=1e-9)


@pytest.mark.parametrize("field", [6.28, 6.283, 6.2832])
def test_full_circle_may_be_rounded(field):
    camera = Panorama(parse(PanoramaConfig, {"field": field}))
    np.testing.assert_array_equal(camera.rays(np.zeros((1, 2))), CAMERAS["full_circle"].rays(np.zeros((1, 2))))


def test_full_panorama_closes():
    camera = CAMERAS["full_circle"]
    assert camera.wraps
    pixels = pixels_of(camera, np.random.default_rng(8))
    for turn in (-camera.width, camera.width, 3 * camera.width):
        np.testing.assert_allclose(camera.rays(pixels + [turn, 0.0]), camera.rays(pixels), atol=1e-12)
    behind = camera.project(np.array([[-3.0, 1e-6, 0.1], [-3.0, -1e-6, 0.1]]))
    np.testing.assert_allclose(behind[:, 0], [-0.5, camera.width - 0.5], atol=1e-3)
    columns = camera.project(np.random.default_rng(9).normal(size=(1000, 3)))[:, 0]
    assert ((columns >= -0.5) & (columns <= camera.width - 0.5)).all()


def test_partial_panorama_has_points_beyond_its_edges_outside():
    camera = CAMERAS["half_circle"]
    assert not camera.wraps
    columns = camera.project(np.array([[-1.0, 0.3, 0.0], [-1.0, -0.6, 0.0], [1.0, 0.5, 0.0]]))[:, 0]
    assert columns[0] < -0.5
    assert columns[1] > camera.width - 0.5
    assert 0.0 < columns[2] < camera.width
    assert np.isnan(camera.rays(np.array([[3000.0, 50.0]]))).all()


def test_straight_up_is_nowhere_in_a_panorama():
    assert np.isnan(CAMERAS["full_circle"].project(np.array([[0.0, 0.0, 1.0]]))).all()


def test_binned_image_sees_the_same(camera):
    half = camera.resized(camera.width // 2, camera.height // 2)
    pixels = pixels_of(half, np.random.default_rng(10))
    same_edge = (pixels + 0.5) * [camera.width / half.width, camera.height / half.height] - 0.5
    np.testing.assert_allclose(half.rays(pixels), camera.rays(same_edge), atol=1e-9)
    assert (half.width, half.height, half.wraps) == (camera.width // 2, camera.height // 2, camera.wraps)
    assert camera.resized(camera.width, camera.height) is camera


def test_image_of_another_shape_has_no_camera(camera):
    for size in ((camera.width, camera.height // 2), (camera.width // 2, camera.height), (0, 0), (-1, -1)):
        with pytest.raises(DataError, match="another shape"):
            camera.resized(*size)


def with_entry(place, value):
    matrix = K.copy()
    matrix[place] = value
    return matrix


@pytest.mark.parametrize("lens", [Pinhole, Fisheye])
@pytest.mark.parametrize(
    "field, arguments",
    [
        ("width 0", (0, 480, K)),
        ("height -3", (640, -3, K)),
        ("K is zero", (640, 480, np.zeros((3, 3)))),
        ("impossible K", (640, 480, with_entry((0, 0), 0.0))),
        ("impossible K", (640, 480, with_entry((1, 1), -500.0))),
        ("impossible K", (640, 480, with_entry((0, 2), np.nan))),
        ("impossible K", (640, 480, with_entry((0, 0), np.inf))),
        ("impossible K", (640, 480, with_entry((0, 1), 0.3))),
        ("impossible K", (640, 480, with_entry((2, 2), 2.0))),
        ("impossible D", (640, 480, K, (0.1,))),
        ("impossible D", (640, 480, K, (0.1, np.nan, 0.0, 0.0))),
        ("impossible D", (640, 480, K, (0.1, np.inf, 0.0, 0.0))),
        ("impossible D", (640, 480, K, (-1e12, 0.0, 0.0, 0.0))),
        ("impossible R", (640, 480, K, (), np.zeros((3, 3)))),
        ("impossible R", (640, 480, K, (), np.diag([1.0, 1.0, -1.0]))),
        ("impossible R", (640, 480, K, (), np.full((3, 3), np.nan))),
    ],
)
def test_impossible_lenses_are_refused_by_field(lens, field, arguments):
    with pytest.raises(DataError, match=field):
        lens(*arguments)


@pytest.mark.parametrize(
    "field, value",
    [("width", 0), ("height", -1), ("field", 0.0), ("field", 7.0), ("horizon", math.nan), ("rows_per_slope", 0.0)],
)
def test_impossible_panoramas_are_refused_by_field(field, value):
    with pytest.raises(ConfigError, match=f"camera/{field}"):
        parse(PanoramaConfig, {field: value}, "camera")


def test_panorama_is_read_from_yaml():
    config = parse(PanoramaConfig, {"width": 800, "field": 3.0, "left_edge": 1.5, "horizon": 70, "rows_per_slope": 250})
    camera = Panorama(config)
    np.testing.assert_allclose(camera.project(np.array([[1.0, 0.0, 0.1]])), [[399.5, 45.0]], atol=1e-9)


@given(coefficients(5, 1e6))
def test_absurd_distortion_is_refused_or_harmless(D):
    try:
        camera = Pinhole(640, 480, K, D)
    except DataError:
        assume(False)
    camera.rays(pixels_of(camera, np.random.default_rng(0), 50))
    camera.project(in_front(np.random.default_rng(0), 50))
