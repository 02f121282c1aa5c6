"""Cues that see one person who stands still, and are late, silent or wrong as told."""

from __future__ import annotations

import threading
import time
from typing import Any, Dict, List

import numpy as np
import rospy
from graph import wait_until

from people_fusion.core.measurements import XY_OBSERVED, Announcement, Measurement
from people_fusion.core.stamps import from_seconds
from people_fusion.msg import DetectedPersons, MeasurementAnnouncement, TrackedPersons
from people_fusion.ros.conversions import announcement_to_msg, measurement_to_msg, stamp_from_msg

RATE_HZ = 20.0
FRAME = "laser"


class Wire:
    """Publishers that all fake cues share."""

    def __init__(self) -> None:
        options = {"queue_size": 1000, "tcp_nodelay": True}
        self._announcements = rospy.Publisher("/people_fusion/announcements", MeasurementAnnouncement, **options)
        self._detections = rospy.Publisher("/people_fusion/detections", DetectedPersons, **options)
        publishers = (self._announcements, self._detections)
        wait_until(lambda: all(each.get_num_connections() for each in publishers), "the tracker to listen")

    def announce(self, stamp_ns: int, cue: str, sequence: int) -> None:
        self._announcements.publish(announcement_to_msg(Announcement(stamp_ns, cue, sequence), FRAME))

    def deliver(self, stamp_ns: int, cue: str, sequence: int) -> None:
        measurement = Measurement(
            stamp_ns=stamp_ns,
            cue=cue,
            modality="legs",
            frame_id=FRAME,
            positions=np.array([[2.0, 0.0, 1.0]]),
            covariances=np.diag([0.01, 0.01, 0.0])[None],
            confidences=np.array([0.9]),
            observed=XY_OBSERVED,
            period_s=1.0 / RATE_HZ,
            sequence=sequence,
        )
        self._detections.publish(measurement_to_msg(measurement))


class FakeCue:
    """Announces at a steady rate and delivers a while later, until it leaves the context.

    Attributes:
        announces, delivers: whether it does.
        stamps_ns: of all that it delivered.
    """

    def __init__(self, wire: Wire, name: str, delay_s: float = 0.01) -> None:
        self.name, self.announces, self.delivers = name, True, True
        self.stamps_ns: List[int] = []
        self._wire, self._delay_s = wire, delay_s
        self._over = threading.Event()
        self._threads: List[threading.Thread] = []

    def __enter__(self) -> FakeCue:
        self._threads = [threading.Thread(target=self._speak, daemon=True)]
        self._threads[0].start()
        return self

    def __exit__(self, *_exception: Any) -> None:
        self._over.set()
        self._threads[0].join()

    def _speak(self) -> None:
        sequence, at = 0, time.monotonic()
        owed: List[Any] = []
        while not self._over.is_set():
            now = time.monotonic()
            while owed and owed[0][0] <= now:
                _, stamp_ns, number = owed.pop(0)
                if self.delivers:
                    self.stamps_ns.append(stamp_ns)
                    self._wire.deliver(stamp_ns, self.name, number)
            if at <= now:
                sequence, at = sequence + 1, at + 1.0 / RATE_HZ
                stamp_ns = stamp_from_msg(rospy.Time.now())
                if self.announces:
                    self._wire.announce(stamp_ns, self.name, sequence)
                owed.append((now + self._delay_s, stamp_ns, sequence))
            ends = [at, *(due for due, _, _ in owed[:1])]
            self._over.wait(max(0.0, min(ends) - time.monotonic()))


class OutputListener:
    """Stamps of the tracks that come on a topic, and when they came, nanoseconds."""

    def __init__(self, topic: str = "/people_fusion/tracks") -> None:
        self.stamps_ns: List[int] = []
        self.arrivals_ns: List[int] = []
        rospy.Subscriber(topic, TrackedPersons, self._on_tracks, queue_size=1000, tcp_nodelay=True)

    def during(self, begin_ns: int, end_ns: int) -> List[int]:
        """Stamps of what came within this time."""
        heard = list(zip(self.arrivals_ns, self.stamps_ns))
        return [stamp_ns for arrival_ns, stamp_ns in heard if begin_ns <= arrival_ns < end_ns]

    def delays_s(self) -> np.ndarray:
        """Ages of the tracks on arrival, seconds."""
        size = len(self.arrivals_ns)
        return 1e-9 * (np.array(self.arrivals_ns) - np.array(self.stamps_ns[:size]))

    def _on_tracks(self, message: Any) -> None:
        self.stamps_ns.append(stamp_from_msg(message.header.stamp))
        self.arrivals_ns.append(stamp_from_msg(rospy.Time.now()))


def pause(seconds: float) -> Dict[str, int]:
    """Let time pass; returns when it began and ended, as OutputListener.during takes it."""
    begin_ns = stamp_from_msg(rospy.Time.now())
    rospy.sleep(seconds)
    return {"begin_ns": begin_ns, "end_ns": begin_ns + from_seconds(seconds)}
