"""tf2 as a TransformSource, fed from /tf without the threads and locks of tf2_ros's listener."""

from __future__ import annotations

import math
import threading
import time
from typing import Any, Dict, List, NamedTuple, Tuple

import numpy as np
import tf2_py
from rospy import Duration

from people_fusion.core.errors import DataError, TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.transforms import TransformSource
from people_fusion.core.waiting import transforms_ready
from people_fusion.cues.cue import TransformRequest
from people_fusion.ros.conversions import frame_from_msg, stamp_from_msg, stamp_to_msg

REMEMBERED = 64  # answers; every message asks for the same few transforms several times


class Missing(NamedTuple):
    """A transform that was asked for and has not been found since.

    Attributes:
        target_frame, source_frame: what was asked for.
        since: when it was first not found, seconds on time.monotonic.
        ever_found: whether it was found before.
        reason: tf2's words.
    """

    target_frame: str
    source_frame: str
    since: float
    ever_found: bool
    reason: str

    @property
    def seconds(self) -> float:
        """How long it has been missing."""
        return time.monotonic() - self.since


class Tf2Source(TransformSource):
    """tf2's buffer. Thread-safe.

    Args:
        history_s: how long transforms are remembered, seconds.
    """

    def __init__(self, history_s: float) -> None:
        self._buffer = tf2_py.BufferCore(Duration.from_sec(history_s))
        self._answers: Dict[Tuple[str, str, int], Pose] = {}
        self._found: Dict[Tuple[str, str], bool] = {}
        self._missing: Dict[Tuple[str, str], Missing] = {}
        self._lock = threading.Lock()

    def add(self, transform: Any, static: bool = False) -> None:
        """Take a geometry_msgs/TransformStamped.

        Raises:
            DataError: it is not finite or no rotation, or names no two frames; tf2 would let an infinite translation
                pass, and print a line for each of the others.
        """
        shift, turn = transform.transform.translation, transform.transform.rotation
        norm = turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2
        if not math.isfinite(shift.x + shift.y + shift.z) or not abs(norm - 1.0) < 1e-3:
            raise DataError("transform is not finite or no rotation", transform.child_frame_id)
        transform.header.frame_id = frame_from_msg(transform.header.frame_id)
        transform.child_frame_id = frame_from_msg(transform.child_frame_id)
        if not transform.header.frame_id or transform.child_frame_id in ("", transform.header.frame_id):
            raise DataError(
                "transform without two frames", f"{transform.header.frame_id!r} to {transform.child_frame_id!r}"
            )
        add = self._buffer.set_transform_static if static else self._buffer.set_transform
        with self._lock:
            add(transform, "people_fusion")

    def lookup(self, target_frame: str, source_frame: str, stamp_ns: int) -> Pose:
        """As TransformSource says."""
        if target_frame == source_frame:
            return Pose.identity()
        key = (target_frame, source_frame, stamp_ns)
        with self._lock:
            answer = self._answers.get(key)
            if answer is None:
                answer = self._look_up(target_frame, source_frame, stamp_ns)
                if len(self._answers) >= REMEMBERED:
                    self._answers.clear()
                self._answers[key] = answer
            return answer

    def missing(self) -> List[Missing]:
        """What was asked for last and not found, for diagnostics."""
        with self._lock:
            return list(self._missing.values())

    def clear(self) -> None:
        """Time has jumped: forget all but the static transforms."""
        with self._lock:
            self._buffer.clear()
            self._answers.clear()
            self._missing.clear()

    def _look_up(self, target_frame: str, source_frame: str, stamp_ns: int) -> Pose:
        frames = (target_frame, source_frame)
        try:
            message = self._buffer.lookup_transform_core(target_frame, source_frame, stamp_to_msg(stamp_ns))
            t, q = message.transform.translation, message.transform.rotation
            pose = Pose.from_quaternion(np.array([t.x, t.y, t.z]), np.array([q.x, q.y, q.z, q.w]))
        except tf2_py.TransformException as error:
            reason = " ".join(str(error).split())
            past = isinstance(error, tf2_py.ExtrapolationException) and "into the past" in reason
            may_arrive = not (past or isinstance(error, tf2_py.InvalidArgumentException))
        except DataError as error:
            reason, may_arrive = str(error), False
        else:
            self._missing.pop(frames, None)
            self._found[frames] = True
            return pose
        if frames not in self._missing:
            self._missing[frames] = Missing(*frames, time.monotonic(), frames in self._found, reason)
        raise TransformUnavailable(f"no transform from {source_frame} to {target_frame}: {reason}", may_arrive)


def stamp_of_transform(transform: Any) -> int:
    """Nanoseconds of a geometry_msgs/TransformStamped."""
    return stamp_from_msg(transform.header.stamp)


def request_is_met(source: TransformSource, request: TransformRequest) -> bool:
    """Whether a transform is there by now.

    Raises:
        TransformUnavailable: waiting cannot help.
    """
    return transforms_ready(source, request.target_frame, request.source_frame, (request.stamp_ns,))
