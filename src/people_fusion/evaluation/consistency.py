"""Whether covariances are as large as the errors: NEES, NIS and chi-square bands (Bar-Shalom et al. 2001, 5.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Tuple

import numpy as np
from scipy.stats import chi2

from people_fusion.core.errors import DataError
from people_fusion.evaluation.clear_mot import Events, ratio
from people_fusion.evaluation.truth import Estimates, Truth

BAND_PROBABILITY = 0.95


def normalised_squares(errors: np.ndarray, covariances: np.ndarray) -> np.ndarray:
    """e' C^-1 e, for each error.

    With the errors of estimates and their covariances it is the NEES, with innovations and their covariances the NIS.
    If the covariances are honest, it follows a chi-square distribution of D degrees of freedom, whose mean is D.

    Args:
        errors: (..., D).
        covariances: (..., D, D).

    Returns:
        (...) without unit.

    Raises:
        DataError: if a covariance is not positive definite.
    """
    try:
        lower = np.linalg.cholesky(covariances)
    except np.linalg.LinAlgError as error:
        lowest = np.linalg.eigvalsh(covariances)[..., 0].min()
        raise DataError("covariance is not positive definite", f"lowest eigenvalue {lowest:g}") from error
    whitened = np.linalg.solve(lower, errors[..., None])[..., 0]
    return np.sum(whitened * whitened, axis=-1)


def chi_square_band(dimension: int, count: int, probability: float = BAND_PROBABILITY) -> Tuple[float, float]:
    """Bounds that the mean of `count` independent normalised squares keeps with the given probability."""
    tail = (1.0 - probability) / 2.0
    low, high = chi2.ppf([tail, 1.0 - tail], dimension * count) / count
    return float(low), float(high)


def average_nees(nees: np.ndarray, dimension: int, probability: float = BAND_PROBABILITY) -> Tuple[np.ndarray, float]:
    """ANEES over Monte-Carlo runs.

    Args:
        nees: (R, K) of R independent runs at K instants.
        dimension: of the errors.
        probability: of the band that the average is compared with.

    Returns:
        (K,) average over runs, and the share of instants at which it is within `chi_square_band(dimension, R)`.
    """
    average = nees.mean(axis=0)
    low, high = chi_square_band(dimension, len(nees), probability)
    return average, float(np.mean((low <= average) & (average <= high)))


@dataclass(frozen=True)
class Consistency:
    """NEES of matched pairs in one run, or in several added.

    Attributes:
        dimension: of the errors; 2 is the position in the plane, 4 position and velocity.
        count: matched pairs.
        nees_sum: over them.
        inside: how many are within the chi-square band of a single pair.
    """

    dimension: int
    count: int = 0
    nees_sum: float = 0.0
    inside: int = 0

    @staticmethod
    def of(nees: np.ndarray, dimension: int) -> Consistency:
        """Of (P,) NEES, of which the NaN are left out."""
        known = nees[np.isfinite(nees)]
        low, high = chi_square_band(dimension, 1)
        return Consistency(dimension, len(known), float(known.sum()), int(np.sum((low <= known) & (known <= high))))

    def __add__(self, other: Consistency) -> Consistency:
        """Of both."""
        return Consistency(
            self.dimension, self.count + other.count, self.nees_sum + other.nees_sum, self.inside + other.inside
        )

    @property
    def average(self) -> Optional[float]:
        """Mean NEES; `dimension` is honest, more is overconfident. None without pairs."""
        return ratio(self.nees_sum, self.count)

    @property
    def inside_share(self) -> Optional[float]:
        """Share of pairs within the 95 % band; 0.95 is honest. None without pairs."""
        return ratio(self.inside, self.count)


def position_nees(truth: Truth, estimates: Estimates, events: Events) -> np.ndarray:
    """(E,) NEES in the plane of each event's pair, NaN for events without a pair or estimates without covariance.

    Only pairs within the matching threshold have one, so that gross errors, which count as miss and false positive,
    do not show here.
    """
    return _pair_nees(truth.points, estimates.means, estimates.covariances, (0, 1), events)


def state_nees(truth: Truth, estimates: Estimates, events: Events) -> np.ndarray:
    """(E,) NEES of position and velocity in the plane; NaN also where truth or estimates have no velocity."""
    if truth.velocities is None or estimates.velocity_axes is None:
        return np.full(len(events), np.nan)
    states = np.concatenate([truth.points, truth.velocities[:, :2]], axis=1)
    return _pair_nees(states, estimates.means, estimates.covariances, (0, 1, *estimates.velocity_axes), events)


def _pair_nees(
    states: np.ndarray, means: np.ndarray, covariances: Optional[np.ndarray], axes: Tuple[int, ...], events: Events
) -> np.ndarray:
    nees = np.full(len(events), np.nan)
    if covariances is None:
        return nees
    rows = np.flatnonzero(events.matched)
    errors = states[events.truth_rows[rows]] - means[events.estimate_rows[rows]][:, axes]
    known = np.isfinite(errors).all(axis=1)
    rows = rows[known]
    blocks = covariances[events.estimate_rows[rows]][:, np.array(axes)[:, None], axes]
    nees[rows] = normalised_squares(errors[known], blocks)
    return nees
