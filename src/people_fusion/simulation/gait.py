"""Two legs that carry a body: one stands on the floor while the other swings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.simulation import planar

SIDES = np.array([1.0, -1.0])[:, None]  # left, right


@dataclass(frozen=True)
class GaitConfig:
    """Steps of adults; lengths in metres, times in seconds."""

    step_length: float = parameter(0.6, "at 1 m/s; it grows with the root of the speed", low=0.1, high=1.0)
    shortest_step_s: float = parameter(0.45, "time from one foot's start to the other's, at least", low=0.2)
    longest_step_s: float = parameter(0.9, "the same, at most", low=0.2)
    swing_speed: float = parameter(8.0, "of a foot in the air, at most, also of who is jostled", low=1.0)
    swing_share: float = parameter(0.8, "share of the step time in which a foot is in the air", low=0.3, high=0.95)
    patience: float = parameter(0.07, "how far a foot may be from where it should stand before it steps", low=0.01)
    laser_height: float = parameter(0.385, "where the scanners cut the legs", low=0.05, high=0.8)
    leg_length: float = parameter(0.9, "from floor to hip", low=0.5, high=1.2)
    sitting_reach: float = parameter(0.38, "of the shins before the hips of one who sits", low=0.0, high=0.7)


class Gait:
    """Feet of N people. All feet stand still but for at most one a person, which swings to where it will be needed.

    Args:
        centres: (N, 2) bodies at the start, metres.
        headings: (N,) radians.
        hip_widths: (N,) between the legs, metres.
    """

    def __init__(self, config: GaitConfig, centres: np.ndarray, headings: np.ndarray, hip_widths: np.ndarray) -> None:
        self._config = config
        self._hip_widths = hip_widths
        self.feet = self._hips(centres, headings)
        count = len(centres)
        self._swinging = np.full(count, -1)
        self._elapsed = np.full(count, np.inf)  # since the last swing began
        self._duration = np.ones(count)
        self._lifted_from = np.zeros((count, 2))

    def step(self, dt: float, centres: np.ndarray, velocities: np.ndarray, headings: np.ndarray) -> None:
        """Move the feet on by `dt` to follow the bodies (N, 2)."""
        config = self._config
        speeds = np.linalg.norm(velocities, axis=1)
        step_length = config.step_length * np.sqrt(speeds)
        step_time = np.clip(step_length / np.maximum(speeds, 1e-3), config.shortest_step_s, config.longest_step_s)
        hips = self._hips(centres, headings)
        self._elapsed += dt

        moving = np.flatnonzero(self._swinging >= 0)
        foot = self._swinging[moving]
        remaining = np.maximum(self._duration[moving] - self._elapsed[moving], 0.0)
        lead = remaining + (2.0 - config.swing_share) / 2.0 * step_time[moving]  # the body passes it in mid-stance
        goal = hips[moving, foot] + velocities[moving] * lead[:, None]
        progress = np.clip(self._elapsed[moving] / self._duration[moving], 0.0, 1.0)[:, None]
        smooth = progress**3 * (10.0 - 15.0 * progress + 6.0 * progress**2)  # minimum jerk
        shift = self._lifted_from[moving] + smooth * (goal - self._lifted_from[moving]) - self.feet[moving, foot]
        length = np.linalg.norm(shift, axis=1, keepdims=True)
        self.feet[moving, foot] += shift * np.minimum(1.0, config.swing_speed * dt / np.maximum(length, 1e-9))
        self._swinging[moving[progress[:, 0] >= 1.0]] = -1

        lag = hips - self.feet
        distance = np.linalg.norm(lag, axis=2)
        behind = np.einsum("nfi,ni->nf", lag, velocities) / np.maximum(speeds, 1e-3)[:, None]
        foot = np.argmax(np.where(speeds[:, None] > 0.15, behind, distance), axis=1)
        rows = np.arange(len(foot))
        starts = (self._swinging < 0) & (self._elapsed >= step_time) & (distance[rows, foot] > config.patience)
        self._swinging[starts] = foot[starts]
        self._elapsed[starts] = 0.0
        self._duration[starts] = config.swing_share * step_time[starts]
        self._lifted_from[starts] = self.feet[rows, foot][starts]

    def legs(self, centres: np.ndarray, headings: np.ndarray, seated: np.ndarray) -> np.ndarray:
        """(N, 2, 2) left and right leg at the scanners' height; `seated` (N,) goes from 0 to 1 while one sits down."""
        hips = self._hips(centres, headings)
        share = self._config.laser_height / self._config.leg_length
        standing = self.feet + share * (hips - self.feet)
        sitting = hips + self._config.sitting_reach * planar.direction(headings)[:, None]
        return standing + seated[:, None, None] * (sitting - standing)

    def _hips(self, centres: np.ndarray, headings: np.ndarray) -> np.ndarray:
        """(N, 2, 2) where the legs hang from."""
        to_left = planar.direction(headings + np.pi / 2.0)
        return centres[:, None] + SIDES * to_left[:, None] * (self._hip_widths / 2.0)[:, None, None]
