"""Clusters against SciPy's hierarchical linkage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import pdist

from people_fusion.cues.legs import clusters

THRESHOLDS = st.sampled_from([0.05, 0.25, 0.6])


def scipy_clusters(points, method, threshold):
    return clusters.relabel(fcluster(linkage(pdist(points), method), threshold, criterion="distance"))


@st.composite
def random_scans(draw):
    """Points of a scan in polar order: walls of smoothly changing ranges, jumps, noise, gaps."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    beams = draw(st.integers(2, 541))
    angles = np.linspace(-2.3, 2.3, beams)
    depths = rng.uniform(0.3, 6.0, draw(st.integers(1, 40)))
    ranges = np.repeat(depths, -(-beams // len(depths)))[:beams] + rng.normal(0.0, 0.01, beams)
    kept = rng.random(beams) < draw(st.sampled_from([0.5, 0.9, 1.0]))
    points = (ranges[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1))[kept]
    if draw(st.booleans()):
        points = rng.permutation(points)
    return points if len(points) > 1 else rng.uniform(-1.0, 1.0, (2, 2))


lattice = st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=2, max_size=60)


@settings(max_examples=150, deadline=None)
@given(random_scans(), THRESHOLDS)
def test_single_linkage_equals_scipy(points, threshold):
    assert np.array_equal(clusters.single_linkage(points, threshold), scipy_clusters(points, "single", threshold))


@settings(max_examples=150, deadline=None)
@given(random_scans(), THRESHOLDS)
def test_complete_linkage_equals_scipy(points, threshold):
    assert np.array_equal(clusters.complete_linkage(points, threshold), scipy_clusters(points, "complete", threshold))


@pytest.mark.parametrize("linkage_of", [clusters.single_linkage, clusters.complete_linkage])
def test_points_exactly_at_the_threshold_are_joined(linkage_of):
    points = np.array([[0.0, 0.0], [0.25, 0.0], [1.0, 0.0], [1.0, np.nextafter(0.25, 1.0)]])
    assert linkage_of(points, 0.25).tolist() == [0, 0, 1, 2]


@settings(max_examples=150, deadline=None)
@given(lattice)
def test_single_linkage_joins_distances_that_equal_the_threshold_as_scipy_does(cells):
    points = np.array(cells) * 0.05
    for threshold in (0.05, 0.1, float(np.hypot(0.05, 0.1))):
        assert np.array_equal(clusters.single_linkage(points, threshold), scipy_clusters(points, "single", threshold))


@settings(max_examples=150, deadline=None)
@given(lattice)
def test_complete_linkage_of_ties_is_scipys_within_each_single_linkage_cluster(cells):
    points = np.array(cells) * 0.05
    labels, coarse = clusters.complete_linkage(points, 0.25), clusters.single_linkage(points, 0.25)
    for cluster in range(coarse.max() + 1):
        inside = coarse == cluster
        expected = scipy_clusters(points[inside], "complete", 0.25) if inside.sum() > 1 else [0]
        assert np.array_equal(clusters.relabel(labels[inside]), expected)


@settings(max_examples=60, deadline=None)
@given(random_scans(), THRESHOLDS)
def test_dense_points_are_joined_by_cells_with_the_same_result(points, threshold):
    by_cells = clusters._single_linkage_by_cells(points, threshold, clusters.NO_PAIRS)
    assert np.array_equal(by_cells, scipy_clusters(points, "single", threshold))


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 60), st.integers(0, 900))
def test_many_edges_and_few_give_the_same_components(seed, count, edges):
    rng = np.random.default_rng(seed)
    pairs = np.sort(rng.integers(0, count, (edges, 2)), axis=1)
    expected = np.arange(count)
    for _ in range(count):
        for first, second in pairs:
            expected[expected == max(expected[first], expected[second])] = min(expected[first], expected[second])
        if (expected[pairs[:, 0]] == expected[pairs[:, 1]]).all():
            break
    assert np.array_equal(clusters._components(count, pairs), clusters.relabel(expected))


def test_more_points_than_linkage_takes_give_clusters_no_larger_than_the_threshold():
    rng = np.random.default_rng(3)
    points = rng.uniform(0.0, 2.0, (3 * clusters.MAX_LINKAGE_POINTS, 2))
    labels = clusters.complete_linkage(points, 0.25)
    assert all(pdist(points[labels == cluster]).max(initial=0.0) <= 0.25 for cluster in range(labels.max() + 1))
    assert labels.max() + 1 < 1.3 * scipy_clusters(points, "complete", 0.25).max()


def test_ten_thousand_points_in_one_place_are_one_cluster():
    points = np.random.default_rng(4).uniform(0.0, 0.1, (10_000, 2))
    assert not clusters.single_linkage(points, 0.05).any()
    assert not clusters.complete_linkage(points, 0.25).any()


@pytest.mark.parametrize("linkage_of", [clusters.single_linkage, clusters.complete_linkage])
def test_no_point_and_one_point(linkage_of):
    assert linkage_of(np.zeros((0, 2)), 0.25).shape == (0,)
    assert linkage_of(np.zeros((1, 2)), 0.25).tolist() == [0]


def test_joined_points_are_one_cluster_at_any_distance():
    points = np.array([[0.0, 0.0], [5.0, 0.0], [9.0, 0.0], [9.01, 0.0]])
    assert clusters.single_linkage(points, 0.05, np.array([[0, 2]])).tolist() == [0, 1, 0, 0]
