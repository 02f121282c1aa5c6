"""Particle filters of many tracks at once: states (T, N, D) and weights (T, N), of each track N particles.

A bootstrap filter (Gordon, Salmond & Smith 1993; Poschmann 2018, 6.2): particles move by the motion model, are weighed
by what was measured, and are drawn anew where their weight has gathered in few of them.
"""

from __future__ import annotations

from typing import Tuple

import numpy as np

from people_fusion.core.resampling import systematic


def predict(states: np.ndarray, transition: np.ndarray, noise: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(T, N, D) after a step with `transition` F and noise drawn from Q, both (D, D) (Poschmann eq. 7.1)."""
    return states @ transition.T + rng.standard_normal(states.shape) @ root(noise).T


def draw(means: np.ndarray, covariances: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """(T, count, D) particles of Gaussians (T, D) and (T, D, D)."""
    size = (len(means), count, means.shape[1])
    return means[:, None] + rng.standard_normal(size) @ root(covariances).swapaxes(-1, -2)


def weighed(weights: np.ndarray, log_likelihoods: np.ndarray) -> np.ndarray:
    """(T, N) weights times likelihoods, of each track summing to 1; as before where no particle is possible."""
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(weights) + log_likelihoods
        best = logs.max(axis=1, keepdims=True, initial=-np.inf)
        new = np.exp(logs - best)
        new /= new.sum(axis=1, keepdims=True)
    return np.where(np.isfinite(best), new, weights)


def effective_size(weights: np.ndarray) -> np.ndarray:
    """(T,) how many particles of equal weight would tell as much: 1 / sum w^2 (Kong, Liu & Wong 1994)."""
    return np.asarray(1.0 / np.square(weights).sum(axis=1))


def summary(states: np.ndarray, weights: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
    """Means (T, D) and covariances (T, D, D) of the particles."""
    means = (weights[:, None] @ states)[:, 0]
    centred = states - means[:, None]
    return means, (centred * weights[..., None]).swapaxes(1, 2) @ centred


def resampled(
    states: np.ndarray, weights: np.ndarray, rng: np.random.Generator, below: float, roughening: float
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Tracks whose effective size has fallen below a share of N, drawn anew by systematic resampling.

    So that no two particles are the same, each is drawn towards the mean and moved by noise of the particles' own
    covariance, which thereby stays what it is (Liu & West 2001).

    Args:
        states, weights: see the module.
        rng: takes one number of every track, and noise for those that are drawn anew.
        below: share of N.
        roughening: standard deviation of that noise as a share of the particles' own.

    Returns:
        states, weights, and (T, N) the particle that each was drawn from.
    """
    tracks, count = weights.shape
    chosen = np.repeat(np.arange(count)[None], tracks, axis=0)
    poor = effective_size(weights) < below * count
    offsets = rng.random(tracks)
    if not poor.any():
        return states, weights, chosen
    chosen[poor] = systematic(weights[poor], offsets[poor])
    states, weights = states.copy(), weights.copy()
    means, covariances = summary(states[poor], weights[poor])
    drawn = np.take_along_axis(states[poor], chosen[poor, :, None], axis=1)
    noise = draw(np.zeros_like(means), roughening**2 * covariances, count, rng)
    states[poor] = means[:, None] + np.sqrt(1.0 - roughening**2) * (drawn - means[:, None]) + noise
    weights[poor] = 1.0 / count
    return states, weights, chosen


def root(covariances: np.ndarray) -> np.ndarray:
    """(..., D, D) A with A A' = C, of covariances that may be singular."""
    values, vectors = np.linalg.eigh(covariances)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[..., None, :])
