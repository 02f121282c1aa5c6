"""How far away heads are by a laser scanner that sees the legs below them (Poschmann 2018, 3.1.2, by a TOF camera).

The box of a head gives its direction well and its distance badly; legs in that direction give the distance well. They
are told from walls and chairs by little: pieces of a scan that are neither wide nor thin and stand out of what is
beside them. Where that leaves a doubt the size of the box alone counts.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Deque, Dict, List, NamedTuple, Tuple

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError, TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.core.transforms import TransformSource
from people_fusion.cues.heads.people import Heads
from people_fusion.cues.legs import beams
from people_fusion.cues.legs.segments import Segments, segment

KEPT = 64  # scans: of several scanners, for as long as an image may be on its way
MIN_POINTS = 2  # of a piece
GAP, GAP_BEAMS = 0.1, 2.5  # metres or beam spacings between points of one piece
SPEED_STD = 1.0  # of people along the ray, m/s
ARC_DEPTH = np.pi / 4.0  # mean depth of a half circle seen from afar, in radii
TINY = 1e-6  # metres, against a division by zero


@dataclass(frozen=True)
class RangesConfig:
    """When the distance of a head is taken from other sensors than the camera."""

    scans: bool = parameter(False, "whether laser scanners tell how far away the legs below a head are")
    max_age: float = parameter(0.2, "of a scan when the image was taken, seconds", 0.0, 1.0)
    half_width: float = parameter(0.2, "legs are at most this far beside the head, metres", 0.02, 1.0)
    gate: float = parameter(3.0, "standard deviations between the distances by size and by legs, at most", 0.1, 10.0)
    widths: Tuple[float, float] = parameter((0.06, 0.6), "of pieces that may be legs, metres", 0.0, 2.0)
    min_step: float = parameter(0.1, "that the scan makes on both sides of legs, metres", 0.0, 1.0)
    stride: float = parameter(0.7, "legs of one person are at most this far apart along the ray, metres", 0.0, 2.0)
    leg_radius: float = parameter(0.06, "the scanner sees the near side of legs; 0: of no width, metres", 0.0, 0.2)
    std: float = parameter(0.15, "of the head over the legs along the ray, metres", 0.01, 1.0)
    least_height: float = parameter(
        1.35, "of heads over the floor: who sits has the legs far before the head, metres", 0.0, 3.0
    )

    def __post_init__(self) -> None:
        if self.widths[0] >= self.widths[1]:
            raise ConfigError(f"widths: expected two widths, the smaller first, got {list(self.widths)}")


class Pieces(NamedTuple):
    """What may be legs (S,), in level axes from the camera.

    Attributes:
        middles: (S, 2) metres.
        age_s: (S,) of the scan when the image was taken.
    """

    middles: np.ndarray
    age_s: np.ndarray


class Ranges:
    """The newest scans, and what they say of heads. `note` may be called from another thread than `refined`."""

    def __init__(self, config: RangesConfig) -> None:
        self.config = config
        self._scans: Deque[Scan] = deque(maxlen=KEPT)

    def note(self, scan: Scan) -> None:
        """A scan that an image to come may need.

        Raises:
            DataError: it is unusable.
        """
        beams.check(scan)
        self._scans.append(scan)

    def reset(self) -> None:
        """Time has jumped."""
        self._scans.clear()

    def refined(
        self, heads: Heads, wanted: np.ndarray, camera: Pose, fixed: str, stamp_ns: int, transforms: TransformSource
    ) -> Heads:
        """Heads with what the scans say of their distance.

        Nobody waits for a scan's transform: it is older than the image's own, so that it is there with that one unless
        nobody tells where the scanner is, and then the cue must go on without.

        Args:
            heads: N by size.
            wanted: (N,) which of them are people; the others have no legs.
            camera: fixed_from_camera at the image's stamp, level.
            fixed: frame in which the world stands still.
            stamp_ns: of the image.
            transforms: where scanners are.
        """
        found: List[Pieces] = []
        for _, scan in sorted(self._newest(stamp_ns).items()):
            try:
                scanner = transforms.lookup(fixed, scan.frame_id, scan.stamp_ns)
            except TransformUnavailable:
                continue
            middles = pieces(scan, self.config)
            there = scanner.apply(np.column_stack([middles, np.zeros(len(middles))])) - camera.translation
            age_s = to_seconds(stamp_ns - scan.stamp_ns)
            found.append(Pieces(there[:, :2], np.full(len(there), age_s)))
        if not found:
            return heads
        every = Pieces(*(np.concatenate(column) for column in zip(*found)))
        with np.errstate(invalid="ignore"):
            standing = heads.positions[:, 2] + camera.translation[2] >= self.config.least_height
        return over_legs(heads, every, wanted & standing, self.config)

    def _newest(self, stamp_ns: int) -> Dict[str, Scan]:
        """By scanner, of the scans that are not newer than the image and not too old."""
        oldest_ns = stamp_ns - from_seconds(self.config.max_age)
        newest: Dict[str, Scan] = {}
        for scan in tuple(self._scans):
            known = newest.get(scan.frame_id)
            if oldest_ns <= scan.stamp_ns <= stamp_ns and (known is None or known.stamp_ns <= scan.stamp_ns):
                newest[scan.frame_id] = scan
        return newest


def pieces(scan: Scan, config: RangesConfig) -> np.ndarray:
    """(S, 2) middles of what may be legs in a scan, in the scanner's frame, metres.

    Raises:
        DataError: the scan is unusable.
    """
    ranges = beams.check(scan)
    known = np.where(beams.hits(ranges, scan.range_min, scan.range_max), ranges, np.nan)
    segments = segment(scan, known, GAP, GAP_BEAMS)
    if not len(segments):
        return np.zeros((0, 2))
    first, last = segments.starts, segments.starts + segments.counts - 1
    spacing = segments.angle_increment * 0.5 * (segments.ranges[first] + segments.ranges[last])
    wide = np.hypot(*(segments.points[last] - segments.points[first]).T) + spacing
    legs = (segments.counts >= MIN_POINTS) & (wide >= config.widths[0]) & (wide <= config.widths[1])
    legs &= _stands_out(segments, known, config.min_step)
    middles = segments.centres[legs]
    distances = np.maximum(np.hypot(middles[:, 0], middles[:, 1]), TINY)
    return np.asarray(middles * (1.0 + ARC_DEPTH * config.leg_radius / distances)[:, None])


def over_legs(heads: Heads, legs: Pieces, standing: np.ndarray, config: RangesConfig) -> Heads:
    """Heads (N,) at the distance of the legs below them, weighted by information with that of their size.

    A head without legs, with some behind those of its person, or with another's whom they fit better, stays as it is.

    Args:
        heads: by size.
        legs: in any order.
        standing: (N,) whose legs are below the head.
        config: see there.
    """
    flat = np.hypot(heads.positions[:, 0], heads.positions[:, 1])
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = heads.positions[:, :2] / flat[:, None]
        along = ahead @ legs.middles.T
        aside = ahead[:, :1] * legs.middles[:, 1] - ahead[:, 1:] * legs.middles[:, 0]
        variances = np.einsum("ni,nij,nj->n", ahead, heads.covariances[:, :2, :2], ahead)
        legs_variances = config.std**2 + (SPEED_STD * legs.age_s) ** 2
        misfits = np.abs(along - flat[:, None]) / np.sqrt(variances[:, None] + legs_variances)
        claimed = (np.abs(aside) <= config.half_width) & (misfits <= config.gate) & standing[:, None]
    positions, covariances = heads.positions.copy(), heads.covariances.copy()
    best = np.where(claimed, misfits, np.inf).min(axis=0, initial=np.inf)
    for row in np.flatnonzero(claimed.any(axis=1)).tolist():
        mine = claimed[row]
        if np.ptp(along[row, mine]) > config.stride or (misfits[row, mine] > best[mine]).any():
            continue
        innovation = along[row, mine].mean() - flat[row]
        jacobian = np.append(ahead[row], 0.0)
        cross = covariances[row] @ jacobian
        innovation_variance = variances[row] + legs_variances[mine].max()
        positions[row] += cross / innovation_variance * innovation
        covariances[row] -= np.outer(cross, cross) / innovation_variance
    return Heads(positions, covariances)


def _stands_out(segments: Segments, known: np.ndarray, step: float) -> np.ndarray:
    """(S,) whether the beams on both sides end at another depth, on one side farther away; nothing is far away.

    What of a wall is seen between two people is no piece of its own.
    """
    depths = beams.with_neighbours(np.where(np.isfinite(known), known, np.inf), segments.is_ring, np.inf)
    first, last = segments.starts, segments.starts + segments.counts - 1
    before = depths[segments.beams[first]] - segments.ranges[first]
    after = depths[segments.beams[last] + 2] - segments.ranges[last]
    return np.asarray((np.minimum(np.abs(before), np.abs(after)) >= step) & (np.maximum(before, after) >= step))
