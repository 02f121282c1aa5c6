"""What is compared: annotated people and tracker output at the same instants, as flat arrays."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.errors import DataError
from people_fusion.core.tracks import Tracks

# Where a state of D components holds velocity in the plane: x y vx vy, x y z vx vy, x y z vx vy vz.
_VELOCITY_AXES = {4: (2, 3), 5: (3, 4), 6: (3, 4)}
_STATE_SIZES = (2, 3, 4, 5, 6)


@dataclass(frozen=True, eq=False)
class Truth:
    """Annotated people of F frames, N annotations altogether.

    Attributes:
        stamps_ns: (F,) int64, increasing. A frame without people is a frame too.
        frames: (N,) int64 index into `stamps_ns`, not decreasing.
        ids: (N,) int64 persons, each at most once in a frame.
        positions: (N, 2) or (N, 3) metres; only the ground plane is used.
        velocities: (N, 2) or (N, 3) metres a second, NaN where unknown; or None.

    Raises:
        DataError: if shapes disagree, a position is not finite, stamps or frames are out of order, or a person
            stands twice in a frame.
    """

    stamps_ns: np.ndarray
    frames: np.ndarray
    ids: np.ndarray
    positions: np.ndarray
    velocities: Optional[np.ndarray] = None

    def __post_init__(self) -> None:
        _check_rows("truth", self.frames, self.ids, self.positions)
        if self.positions.shape[1] not in (2, 3):
            raise DataError("truth is not (N, 2) or (N, 3)", f"got {self.positions.shape}")
        if self.velocities is not None and len(self.velocities) != len(self.ids):
            raise DataError("truth of different lengths", f"{len(self.velocities)} velocities, {len(self.ids)} persons")
        if np.any(np.diff(self.stamps_ns) <= 0):
            raise DataError("stamps of truth do not increase")
        _check_frame_count("truth", self.frames, self.frame_count)

    @staticmethod
    def from_frames(
        stamps_ns: Sequence[int],
        ids: Sequence[np.ndarray],
        positions: Sequence[np.ndarray],
        velocities: Optional[Sequence[np.ndarray]] = None,
    ) -> Truth:
        """Truth from one entry a frame: (n,) ids, (n, 2 or 3) positions and velocities."""
        frames, flat_ids = _flatten(ids)
        return Truth(
            np.asarray(stamps_ns, dtype=np.int64),
            frames,
            flat_ids,
            _stack(positions, 2),
            None if velocities is None else _stack(velocities, 2),
        )

    @property
    def frame_count(self) -> int:
        return len(self.stamps_ns)

    @property
    def points(self) -> np.ndarray:
        """(N, 2) positions in the ground plane."""
        return self.positions[:, :2]

    def bounds(self) -> np.ndarray:
        """(F + 1,) rows of frame k are bounds[k]:bounds[k + 1]."""
        return np.searchsorted(self.frames, np.arange(self.frame_count + 1))


@dataclass(frozen=True, eq=False)
class Estimates:
    """Tracker output at the frames of a `Truth`, M reported people altogether.

    Attributes:
        frames: (M,) int64 index of the truth's frame, not decreasing.
        ids: (M,) int64 tracks, each at most once in a frame.
        means: (M, D) as `Tracks.means`: x y z vx vy (vz); or without z, without velocity: D from 2 to 6.
        covariances: (M, D, D), or None where the tracker gives none.
        existence: (M,) in [0, 1], or None.

    Raises:
        DataError: if shapes disagree, a mean is not finite, frames decrease, or a track stands twice in a frame.
    """

    frames: np.ndarray
    ids: np.ndarray
    means: np.ndarray
    covariances: Optional[np.ndarray] = None
    existence: Optional[np.ndarray] = None

    def __post_init__(self) -> None:
        _check_rows("estimates", self.frames, self.ids, self.means)
        if self.means.shape[1] not in _STATE_SIZES:
            raise DataError("estimates have no known state", f"means of shape {self.means.shape}")
        if self.covariances is not None and self.covariances.shape != (*self.means.shape, self.means.shape[1]):
            raise DataError("covariances do not fit means", f"{self.covariances.shape} and {self.means.shape}")
        if self.existence is not None and self.existence.shape != self.ids.shape:
            raise DataError("estimates of different lengths", f"{len(self.existence)} existences, {len(self.ids)} ids")

    @staticmethod
    def from_frames(
        ids: Sequence[np.ndarray],
        means: Sequence[np.ndarray],
        covariances: Optional[Sequence[np.ndarray]] = None,
        existence: Optional[Sequence[np.ndarray]] = None,
    ) -> Estimates:
        """Estimates from one entry a frame: (m,) ids, (m, D) means, (m, D, D) covariances, (m,) existence."""
        frames, flat_ids = _flatten(ids)
        flat_means = _stack(means, 2)
        flat_covariances = None
        if covariances is not None:
            size = flat_means.shape[1]
            filled = [np.asarray(entry, dtype=float) for entry in covariances if len(entry)]
            flat_covariances = np.concatenate(filled) if filled else np.zeros((0, size, size))
        flat_existence = None if existence is None else np.concatenate([np.zeros(0), *existence])
        return Estimates(frames, flat_ids, flat_means, flat_covariances, flat_existence)

    @staticmethod
    def from_tracks(tracks: Sequence[Tracks], confirmed_only: bool = True) -> Estimates:
        """Estimates from a tracker's output at each frame of the truth."""
        shown = [snapshot.select(snapshot.confirmed) if confirmed_only else snapshot for snapshot in tracks]
        return Estimates.from_frames(
            [snapshot.ids for snapshot in shown],
            [snapshot.means for snapshot in shown],
            [snapshot.covariances for snapshot in shown],
            [snapshot.existence for snapshot in shown],
        )

    @property
    def points(self) -> np.ndarray:
        """(M, 2) positions in the ground plane."""
        return self.means[:, :2]

    @property
    def velocity_axes(self) -> Optional[Tuple[int, int]]:
        """Which components of a state are the velocity in the plane; None if it has none."""
        return _VELOCITY_AXES.get(self.means.shape[1])

    def bounds(self, frame_count: int) -> np.ndarray:
        """(F + 1,) rows of frame k are bounds[k]:bounds[k + 1].

        Raises:
            DataError: if an estimate belongs to no frame of the truth.
        """
        _check_frame_count("estimates", self.frames, frame_count)
        return np.searchsorted(self.frames, np.arange(frame_count + 1))

    def select(self, rows: np.ndarray) -> Estimates:
        """The estimates of a (M,) mask or of increasing row numbers."""
        return Estimates(
            self.frames[rows],
            self.ids[rows],
            self.means[rows],
            None if self.covariances is None else self.covariances[rows],
            None if self.existence is None else self.existence[rows],
        )


