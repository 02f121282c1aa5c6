"""core.resampling."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from people_fusion.core.resampling import systematic

ONE_BELOW = float(np.nextafter(1.0, 0.0))


@given(
    tracks=st.integers(1, 5),
    count=st.integers(1, 60),
    seed=st.integers(0, 2**32 - 1),
    offset=st.sampled_from([0.0, 1e-300, 0.5, ONE_BELOW]) | st.floats(0.0, ONE_BELOW),
)
def test_a_particle_is_drawn_as_often_as_its_weight_says_within_one(tracks, count, seed, offset):
    rng = np.random.default_rng(seed)
    weights = rng.random((tracks, count)) * (rng.random((tracks, count)) < 0.5)
    weights[:, rng.integers(count)] += 0.1
    drawn = systematic(weights, np.full(tracks, offset))
    assert drawn.shape == (tracks, count)
    for row, chosen in zip(weights, drawn):
        expected = count * row / row.sum()
        assert (np.diff(chosen) >= 0).all()
        assert (np.abs(np.bincount(chosen, minlength=count) - expected) < 1.0 + 1e-9).all()
        assert (row[chosen] > 0.0).all()


def test_on_average_a_particle_is_drawn_in_proportion_to_its_weight():
    weights = np.array([[0.31, 0.02, 0.45, 0.0, 0.22]])
    offsets = (np.arange(1000) + 0.5) / 1000
    drawn = systematic(np.repeat(weights, 1000, axis=0), offsets)
    np.testing.assert_allclose(np.bincount(drawn.ravel(), minlength=5) / drawn.size, weights[0], atol=1e-3)


def test_rows_do_not_influence_each_other():
    rng = np.random.default_rng(1)
    weights, offsets = rng.random((7, 30)), rng.random(7)
    alone = [systematic(weights[row : row + 1], offsets[row : row + 1])[0] for row in range(7)]
    np.testing.assert_array_equal(systematic(weights, offsets), alone)


def test_no_tracks_need_no_particles():
    assert systematic(np.zeros((0, 10)), np.zeros(0)).shape == (0, 10)
