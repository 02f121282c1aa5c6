"""Covariances between image and space against Monte Carlo; people's boxes against geometry."""

import math

import numpy as np
import pytest

from people_fusion.core.camera_models import Fisheye, Panorama, PanoramaConfig, Pinhole
from people_fusion.core.poses import Pose
from people_fusion.core.sightings import ALONG_RAY, across, along, person_boxes, pixels_of_points, points_of_pixels

K = np.array([[525.0, 0.0, 313.0], [0.0, 530.0, 236.5], [0.0, 0.0, 1.0]])
WIDE_K = np.array([[200.0, 0.0, 318.0], [0.0, 201.0, 241.0], [0.0, 0.0, 1.0]])
CAMERAS = {
    "pinhole": Pinhole(640, 480, K, (-0.28, 0.09, 0.0012, -0.0007, -0.01)),
    "fisheye": Fisheye(640, 480, WIDE_K, (-0.02, 0.006, -0.003, 0.0004)),
    "panorama": Panorama(PanoramaConfig()),
}
UP = np.array([0.0, -math.cos(0.3), -math.sin(0.3)])  # of an optical frame that looks down a little
PIXEL_COVARIANCE = np.array([[9.0, 3.0], [3.0, 6.0]])
LEVEL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])  # world_from_camera, looks along x
SAMPLES = 200_000


@pytest.fixture(params=sorted(CAMERAS))
def camera(request):
    return CAMERAS[request.param]


def relative(covariance, samples):
    """How far a covariance is from that of samples, per standard deviation of the samples in any direction."""
    root = np.linalg.inv(np.linalg.cholesky(np.cov(samples.T)))
    return np.abs(np.linalg.eigvalsh(root @ covariance @ root.T) - 1.0).max()


@pytest.mark.parametrize(
    "measured", [ALONG_RAY, along(np.array([0.0, 0.0, 1.0])), across(UP)], ids=["ray", "z", "floor"]
)
def test_points_spread_as_pixels_and_distances_do(measured):
    rng = np.random.default_rng(1)
    pixel, distance, variance = np.array([500.0, 130.0]), 4.0, 0.3**2
    camera = CAMERAS["pinhole"]
    (point,), (covariance,) = points_of_pixels(
        camera, pixel[None], PIXEL_COVARIANCE[None], np.array([distance]), np.array([variance]), measured
    )
    assert np.linalg.norm(measured @ point) == pytest.approx(distance)
    np.testing.assert_allclose(camera.project(point[None])[0], pixel, atol=1e-8)
    pixels = rng.multivariate_normal(pixel, PIXEL_COVARIANCE, SAMPLES)
    distances = rng.normal(distance, math.sqrt(variance), SAMPLES)
    nothing = np.zeros(SAMPLES)
    samples, _ = points_of_pixels(camera, pixels, np.zeros((SAMPLES, 2, 2)), distances, nothing, measured)
    assert relative(covariance, samples) < 0.03
    assert (np.abs(samples.mean(axis=0) - point) < 0.02 * np.sqrt(np.diagonal(covariance))).all()


def test_pixels_spread_as_points_do(camera):
    rng = np.random.default_rng(2)
    ray = camera.rays(np.array([[0.7 * camera.width, 0.3 * camera.height]]))[0]
    root = 0.1 * rng.normal(size=(3, 3))
    point, covariance = 4.0 * ray, root @ root.T + 0.01 * np.eye(3)
    pixels, covariances = pixels_of_points(camera, point[None], covariance[None])
    samples = camera.project(rng.multivariate_normal(point, covariance, SAMPLES))
    assert relative(covariances[0], samples) < 0.06
    np.testing.assert_allclose(pixels, camera.project(point[None]))


def test_distance_does_not_blur_a_pixel(camera):
    """There and back again: a distance that is good to a quarter leaves the pixel's covariance as it was."""
    pixels = np.array([[0.6 * camera.width, 0.45 * camera.height]])
    points, covariances = points_of_pixels(camera, pixels, PIXEL_COVARIANCE[None], np.array([3.0]), np.array([0.5]))
    back, spread = pixels_of_points(camera, points, covariances)
    np.testing.assert_allclose(back, pixels, atol=1e-7)
    np.testing.assert_allclose(spread[0], PIXEL_COVARIANCE, rtol=1e-6)


def test_first_order_is_as_good_as_it_says_for_distances_good_to_a_quarter():
    rng = np.random.default_rng(3)
    camera, pixel, distance, std = CAMERAS["pinhole"], np.array([500.0, 130.0]), 4.0, 1.0
    (point,), (covariance,) = points_of_pixels(
        camera, pixel[None], PIXEL_COVARIANCE[None], np.array([distance]), np.array([std**2]), across(UP)
    )
    pixels = rng.multivariate_normal(pixel, PIXEL_COVARIANCE, SAMPLES)
    distances = np.clip(rng.normal(distance, std, SAMPLES), 0.5, None)
    zeros = np.zeros((SAMPLES, 2, 2))
    samples, _ = points_of_pixels(camera, pixels, zeros, distances, np.zeros(SAMPLES), across(UP))
    assert relative(covariance, samples) < 0.1
    bias = samples.mean(axis=0) - point
    assert bias @ np.linalg.solve(covariance, bias) < 0.01**2


