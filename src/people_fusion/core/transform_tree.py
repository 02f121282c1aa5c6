"""Transforms between frames at a stamp: the contract, and tf2's buffer for a recording, without ROS."""

from __future__ import annotations

import abc
import bisect
from typing import Dict, FrozenSet, List, Optional, Tuple

import numpy as np

from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.poses import Pose, interpolate
from people_fusion.core.stamps import from_seconds, to_seconds

HISTORY_S = 15.0


class TransformSource(abc.ABC):
    """Where poses between frames come from: tf2 when live (ros.transforms), a TransformTree from a bag when not."""

    @abc.abstractmethod
    def lookup(self, target_frame: str, source_frame: str, stamp_ns: int) -> Pose:
        """target_from_source at the stamp, finite.

        Raises:
            TransformUnavailable: with `may_arrive` true where the frame or the stamp is not known *yet*.
        """


def normalise_frame(frame_id: str) -> str:
    """Frame without tf1's leading slash."""
    return frame_id.lstrip("/")


class TransformTree(TransformSource):
    """Frames as a tree with a history per link: tf2's buffer for a recording, without ROS.

    As in tf2, a dynamic link is known from its oldest to its newest stamp, poses between are interpolated, and of two
    transforms with one stamp the first counts. A static link holds at all times, also where /tf repeats it. If a frame
    gets another parent, its history starts anew. If time jumps, call `reset`. Not thread-safe.

    Unlike tf2's, one transform that is stamped ahead by more than the history takes nothing away: what follows bears it
    out or shows that its stamp was wrong. Nothing is interpolated across a pause that long.

    Args:
        history_s: how long each link is remembered before its own newest stamp, seconds.
    """

    def __init__(self, history_s: float = HISTORY_S) -> None:
        self._history_ns = from_seconds(history_s)
        self._links: Dict[str, _Link] = {}  # by child
        self._chains: Dict[Tuple[str, str], _Chain] = {}

    @property
    def frames(self) -> FrozenSet[str]:
        """All frames that some transform has named."""
        return frozenset(self._links).union(link.parent for link in self._links.values())

    def reset(self, keep_static: bool = False) -> None:
        """Forget everything; static transforms only if they shall not be kept."""
        self._links = {child: link for child, link in self._links.items() if keep_static and link.is_static}
        self._chains.clear()

    def add(self, parent: str, child: str, stamp_ns: int, pose: Pose, static: bool = False) -> None:
        """Take parent_from_child.

        Raises:
            DataError: the transform is not finite, names no frame, closes a cycle, is older than what is kept, or is
                the first from a new parent and far ahead; it is left out.
        """
        parent, child = normalise_frame(parent), normalise_frame(child)
        if not (np.isfinite(pose.translation).all() and np.isfinite(pose.rotation).all()):
            raise DataError("transform is not finite", f"{parent} to {child}")
        link = self._links.get(child)
        if link is None or link.parent != parent:
            if not parent or not child:
                raise DataError("transform without frame", f"{parent!r} to {child!r}")
            if child in self._ancestry(parent):
                raise DataError("transform closes a cycle", f"{parent} to {child}")
            if link is not None and not link.is_static:
                link.require_later(stamp_ns, parent)
            link = self._links[child] = _Link(parent, child, self._history_ns)
            self._chains.clear()
        if static or link.is_static:
            link.fix(pose)
        else:
            link.insert(stamp_ns, pose)

    def lookup(self, target_frame: str, source_frame: str, stamp_ns: int) -> Pose:
        """See TransformSource.lookup; waiting cannot help where a stamp is older than a link's history."""
        target, source = normalise_frame(target_frame), normalise_frame(source_frame)
        if target == source:
            return Pose.identity()
        chain = self._chains.get((target, source))
        if chain is None:
            chain = self._chains[target, source] = self._chain(target, source)
        from_target, from_source = chain
        for link in from_target + from_source:
            link.require_not_forgotten(stamp_ns)
        if not from_target:
            return _compose(from_source, stamp_ns)
        if not from_source:
            return _compose(from_target, stamp_ns).inverse()
        return _compose(from_target, stamp_ns).inverse() @ _compose(from_source, stamp_ns)

    def _chain(self, target: str, source: str) -> _Chain:
        """Links from target and from source up to their nearest common ancestor."""
        above_target, above_source = self._ancestry(target), self._ancestry(source)
        shared = set(above_target).intersection(above_source)
        if not shared:
            for frame in (target, source):
                if frame not in self._links and frame not in self.frames:
                    raise TransformUnavailable(f"frame {frame!r} is not known", may_arrive=True)
            raise TransformUnavailable(f"frames {target!r} and {source!r} are not connected", may_arrive=True)
        up_target = tuple(self._links[frame] for frame in above_target if frame not in shared)
        up_source = tuple(self._links[frame] for frame in above_source if frame not in shared)
        return up_target, up_source

    def _ancestry(self, frame: str) -> List[str]:
        """The frame, its parent, and so on up to the root."""
        frames = [frame]
        while frames[-1] in self._links:
            frames.append(self._links[frames[-1]].parent)
        return frames


