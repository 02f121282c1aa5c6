import numpy as np
import pytest

from people_fusion.simulation import rays
from people_fusion.simulation.planar import direction

NO_SEGMENTS = np.zeros((0, 2, 2))
WALL = np.array([[[2.0, -5.0], [2.0, 5.0]]])  # x = 2


def cast(angles, segments=NO_SEGMENTS, centres=(), radii=()):
    origins = np.zeros((len(angles), 2))
    moved = np.broadcast_to(np.reshape(centres, (-1, 2)), (len(angles), len(radii), 2))
    return rays.cast(origins, direction(np.asarray(angles)), segments, moved, np.array(radii))


def test_wall_is_hit_at_its_distance_over_the_cosine():
    angles = np.linspace(-1.1, 1.1, 23)
    ranges, hits, cosines = cast(angles, WALL)
    np.testing.assert_allclose(ranges, 2.0 / np.cos(angles), atol=1e-12)
    np.testing.assert_allclose(cosines, np.cos(angles), atol=1e-12)
    assert (hits == 0).all()


def test_beams_beside_behind_and_parallel_to_a_wall_hit_nothing():
    ranges, hits, _ = cast([1.5, np.pi, np.pi / 2.0], WALL)
    assert np.isinf(ranges).all()
    assert (hits == -1).all()


def test_circle_is_hit_where_the_quadratic_equation_says():
    angles = np.linspace(-0.09, 0.09, 19)
    ranges, _, cosines = cast(angles, centres=[(3.0, 0.0)], radii=[0.3])
    expected = 3.0 * np.cos(angles) - np.sqrt(0.3**2 - (3.0 * np.sin(angles)) ** 2)
    np.testing.assert_allclose(ranges, expected, atol=1e-12)
    np.testing.assert_allclose(0.3 * np.sqrt(1.0 - cosines**2), np.abs(3.0 * np.sin(angles)), atol=1e-7)


def test_beams_beside_a_circle_miss_it():
    assert np.isinf(cast([0.11, -0.11, np.pi], centres=[(3.0, 0.0)], radii=[0.3])[0]).all()


def test_nearest_of_several_is_hit():
    ranges, hits, _ = cast([0.0], WALL, centres=[(5.0, 0.0), (1.0, 0.0)], radii=[0.1, 0.1])
    assert ranges[0] == pytest.approx(0.9)
    assert hits[0] == 2  # one segment, then the second circle


def test_each_beam_meets_the_circles_where_they_are_at_its_time():
    origins, directions = np.zeros((2, 2)), direction(np.zeros(2))
    centres = np.array([[[1.0, 0.0]], [[2.0, 0.0]]])
    ranges, _, _ = rays.cast(origins, directions, NO_SEGMENTS, centres, np.array([0.1]))
    np.testing.assert_allclose(ranges, [0.9, 1.9])


def test_empty_world_returns_nothing():
    ranges, hits, _ = cast([0.0, 1.0])
    assert np.isinf(ranges).all()
    assert (hits == -1).all()
