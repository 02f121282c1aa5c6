#!/usr/bin/env python3
"""One recording through the graph of separate nodes, through the composed node and through a replay."""

from __future__ import annotations

import sys
import tempfile
import unittest
from pathlib import Path
from typing import Dict, List

import numpy as np
import rospy
import rostest
from graph import TrackListener, offline, play, scored, simulated, wait_for_subscribers, wait_until

from people_fusion.core.tracks import Tracks

MOTA_TOLERANCE = 0.02
SAME_PLACE_M = 0.01
SAME_SHARE = 0.98


class LiveEqualsOffline(unittest.TestCase):
    directory: tempfile.TemporaryDirectory

    @classmethod
    def setUpClass(cls) -> None:
        cls.directory = tempfile.TemporaryDirectory()
        cls.bag = simulated(Path(cls.directory.name), "hallway", 30.0)
        wait_for_subscribers("/scan_front", "/separate/leg_cue", "/composed/people_fusion")
        wait_for_subscribers("/tf", "/separate/people_tracker")
        separate = TrackListener("/separate/people_fusion/tracks")
        composed = TrackListener("/composed/people_fusion/tracks")
        play(cls.bag, "--rate=2")
        reference = offline(cls.bag)
        wait_until(lambda: separate.messages and composed.messages, "tracks")
        cls.separate, cls.composed, cls.offline = separate.tracks(), composed.tracks(), reference

    @classmethod
    def tearDownClass(cls) -> None:
        cls.directory.cleanup()

    def test_separate_nodes_track_as_well_as_the_replay(self) -> None:
        self.assert_as_good(self.separate)

    def test_composed_node_tracks_as_well_as_the_replay(self) -> None:
        self.assert_as_good(self.composed)

    def test_composed_node_gives_the_tracks_of_the_separate_ones(self) -> None:
        separate, composed = last_of_each_stamp(self.separate), last_of_each_stamp(self.composed)
        stamps = sorted(set(separate) & set(composed))
        self.assertGreater(len(stamps), 0.95 * len(separate))
        same = [same_places(separate[stamp], composed[stamp]) for stamp in stamps]
        self.assertGreater(np.mean(same), SAME_SHARE)

    def assert_as_good(self, tracks: List[Tracks]) -> None:
        live, reference = scored(self.bag, tracks), scored(self.bag, self.offline)
        rospy.loginfo("MOTA live %.3f, offline %.3f", live.mota, reference.mota)
        self.assertGreater(reference.mota, 0.3)
        self.assertLess(abs(live.mota - reference.mota), MOTA_TOLERANCE)


def last_of_each_stamp(tracks: List[Tracks]) -> Dict[int, Tracks]:
    return {entry.stamp_ns: entry for entry in tracks}


def same_places(first: Tracks, second: Tracks) -> bool:
    if len(first) != len(second):
        return False
    distances = np.linalg.norm(first.means[:, None, :2] - second.means[None, :, :2], axis=2)
    return len(first) == 0 or bool((distances.min(axis=1) < SAME_PLACE_M).all())


if __name__ == "__main__":
    rospy.init_node("live_equals_offline")
    rostest.rosrun("people_fusion", "live_equals_offline", LiveEqualsOffline, sys.argv)