class _Link:
    """History of parent_from_child, sorted by stamp; a static link has one pose and no stamps.

    Only the newest stamp may be ahead of the one before by more than the history.
    """

    def __init__(self, parent: str, child: str, history_ns: int) -> None:
        self.parent, self.child = parent, child
        self.is_static = False
        self.stamps_ns: List[int] = []
        self._poses: List[Pose] = []
        self._history_ns = history_ns
        self._rival: Optional[str] = None  # parent of a transform far ahead that was left out

    def fix(self, pose: Pose) -> None:
        self.is_static = True
        self.stamps_ns, self._poses = [], [pose]

    def insert(self, stamp_ns: int, pose: Pose) -> None:
        stamps, poses = self.stamps_ns, self._poses
        self._rival = None
        if len(stamps) > 1 and stamp_ns < self._newest_ns - self._history_ns:
            raise DataError("transform is older than the history", f"{self.parent} to {self.child}")
        if stamps and self._newest_ns < stamp_ns < stamps[-1] - self._history_ns:
            del stamps[-1], poses[-1]  # its stamp was wrong
        place = bisect.bisect_left(stamps, stamp_ns)
        if stamps[place : place + 1] != [stamp_ns]:
            stamps.insert(place, stamp_ns)
            poses.insert(place, pose)
        expired = bisect.bisect_left(stamps, self._newest_ns - self._history_ns)
        del stamps[:expired], poses[:expired]

    def require_later(self, stamp_ns: int, parent: str) -> None:
        """For a transform from another parent."""
        if stamp_ns < self._newest_ns:
            raise DataError("transform from a former parent", f"{parent} to {self.child}")
        if stamp_ns > self._newest_ns + self._history_ns and self._rival != parent:
            self._rival = parent
            raise DataError("transform from a new parent far ahead", f"{parent} to {self.child}")

    @property
    def _newest_ns(self) -> int:
        """The newest stamp but for one that is far ahead of the others."""
        stamps = self.stamps_ns
        far_ahead = len(stamps) > 1 and stamps[-1] - stamps[-2] > self._history_ns
        return stamps[-2] if far_ahead else stamps[-1]

    def require_not_forgotten(self, stamp_ns: int) -> None:
        if self.stamps_ns and stamp_ns < self.stamps_ns[0]:
            message = f"{self.parent} to {self.child} is {self._seconds(self.stamps_ns[0] - stamp_ns)} too new"
            raise TransformUnavailable(message, may_arrive=False)

    def at(self, stamp_ns: int) -> Pose:
        if self.is_static:
            return self._poses[0]
        place = bisect.bisect_left(self.stamps_ns, stamp_ns)
        if place == len(self.stamps_ns):
            message = f"{self.parent} to {self.child} is {self._seconds(stamp_ns - self.stamps_ns[-1])} too old"
            raise TransformUnavailable(message, may_arrive=True)
        after = self.stamps_ns[place]
        if after == stamp_ns:
            return self._poses[place]
        before = self.stamps_ns[place - 1]
        if after - before > self._history_ns:
            message = f"{self.parent} to {self.child} is {self._seconds(stamp_ns - before)} too old"
            raise TransformUnavailable(message, may_arrive=True)
        return interpolate(self._poses[place - 1], self._poses[place], (stamp_ns - before) / (after - before))

    @staticmethod
    def _seconds(duration_ns: int) -> str:
        return f"{to_seconds(duration_ns):.3f} s"


_Chain = Tuple[Tuple[_Link, ...], Tuple[_Link, ...]]


def _compose(links: Tuple[_Link, ...], stamp_ns: int) -> Pose:
    """ancestor_from_frame of the links from the frame upwards."""
    pose: Optional[Pose] = None
    for link in links:
        step = link.at(stamp_ns)
        pose = step if pose is None else step @ pose
    assert pose is not None
    return pose