def _flatten(ids: Sequence[np.ndarray]) -> Tuple[np.ndarray, np.ndarray]:
    frames = np.repeat(np.arange(len(ids), dtype=np.int64), [len(entry) for entry in ids])
    return frames, np.concatenate([np.zeros(0, dtype=np.int64), *(np.asarray(e, dtype=np.int64) for e in ids)])


def _stack(rows: Sequence[np.ndarray], size_of_none: int) -> np.ndarray:
    filled = [np.asarray(entry, dtype=float) for entry in rows if len(entry)]
    return np.concatenate(filled) if filled else np.zeros((0, size_of_none))


def _check_rows(name: str, frames: np.ndarray, ids: np.ndarray, values: np.ndarray) -> None:
    if values.ndim != 2 or not len(frames) == len(ids) == len(values):
        raise DataError(f"{name} of different lengths", f"{len(frames)} frames, {len(ids)} ids, values {values.shape}")
    if not np.all(np.isfinite(values)):
        raise DataError(f"{name} not finite", f"row {np.flatnonzero(~np.isfinite(values).all(axis=1))[0]}")
    if np.any(np.diff(frames) < 0):
        raise DataError(f"frames of {name} decrease")
    order = np.lexsort((ids, frames))
    twice = (np.diff(frames[order]) == 0) & (np.diff(ids[order]) == 0)
    if twice.any():
        row = order[np.flatnonzero(twice)[0]]
        raise DataError(f"{name} with one identity twice in a frame", f"{ids[row]} in frame {frames[row]}")


def _check_frame_count(name: str, frames: np.ndarray, frame_count: int) -> None:
    if len(frames) and not 0 <= frames[0] <= frames[-1] < frame_count:
        raise DataError(f"{name} outside the frames", f"{frames[0]} to {frames[-1]} of {frame_count}")