@pytest.mark.parametrize("std, low, high", [(0.4, 0.0, 0.05), (0.6, 0.0, 0.1), (1.0, 0.15, 0.35)])
def test_pixels_of_points_of_doubtful_distance_spread_more_than_said(std, low, high):
    """Unlike those of a sighting, the point's errors along and across the ray are independent here."""
    rng = np.random.default_rng(4)
    camera = CAMERAS["pinhole"]
    point = 4.0 * camera.rays(np.array([[500.0, 130.0]]))
    outer = point.T @ point / 16.0
    spread = std**2 * outer + 0.03**2 * (np.eye(3) - outer)
    _, (said,) = pixels_of_points(camera, point, spread[None])
    seen = camera.project(rng.multivariate_normal(point[0], spread, SAMPLES))
    assert low < relative(said, seen[np.isfinite(seen).all(axis=1)]) < high


def test_sighting_without_a_distance_is_no_point(camera):
    pixels = np.array([[100.0, 100.0]] * 3)
    points, covariances = points_of_pixels(
        camera, pixels, np.array([np.eye(2)] * 3), np.array([0.0, -1.0, np.nan]), np.ones(3)
    )
    assert np.isnan(points).all()
    assert np.isnan(covariances).any(axis=(1, 2)).all()


def boxes_of(camera, pose, tops, height=1.8, width=0.5):
    tops = np.array(tops, dtype=float)
    return person_boxes(camera, pose, tops, np.full(len(tops), height), np.full(len(tops), width))


def test_standing_person_is_seen_from_head_to_ground():
    camera = Pinhole(640, 480, K)
    pose = Pose(LEVEL, np.array([0.0, 0.0, 1.2]))
    ((left, top, right, bottom),) = boxes_of(camera, pose, [[5.0, 0.3, 1.8]])
    column = K[0, 2] - K[0, 0] * 0.3 / 5.0 + 0.5
    # The near rim of the end that is beyond the horizon; the cylinder is tangent to its outer rays.
    assert top == pytest.approx(K[1, 2] - K[1, 1] * 0.6 / 4.75 + 0.5, abs=0.3)
    assert bottom == pytest.approx(K[1, 2] + K[1, 1] * 1.2 / 4.75 + 0.5, abs=0.5)
    bearing, half = math.atan2(-0.3, 5.0), math.asin(0.25 / math.hypot(5.0, 0.3))
    assert left == pytest.approx(K[0, 2] + 0.5 + K[0, 0] * math.tan(bearing - half), abs=0.5)
    assert right == pytest.approx(K[0, 2] + 0.5 + K[0, 0] * math.tan(bearing + half), abs=0.5)
    assert left < column < right


def test_box_of_half_the_height_is_half_as_wide():
    """Volkhardt's boxes, for a person far away and a level camera at half the height."""
    pose = Pose(LEVEL, np.array([0.0, 0.0, 0.9]))
    ((left, top, right, bottom),) = boxes_of(Pinhole(640, 480, K), pose, [[20.0, 0.0, 1.8]], 1.8, 0.9)
    assert (right - left) / K[0, 0] == pytest.approx(0.5 * (bottom - top) / K[1, 1], rel=0.03)


def test_people_who_are_not_in_the_image_have_no_box():
    pose = Pose(LEVEL, np.array([0.0, 0.0, 1.2]))
    tops = [[-5.0, 0.0, 1.8], [3.0, 9.0, 1.8], [5.0, 0.0, 1.8], [np.nan, 0.0, 1.8]]
    for camera in (Pinhole(640, 480, K), CAMERAS["pinhole"]):
        boxes = boxes_of(camera, pose, tops)
        assert np.isnan(boxes[[0, 1, 3]]).all()
        assert np.isfinite(boxes[2]).all()


def test_near_person_reaches_beyond_the_image():
    camera = CAMERAS["pinhole"]
    ((left, top, right, bottom),) = boxes_of(camera, Pose(LEVEL, np.array([0.0, 0.0, 1.2])), [[0.8, 0.0, 1.8]])
    assert top < 0.0
    assert bottom > camera.height
    assert 0.0 < left < right < camera.width


def test_person_on_the_seam_of_a_panorama_has_one_box():
    camera = Panorama(PanoramaConfig(width=1000))
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 1.5]))
    boxes = boxes_of(camera, pose, [[-4.0, 0.05, 1.8], [-4.0, -0.05, 1.8], [4.0, 0.0, 1.8]])
    widths = boxes[:, 2] - boxes[:, 0]
    np.testing.assert_allclose(widths, 2.0 * math.asin(0.25 / 4.0) * 1000 / (2.0 * math.pi), atol=0.3)
    middles = 0.5 * (boxes[:, 0] + boxes[:, 2])
    shift = 0.05 / 4.0 * 1000 / (2.0 * math.pi)
    np.testing.assert_allclose(middles, [shift, 1000.0 - shift, 500.0], atol=0.1)


def test_person_behind_half_a_panorama_has_no_box():
    camera = Panorama(PanoramaConfig(700, 200, 1.5, 3.0))
    pose = Pose(np.eye(3), np.array([0.0, 0.0, 1.5]))
    boxes = boxes_of(camera, pose, [[-4.0, 0.0, 1.8], [4.0, 0.0, 1.8]])
    assert np.isnan(boxes[0]).all()
    assert np.isfinite(boxes[1]).all()


def test_nobody_has_no_boxes(camera):
    assert boxes_of(camera, Pose.identity(), np.zeros((0, 3))).shape == (0, 4)
