import numpy as np
import pytest
from scenes import scene

from people_fusion.core.errors import DataError
from people_fusion.core.tracks import Tracks
from people_fusion.evaluation.evaluate import evaluate
from people_fusion.evaluation.truth import Estimates, Truth


def tracks_at(stamp_ns, ids, confirmed, size=5):
    count = len(ids)
    means = np.arange(count * size, dtype=float).reshape(count, size)
    covariances = np.tile(np.eye(size), (count, 1, 1))
    flags, no = np.array(confirmed, dtype=bool), np.zeros(count, dtype=bool)
    return Tracks(stamp_ns, "map", np.array(ids), means, covariances, no + 0.5, flags, no, no, np.zeros(count))


def test_estimates_take_confirmed_tracks_only():
    snapshots = [tracks_at(0, [1, 2], [True, False]), tracks_at(1, [], []), tracks_at(2, [2, 3], [True, True])]
    estimates = Estimates.from_tracks(snapshots)
    assert estimates.frames.tolist() == [0, 2, 2]
    assert estimates.ids.tolist() == [1, 2, 3]
    assert estimates.covariances.shape == (3, 5, 5)
    assert len(Estimates.from_tracks(snapshots, confirmed_only=False).ids) == 4


def test_estimates_of_a_tracker_that_never_reported_anybody_are_empty():
    estimates = Estimates.from_tracks([tracks_at(0, [], []), tracks_at(1, [7], [False])])
    assert len(estimates.ids) == 0
    assert evaluate(Truth.from_frames([0, 1], [[1], [1]], [[(0, 0)], [(0, 0)]]), estimates).scores.clear_mot.misses == 2


def test_rows_of_frames_lie_between_bounds():
    truth, estimates = scene([({1: (0, 0), 2: (1, 1)}, {}), ({}, {5: (0, 0)}), ({1: (0, 0)}, {5: (0, 0)})])
    assert truth.bounds().tolist() == [0, 2, 2, 3]
    assert estimates.bounds(3).tolist() == [0, 0, 1, 2]


@pytest.mark.parametrize("size, axes", [(2, None), (3, None), (4, (2, 3)), (5, (3, 4)), (6, (3, 4))])
def test_velocity_is_found_in_each_state(size, axes):
    assert Estimates.from_frames([[1]], [np.zeros((1, size))]).velocity_axes == axes


@pytest.mark.parametrize(
    "stamps, ids, positions, message",
    [
        ([0, 1], [[1], [2, 2]], [[(0, 0)], [(0, 0), (1, 1)]], "twice in a frame: 2 in frame 1"),
        ([1, 1], [[1], [1]], [[(0, 0)], [(0, 0)]], "do not increase"),
        ([0], [[1]], [[(0, np.nan)]], "not finite: row 0"),
        ([0], [[1, 2]], [[(0, 0)]], "different lengths"),
        ([0], [[1], [1]], [[(0, 0)], [(0, 0)]], "outside the frames"),
        ([0], [[1]], [[(0, 0, 0, 0)]], "not .N, 2. or .N, 3."),
    ],
)
def test_unusable_truth_is_refused(stamps, ids, positions, message):
    with pytest.raises(DataError, match=message):
        Truth.from_frames(stamps, ids, positions)


def test_unusable_estimates_are_refused():
    with pytest.raises(DataError, match="twice"):
        Estimates.from_frames([[1, 1]], [np.zeros((2, 2))])
    with pytest.raises(DataError, match="no known state"):
        Estimates.from_frames([[1]], [np.zeros((1, 7))])
    with pytest.raises(DataError, match="covariances do not fit"):
        Estimates.from_frames([[1]], [np.zeros((1, 3))], [np.eye(2)[None][:, :1]])
    truth, _ = scene([({1: (0, 0)}, {})])
    with pytest.raises(DataError, match="outside the frames"):
        evaluate(truth, Estimates(np.array([1]), np.array([1]), np.zeros((1, 2))))
