"""How sure the robot is of its place in the world, at any stamp."""

from __future__ import annotations

import bisect
from collections import deque
from dataclasses import dataclass
from typing import Deque, List, Optional

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.gaussians import checked_covariance
from people_fusion.core.poses import Pose, UncertainPose, vector_from_rotation
from people_fusion.core.stamps import from_seconds
from people_fusion.core.transform_tree import TransformSource

STEP_NS = from_seconds(0.1)  # of the odometry's way; on a grid, so that nothing depends on who asks when


@dataclass(frozen=True)
class DriftConfig:
    """Odometry drift since the last localisation fix, as variances that grow with the way (Thrun et al. 2005, 5.4)."""

    translation_per_metre: float = parameter(0.05, "std of translation after one metre, metres", low=0.0)
    translation_per_radian: float = parameter(0.01, "std of translation after turning one radian, metres", low=0.0)
    rotation_per_radian: float = parameter(0.05, "std of yaw after turning one radian, radians", low=0.0)
    rotation_per_metre: float = parameter(0.02, "std of yaw after one metre, radians", low=0.0)

    def covariance(self, motion: Pose) -> np.ndarray:
        """(6, 6) drift on the way of one small motion, in the axes that it starts in."""
        metres = float(np.linalg.norm(motion.translation))
        radians = float(np.linalg.norm(vector_from_rotation(motion.rotation)))
        position = self.translation_per_metre**2 * metres + self.translation_per_radian**2 * radians
        yaw = self.rotation_per_radian**2 * radians + self.rotation_per_metre**2 * metres
        return np.diag([position, position, 0.0, 0.0, 0.0, yaw])


@dataclass(frozen=True, eq=False)
class _Grown:
    """Where the robot believes to be, at a fix or since; `odom_from_base` is None while odometry does not say."""

    stamp_ns: int
    odom_from_base: Optional[Pose]
    world_from_base: UncertainPose


class LocalisationHistory:
    """Covariance of world_from_base in time.

    Before the first fix that of the first; between two fixes interpolated; after the last one carried along the robot's
    way in odometry, with the drift added step by step. Where odometry cannot be had the last covariance is held.

    A fix counts from `history_s` before its stamp on. One that is stamped ahead of all others by more takes nothing
    away: what follows bears it out or shows that its stamp was wrong.

    Args:
        source: gives odom_from_base.
        odom, base: the frames; `odom` may be empty.
        drift: of odometry.
        history_s: how long fixes and steps are remembered, seconds.
    """

    def __init__(self, source: TransformSource, odom: str, base: str, drift: DriftConfig, history_s: float) -> None:
        self._source, self._odom, self._base = source, odom, base
        self._drift = drift
        self._history_ns = from_seconds(history_s)
        self._stamps_ns: List[int] = []
        self._fixes: List[_Grown] = []
        self._grown: Deque[_Grown] = deque()  # since `_origin`
        self._origin: Optional[_Grown] = None  # the last fix that anybody asked beyond

    def __len__(self) -> int:
        return len(self._fixes)

    def add(self, stamp_ns: int, world_from_base: UncertainPose) -> None:
        """A fix, in order of stamps or not; of two with one stamp the later counts.

        Raises:
            DataError: if the pose is not finite or the covariance is none.
        """
        mean = world_from_base.mean
        if not (np.isfinite(mean.translation).all() and np.isfinite(mean.rotation).all()):
            raise DataError("localisation is not finite")
        covariance = checked_covariance(world_from_base.covariance, "localisation covariance")
        fix = _Grown(stamp_ns, self._odom_from_base(stamp_ns), UncertainPose(mean, covariance))
        stamps = self._stamps_ns
        if stamps and self._newest_ns < stamp_ns < stamps[-1] - self._history_ns:
            del stamps[-1], self._fixes[-1]  # its stamp was wrong
        place = bisect.bisect_left(stamps, stamp_ns)
        repeated = stamps[place : place + 1] == [stamp_ns]
        stamps[place : place + repeated] = [stamp_ns]
        self._fixes[place : place + repeated] = [fix]
        while len(stamps) > 1 and stamps[1] < self._newest_ns - self._history_ns:
            del stamps[0], self._fixes[0]

    def reset(self) -> None:
        """Forget all fixes."""
        self._stamps_ns.clear()
        self._fixes.clear()
        self._grown.clear()
        self._origin = None

    def covariance(self, stamp_ns: int) -> np.ndarray:
        """(6, 6) of world_from_base at the stamp; zero before there is any fix."""
        stamps, fixes = self._stamps_ns, self._fixes
        if not stamps:
            return np.zeros((6, 6))
        last = max(bisect.bisect_right(stamps, stamp_ns + self._history_ns) - 1, 0)
        if stamp_ns <= stamps[0]:
            return fixes[0].world_from_base.covariance
        if stamp_ns > stamps[last]:
            return self._held_and_grown(fixes[last], stamp_ns)
        after = bisect.bisect_left(stamps, stamp_ns)
        fraction = (stamp_ns - stamps[after - 1]) / (stamps[after] - stamps[after - 1])
        before, then = fixes[after - 1].world_from_base, fixes[after].world_from_base
        return (1.0 - fraction) * before.covariance + fraction * then.covariance

    @property
    def _newest_ns(self) -> int:
        """The newest stamp but for one that is far ahead of the others."""
        stamps = self._stamps_ns
        far_ahead = len(stamps) > 1 and stamps[-1] - stamps[-2] > self._history_ns
        return stamps[-2] if far_ahead else stamps[-1]

    def _held_and_grown(self, fix: _Grown, stamp_ns: int) -> np.ndarray:
        grown = self._grown
        if self._origin is not fix:
            self._origin = fix
            grown.clear()
            grown.append(fix)
        if len(grown) == 1 and grown[0].odom_from_base is None:  # odometry came after the fix
            grown[0] = _Grown(fix.stamp_ns, self._odom_from_base(fix.stamp_ns), fix.world_from_base)
        newest = grown[-1].stamp_ns
        last = newest + (stamp_ns - newest) // STEP_NS * STEP_NS
        first = max(newest + STEP_NS, last - self._history_ns // STEP_NS * STEP_NS)  # odometry reaches back no further
        for step_ns in range(first, last + 1, STEP_NS):
            grown.append(self._move(grown[-1], step_ns))
        while len(grown) > 1 and grown[1].stamp_ns < grown[-1].stamp_ns - self._history_ns:
            grown.popleft()
        start = next((state for state in reversed(grown) if state.stamp_ns <= stamp_ns), grown[0])
        return self._move(start, max(stamp_ns, start.stamp_ns)).world_from_base.covariance

    def _move(self, start: _Grown, stamp_ns: int) -> _Grown:
        """The robot's belief at a later stamp."""
        odom_from_base = self._odom_from_base(stamp_ns)
        if odom_from_base is None or start.odom_from_base is None:
            return _Grown(stamp_ns, odom_from_base or start.odom_from_base, start.world_from_base)
        motion = start.odom_from_base.inverse() @ odom_from_base
        moved = start.world_from_base @ UncertainPose(motion, self._drift.covariance(motion))
        return _Grown(stamp_ns, odom_from_base, moved)

    def _odom_from_base(self, stamp_ns: int) -> Optional[Pose]:
        if not self._odom:
            return None
        try:
            return self._source.lookup(self._odom, self._base, stamp_ns)
        except TransformUnavailable:
            return None
