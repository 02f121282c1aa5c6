#!/usr/bin/env python3
"""One good cue; what others do to it must not be seen in the output for longer than the patience."""

from __future__ import annotations

import sys
import unittest
from typing import List

import numpy as np
import rospy
import rostest
from fake_cues import RATE_HZ, FakeCue, OutputListener, Wire, pause
from graph import DiagnosticListener, wait_until

from people_fusion.core.stamps import NANOSECONDS
from people_fusion.ros.conversions import stamp_from_msg
from people_fusion.ros.intake import SHED

TRACKER = "people_tracker"
YEAR_NS = 365 * 24 * 3600 * NANOSECONDS
PATIENCE_S = 0.3
BURST = 200
FLOOD = 900  # as fast as they can be sent


class LateCues(unittest.TestCase):
    wire: Wire
    diagnostics: DiagnosticListener

    @classmethod
    def setUpClass(cls) -> None:
        cls.wire, cls.diagnostics = Wire(), DiagnosticListener()

    def setUp(self) -> None:
        self.output = OutputListener()
        self.good = FakeCue(self.wire, f"good_{self._testMethodName[5:9]}")
        self.good.__enter__()
        wait_until(lambda: len(self.output.stamps_ns) > 10, "tracks of the good cue")

    def tearDown(self) -> None:
        self.good.__exit__()
        self.assertEqual(self.output.stamps_ns, sorted(self.output.stamps_ns))
        self.assertEqual(self.diagnostics.count(TRACKER, "time jumps"), 0)

    def test_cue_killed_after_announcing(self) -> None:
        with FakeCue(self.wire, "killed", 0.03) as killed:
            pause(1.0)
            killed.delivers = False
            pause(0.06)
        pause(1.0)
        self.assert_at_full_rate(1.0)
        self.assert_counted("killed: announced without delivering")

    def test_cue_ten_times_slower_than_the_patience(self) -> None:
        with FakeCue(self.wire, "slow", 10 * PATIENCE_S):
            pause(1.0)
            self.assert_at_full_rate(3.0)
        self.assert_counted("slow: announced without delivering")
        self.assert_counted("slow: delivered after its announcement expired")

    def test_burst(self) -> None:
        stamps_ns = stamp_from_msg(rospy.Time.now()) - np.arange(BURST, 0, -1) * 4_000_000
        for sequence, stamp_ns in enumerate(stamps_ns.tolist()):
            self.wire.deliver(stamp_ns, "flood", sequence)
        pause(1.0)
        self.assert_at_full_rate(1.0)
        self.assert_counted("late measurements")
        shed, late = (self.diagnostics.count(TRACKER, name) for name in (f"flood: lost: {SHED}", "late measurements"))
        rospy.loginfo("of %d at once %d were shed; %d late since the start", BURST, shed, late)

    def test_more_than_can_be_processed_is_shed_and_counted(self) -> None:
        for sequence in range(1, FLOOD + 1):
            self.wire.deliver(stamp_from_msg(rospy.Time.now()), "torrent", sequence)
        pause(1.0)
        self.assert_at_full_rate(1.0)
        self.assert_counted(f"torrent: lost: {SHED}")

    def test_stamp_a_year_ahead(self) -> None:
        ahead_ns = stamp_from_msg(rospy.Time.now()) + YEAR_NS
        for sequence in (1, 2, 3):
            self.wire.announce(ahead_ns + sequence, "prophet", sequence)
            self.wire.deliver(ahead_ns + sequence, "prophet", sequence)
        self.assert_at_full_rate(1.0)
        self.assertLess(max(self.output.stamps_ns), ahead_ns)
        self.assert_counted("lost: prophet: stamp from the future")

    def test_announcements_without_delivery(self) -> None:
        with FakeCue(self.wire, "herald") as herald:
            herald.delivers = False
            pause(1.0)
            self.assert_at_full_rate(2.0)
        self.assert_counted("herald: announced without delivering")

    def test_deliveries_without_announcement(self) -> None:
        with FakeCue(self.wire, "stranger") as stranger:
            stranger.announces = False
            pause(1.0)
            self.assert_at_full_rate(1.0)
            pause(2 * PATIENCE_S)
            delivered = [stamp for stamp in stranger.stamps_ns if stamp < self.output.stamps_ns[-1]]
        share = np.mean(np.isin(delivered, self.output.stamps_ns))
        self.assertGreater(share, 0.9)

    def test_preview_does_not_wait(self) -> None:
        preview = OutputListener("/people_fusion/tracks_preview")
        with FakeCue(self.wire, "camera", 0.1):
            pause(1.0)
            ordered = OutputListener()
            pause(1.0)
        waited, hurried = np.median(ordered.delays_s()), np.median(preview.delays_s())
        rospy.loginfo("delay in order %.3f s, at once %.3f s", waited, hurried)
        self.assertLess(hurried, 0.05)
        self.assertGreater(waited, hurried)

    def assert_at_full_rate(self, seconds: float) -> None:
        window = pause(seconds)
        stamps: List[int] = [stamp for stamp in self.good.stamps_ns if stamp in self.output.during(**window)]
        rospy.loginfo("%s: %.1f Hz of the good cue", self._testMethodName, len(stamps) / seconds)
        self.assertGreaterEqual(len(stamps), 0.9 * RATE_HZ * seconds)

    def assert_counted(self, event: str) -> None:
        wait_until(lambda: self.diagnostics.count(TRACKER, event) > 0, f"«{event}» in the diagnostics", 5.0)


if __name__ == "__main__":
    rospy.init_node("late_cues")
    rostest.rosrun("people_fusion", "late_cues", LateCues, sys.argv)
