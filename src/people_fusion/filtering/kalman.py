"""Kalman filters of many tracks at once: all functions work on arrays with one row per track."""

from __future__ import annotations

from typing import Tuple

import numpy as np


def predict(
    means: np.ndarray, covariances: np.ndarray, transition: np.ndarray, noise: np.ndarray
) -> Tuple[np.ndarray, np.ndarray]:
    """Means (T, D) and covariances (T, D, D) after a step with `transition` F and `noise` Q, both (D, D)."""
    return means @ transition.T, transition @ covariances @ transition.T + noise


def update(
    means: np.ndarray,
    covariances: np.ndarray,
    innovations: np.ndarray,
    observation: np.ndarray,
    innovation_covariances: np.ndarray,
) -> Tuple[np.ndarray, np.ndarray]:
    """Means and covariances after one measurement each.

    Args:
        means: (M, D) predicted.
        covariances: (M, D, D) predicted.
        innovations: (M, m) measurement minus prediction.
        observation: (m, D) H.
        innovation_covariances: (M, m, m) S = H P H' + R.
    """
    cross = covariances @ observation.T
    gain = _gain(cross, innovation_covariances)
    means = means + (gain @ innovations[..., None])[..., 0]
    return means, _symmetric(covariances - gain @ cross.swapaxes(-1, -2))


def consider_innovation_covariances(
    covariances: np.ndarray,
    cross_covariances: np.ndarray,
    observation: np.ndarray,
    bias_jacobians: np.ndarray,
    bias_covariance: np.ndarray,
    noises: np.ndarray,
) -> np.ndarray:
    """(M, m, m) covariance of the innovations where measurements share a bias that is considered, not estimated.

    Schmidt 1966:  S = H P H' + H C J' + J C' H' + J B J' + R.

    Args:
        covariances: (M, D, D) P of the states.
        cross_covariances: (M, D, b) C of the states' errors (truth minus estimate) with the bias b in z = H x + J b.
        observation: (m, D) H.
        bias_jacobians: (M, m, b) J.
        bias_covariance: (b, b) B.
        noises: (M, m, m) R.
    """
    mixed = observation @ cross_covariances @ bias_jacobians.swapaxes(-1, -2)
    return (
        observation @ covariances @ observation.T
        + mixed
        + mixed.swapaxes(-1, -2)
        + bias_jacobians @ bias_covariance @ bias_jacobians.swapaxes(-1, -2)
        + noises
    )


def consider_update(
    means: np.ndarray,
    covariances: np.ndarray,
    cross_covariances: np.ndarray,
    innovations: np.ndarray,
    observation: np.ndarray,
    bias_jacobians: np.ndarray,
    bias_covariance: np.ndarray,
    innovation_covariances: np.ndarray,
) -> Tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means, covariances and cross-covariances after one measurement each; the bias itself is left as it is.

    Arguments as in `update` and `consider_innovation_covariances`.
    """
    cross = covariances @ observation.T + cross_covariances @ bias_jacobians.swapaxes(-1, -2)
    gain = _gain(cross, innovation_covariances)
    means = means + (gain @ innovations[..., None])[..., 0]
    covariances = _symmetric(covariances - gain @ cross.swapaxes(-1, -2))
    bias_part = observation @ cross_covariances + bias_jacobians @ bias_covariance
    return means, covariances, cross_covariances - gain @ bias_part


def consider_fading(before: np.ndarray, now: np.ndarray) -> np.ndarray:
    """(b, b) F, by which a considered bias of covariance `before` is carried on to one of covariance `now`.

    F is the largest part of the old bias that the new one can hold, F before F' <= now, so that P, C F' and `now`
    remain a covariance. Along directions in which the bias has not shrunk F leaves it as it is.
    """
    variances, axes = np.linalg.eigh(now)
    known = variances > 1e-12 * max(variances[-1], 1e-30)
    std = np.sqrt(variances[known])
    colour, whiten = axes[:, known] * std, axes[:, known].T / std[:, None]
    ratios, directions = np.linalg.eigh(whiten @ before @ whiten.T)
    return colour @ (directions / np.sqrt(np.maximum(ratios, 1.0))) @ directions.T @ whiten


def _gain(cross: np.ndarray, innovation_covariances: np.ndarray) -> np.ndarray:
    return np.linalg.solve(innovation_covariances, cross.swapaxes(-1, -2)).swapaxes(-1, -2)


def _symmetric(covariances: np.ndarray) -> np.ndarray:
    return (covariances + covariances.swapaxes(-1, -2)) / 2
