import numpy as np
import pytest
from scipy.stats import chi2

from people_fusion.core.errors import DataError
from people_fusion.evaluation.clear_mot import match
from people_fusion.evaluation.consistency import (
    Consistency,
    average_nees,
    chi_square_band,
    normalised_squares,
    position_nees,
    state_nees,
)
from people_fusion.evaluation.truth import Estimates, Truth


def draws(rng, *shape, dimension=2):
    root = rng.normal(size=(*shape, dimension, dimension)) + 2.0 * np.eye(dimension)
    errors = (root @ rng.normal(size=(*shape, dimension, 1)))[..., 0]
    return errors, root @ np.swapaxes(root, -1, -2)


def test_normalised_square_of_a_hand_worked_error():
    assert normalised_squares(np.array([0.2, 0.3]), np.diag([0.04, 0.01])) == pytest.approx(1.0 + 9.0)
    correlated = np.array([[2.0, 1.0], [1.0, 2.0]])
    assert normalised_squares(np.array([1.0, 1.0]), correlated) == pytest.approx(2.0 / 3.0)


def test_normalised_squares_of_honest_covariances_follow_chi_square():
    errors, covariances = draws(np.random.default_rng(1), 20_000, dimension=4)
    squares = normalised_squares(errors, covariances)
    assert squares.mean() == pytest.approx(4.0, abs=0.1)
    assert np.mean(squares < chi2.ppf(0.9, 4)) == pytest.approx(0.9, abs=0.01)


def test_covariance_that_is_not_positive_definite_is_refused():
    with pytest.raises(DataError, match="not positive definite: lowest eigenvalue -1"):
        normalised_squares(np.zeros((2, 2)), np.stack([np.eye(2), np.diag([1.0, -1.0])]))


def test_band_of_one_hundred_runs_is_the_textbook_one():
    # Bar-Shalom et al. 2001, example 5.4.2: 50 runs, two dimensions: [1.5, 2.6].
    assert chi_square_band(2, 50) == pytest.approx((1.48, 2.59), abs=0.01)
    assert chi_square_band(2, 1) == pytest.approx((0.0506, 7.378), abs=1e-3)


def test_average_over_runs_stays_in_the_band_when_honest_and_leaves_it_when_not():
    errors, covariances = draws(np.random.default_rng(2), 100, 300)
    average, share = average_nees(normalised_squares(errors, covariances), 2)
    assert average.shape == (300,)
    assert share == pytest.approx(0.95, abs=0.04)
    assert average_nees(normalised_squares(errors, covariances / 2.0), 2)[1] < 0.01


def one_person(means, velocities=None, covariance=None):
    frames = len(means)
    truth = Truth.from_frames(range(frames), [[1]] * frames, [[(0.0, 0.0)]] * frames, velocities)
    covariances = None if covariance is None else [covariance[None]] * frames
    return truth, Estimates.from_frames([[7]] * frames, [np.array([mean]) for mean in means], covariances)


def test_nees_of_pairs_takes_the_plane_of_positions_and_velocities():
    covariance = np.diag([0.01, 0.04, 99.0, 0.25, 1.0])
    truth, estimates = one_person([(0.1, 0.2, 5.0, 1.5, 1.0)], [[(1.0, 0.0)]], covariance)
    events = match(truth, estimates)
    assert position_nees(truth, estimates, events).tolist() == pytest.approx([2.0])
    assert state_nees(truth, estimates, events).tolist() == pytest.approx([2.0 + 1.0 + 1.0])


def test_nees_is_missing_where_there_is_no_pair_no_covariance_or_no_velocity():
    covariance = np.eye(5)
    truth, estimates = one_person([(0, 0, 0, 0, 0), (9, 9, 0, 0, 0)], [[(np.nan, 0)], [(0, 0)]], covariance)
    events = match(truth, estimates)
    assert np.isfinite(position_nees(truth, estimates, events)).tolist() == [True, False, False]
    assert not np.isfinite(state_nees(truth, estimates, events)).any()
    truth, estimates = one_person([(0.0, 0.0)])
    assert np.isnan(position_nees(truth, estimates, match(truth, estimates))).all()


def test_consistency_of_runs_is_added():
    both = Consistency.of(np.array([1.0, np.nan, 9.0]), 2) + Consistency.of(np.array([2.0]), 2)
    assert (both.count, both.average, both.inside) == (3, 4.0, 2)
    assert both.inside_share == pytest.approx(2 / 3)
    assert Consistency(2).average is None
