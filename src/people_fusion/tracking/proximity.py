"""No two people are in one place: particles near another person weigh less (Poschmann 2018, 7.2.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError


@dataclass(frozen=True)
class ProximityConfig:
    """Distances of eq. 7.7, which the thesis does not tell."""

    distance_min: float = parameter(0.2, "no particle is nearer to another confirmed track, metres", low=0.0)
    distance_max: float = parameter(0.6, "from here on none weighs less for it; 0: off, metres", low=0.0)

    def __post_init__(self) -> None:
        if 0.0 < self.distance_max <= self.distance_min:
            raise ConfigError(f"distance_max: {self.distance_max} is not beyond distance_min, {self.distance_min}")


def log_proximity(
    states: np.ndarray, means: np.ndarray, confirmed: np.ndarray, config: ProximityConfig
) -> np.ndarray:
    """(T, N) log p of eq. 7.6 and 7.7.

    Args:
        states: (T, N, D) particles, x and y first.
        means: (T, D) of the tracks.
        confirmed: (T,) bool, who is a person.
        config: distances.
    """
    logs = np.zeros(states.shape[:2])
    if config.distance_max == 0.0 or np.count_nonzero(confirmed) == 0 or len(states) < 2:
        return logs
    reaches = np.abs(states[..., :2] - means[:, None, :2]).max(axis=1)
    reaches = np.hypot(reaches[:, 0], reaches[:, 1])
    apart = np.hypot(*(means[:, None, :2] - means[None, :, :2]).transpose(2, 0, 1))
    near = (apart < config.distance_max + reaches[:, None]) & confirmed & ~np.eye(len(means), dtype=bool)
    tracks, others = np.nonzero(near)
    distances = np.hypot(*(states[tracks, :, :2] - means[others, None, :2]).transpose(2, 0, 1))
    shares = (distances - config.distance_min) / (config.distance_max - config.distance_min)
    with np.errstate(divide="ignore"):
        np.add.at(logs, tracks, np.log(np.clip(shares, 0.0, 1.0)))
    return logs
