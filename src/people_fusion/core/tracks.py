"""What a tracker gives: the people at one instant, and their legs where it follows these, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Tracks:
    """All tracks at one stamp in one frame.

    Attributes:
        stamp_ns: instant that means and covariances hold for.
        frame_id: frame of means and covariances.
        ids: (T,) int64, never reused in a session.
        means: (T, D) x y z vx vy (D = 5) or x y z vx vy vz (D = 6); position of the head, metres and metres a second.
        covariances: (T, D, D).
        existence: (T,) in [0, 1], probability or confidence that the track is a person.
        confirmed: (T,) bool, whether the track is reported as a person.
        matched: (T,) bool, whether the newest measurement was assigned to the track.
        occluded: (T,) bool, whether the newest measurement's sensor could not see the track.
        ages_s: (T,) seconds since the track's first measurement.
    """

    stamp_ns: int
    frame_id: str
    ids: np.ndarray
    means: np.ndarray
    covariances: np.ndarray
    existence: np.ndarray
    confirmed: np.ndarray
    matched: np.ndarray
    occluded: np.ndarray
    ages_s: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)

    def select(self, mask: np.ndarray) -> Tracks:
        """The tracks for which `mask` (T,) holds."""
        rows = {
            name: getattr(self, name)[mask]
            for name in ("ids", "means", "covariances", "existence", "confirmed", "matched", "occluded", "ages_s")
        }
        return Tracks(self.stamp_ns, self.frame_id, **rows)


NOBODY = -1  # no identity


@dataclass(frozen=True, eq=False)
class Legs:
    """All legs that a tracker follows, at one stamp in one frame.

    Attributes:
        stamp_ns: instant that positions and covariances hold for.
        frame_id: frame of positions and covariances.
        ids: (L,) int64, never reused in a session.
        positions: (L, 2) seen from above, metres.
        covariances: (L, 2, 2) m^2.
        owners: (L,) int64, id of the track whose leg it is, or NOBODY.
        seen: (L,) bool, whether the newest measurement showed the leg.
    """

    stamp_ns: int
    frame_id: str
    ids: np.ndarray
    positions: np.ndarray
    covariances: np.ndarray
    owners: np.ndarray
    seen: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)


@dataclass(frozen=True, eq=False)
class Particles:
    """What a particle filter believes of each track, at one stamp in one frame.

    Attributes:
        stamp_ns: instant that positions and velocities hold for.
        frame_id: frame of positions and velocities.
        ids: (T,) int64, of the tracks, as in Tracks.
        confirmed: (T,) bool, as in Tracks.
        positions: (T, N, 3) of heads, metres.
        velocities: (T, N, 2) metres a second.
        weights: (T, N), of each track they sum to 1.
    """

    stamp_ns: int
    frame_id: str
    ids: np.ndarray
    confirmed: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    weights: np.ndarray

    def __len__(self) -> int:
        return len(self.ids)
