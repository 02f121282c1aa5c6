"""Hierarchical clustering of points in the plane, cut at a distance; the same clusters as SciPy's linkage, faster.

Clusters are given as labels 0, 1, ... in the order in which the clusters' first points appear. Two points (or
clusters) at exactly the threshold are joined, as `scipy.cluster.hierarchy.fcluster(..., criterion="distance")` does.
Where distances tie to the last bit, complete linkage has several solutions; then it is SciPy's for each cluster of
single linkage alone.
"""

from __future__ import annotations

from typing import List, Tuple

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree
from scipy.spatial.distance import pdist

MAX_PAIRS = 2_000_000  # of neighbours that single linkage lists at once: 32 MB
FEW_EDGES = 500  # up to which a loop in Python is quicker than SciPy's sparse graphs
NO_PAIRS = np.zeros((0, 2), dtype=int)
MAX_LINKAGE_POINTS = 1_000  # complete linkage needs memory and time with the square of this


def single_linkage(points: np.ndarray, threshold: float, joined: np.ndarray = NO_PAIRS) -> np.ndarray:
    """Clusters between which the closest points are farther apart than the threshold (Poschmann 2018, 3.1.1).

    Args:
        points: (N, 2) metres; quickest in the order of beams.
        threshold: metres.
        joined: (J, 2) indices of points that belong together at any distance.

    Returns:
        (N,) labels.
    """
    count = len(points)
    if count < 2:
        return np.zeros(count, dtype=int)
    if count**2 > 2 * MAX_PAIRS:
        tree = cKDTree(points)
        if tree.count_neighbors(tree, threshold) > 2 * MAX_PAIRS:
            return _single_linkage_by_cells(points, threshold, joined)
    pairs, _ = pairs_within(points, threshold)
    return _components(count, np.concatenate([pairs, joined]) if len(joined) else pairs)


def pairs_within(points: np.ndarray, threshold: float) -> Tuple[np.ndarray, np.ndarray]:
    """(P, 2) indices of the points (N, 2) at most the threshold apart, lower index first, and their distances (P,)."""
    pairs = cKDTree(points).query_pairs(threshold * (1.0 + 1e-9), output_type="ndarray")
    steps = points[pairs[:, 0]] - points[pairs[:, 1]]
    # The tree compares squares; this is the distance that SciPy's linkage sees, to the last bit.
    distances = np.sqrt(steps[:, 0] * steps[:, 0] + steps[:, 1] * steps[:, 1])
    near = distances <= threshold
    return pairs[near], distances[near]


def complete_linkage(points: np.ndarray, threshold: float) -> np.ndarray:
    """Clusters within which no two points are farther apart than the threshold (Poschmann 2018, 3.1.1).

    Complete linkage never joins what single linkage at the same threshold keeps apart, and joins all that lies within
    the threshold, so that only the clusters of single linkage that are larger than it are left to SciPy. One with more
    than `MAX_LINKAGE_POINTS` points (a scanner close to a wall) is first halved across its longer side until its parts
    are small enough: no cluster exceeds the threshold then either, but some are cut where halves meet.

    Args:
        points: (N, 2) metres.
        threshold: metres.

    Returns:
        (N,) labels.
    """
    labels = single_linkage(points, threshold)
    if not len(labels):
        return labels
    members, starts = by_label(labels)
    low, high = np.minimum.reduceat(points[members], starts), np.maximum.reduceat(points[members], starts)
    wide = np.flatnonzero(((high - low) ** 2).sum(axis=1) > threshold**2)
    if not len(wide):
        return labels
    clusters = np.split(members, starts[1:])
    for cluster in wide:
        for part in _halved(points, clusters[cluster]):
            cut = fcluster(linkage(pdist(points[part]), "complete"), threshold, criterion="distance")
            labels[part] = labels.max() + cut
    return relabel(labels)


def by_label(labels: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Indices of the points sorted by label, and where each label starts in them; labels are 0 ... L - 1, N > 0."""
    members = np.argsort(labels, kind="stable")
    return members, np.flatnonzero(np.diff(labels[members], prepend=-1))


def means(values: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """(L, 2) average of the (N, 2) values of each label 0 ... L - 1."""
    count = np.bincount(labels)
    return np.stack([np.bincount(labels, values[:, axis]) / count for axis in range(2)], axis=1)


def least(values: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """(L,) smallest of the (N,) values of each label 0 ... L - 1."""
    smallest = np.full(labels.max(initial=-1) + 1, np.inf)
    np.minimum.at(smallest, labels, values)
    return smallest


def relabel(labels: np.ndarray) -> np.ndarray:
    """The same clusters with labels 0, 1, ... by first appearance."""
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=int)
    rank[np.argsort(first)] = np.arange(len(first))
    return rank[inverse]


def _components(count: int, pairs: np.ndarray) -> np.ndarray:
    """Labels of the connected parts of a graph with edges (P, 2)."""
    if not len(pairs):
        return np.arange(count)
    # Neighbours in order are joined first: of a scan, few edges are left then.
    apart = np.ones(count, dtype=bool)
    apart[pairs[pairs[:, 1] - pairs[:, 0] == 1, 1]] = False
    run_of = np.cumsum(apart) - 1
    runs = int(run_of[-1]) + 1
    edges = run_of[pairs[:, 0]] * runs + run_of[pairs[:, 1]]
    edges = np.unique(edges[run_of[pairs[:, 0]] != run_of[pairs[:, 1]]])
    if not len(edges):
        return run_of
    first, second = np.divmod(edges, runs)
    if len(edges) <= FEW_EDGES:
        return _union(runs, first, second)[run_of]
    graph = coo_matrix((np.ones(len(edges), dtype=np.int8), (first, second)), shape=(runs, runs))
    return connected_components(graph, directed=False)[1].astype(int)[run_of]


def _union(count: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The same for a few edges; SciPy's sparse graphs take 0.2 ms before the first one."""
    root = list(range(count))
    for a, b in zip(first.tolist(), second.tolist()):
        while root[a] != a:
            a = root[a]
        while root[b] != b:
            b = root[b]
        root[max(a, b)] = min(a, b)
    for node in range(count):  # a root is never after its nodes
        root[node] = root[root[node]]
    return relabel(np.array(root))


def _single_linkage_by_cells(points: np.ndarray, threshold: float, joined: np.ndarray) -> np.ndarray:
    """The same for points so dense that listing all neighbours would not fit: whatever lies in one small cell is
    one cluster already, so that cells are joined instead of points."""
    edge = 0.7 * threshold
    cells, cell_of = np.unique(np.floor(points / edge).astype(int), axis=0, return_inverse=True)
    cell_of = cell_of.ravel()
    members, starts = by_label(cell_of)
    trees = [cKDTree(points[part]) for part in np.split(members, starts[1:])]
    close = [
        (first, second)
        for first, second in cKDTree(cells).query_pairs(threshold / edge + 1.5)  # plus a cell's diagonal
        if trees[first].query(trees[second].data)[0].min() <= threshold
    ]
    pairs = np.concatenate([np.array(close, dtype=int).reshape(-1, 2), cell_of[joined]])
    return relabel(_components(len(cells), pairs)[cell_of])


def _halved(points: np.ndarray, members: np.ndarray) -> List[np.ndarray]:
    if len(members) <= MAX_LINKAGE_POINTS:
        return [members]
    extent = np.ptp(points[members], axis=0)
    order = np.argsort(points[members, int(extent[1] > extent[0])], kind="stable")
    middle = len(members) // 2
    return _halved(points, np.sort(members[order[:middle]])) + _halved(points, np.sort(members[order[middle:]]))
