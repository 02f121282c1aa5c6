#!/usr/bin/env python3
"""A recording that is played three times in a loop, and tracks that are the same to the last bit."""

from __future__ import annotations

import sys
import tempfile
import unittest
from pathlib import Path
from typing import Dict, List, Tuple

import numpy as np
import rosbag
import rospy
import rostest
from graph import TrackListener, playing, simulated, wait_for_subscribers, wait_until

from people_fusion.core.tracks import Tracks

SECONDS = 5.0
ROUNDS = 3
QUIET_S = 0.3
LEARNING_NS = 200_000_000  # nothing waits for a scanner before its first scan makes it known
EDGE_NS = 500_000_000  # what waits when the time jumps is lost, and counted


def without_beginning(whole: Path) -> Path:
    """No scan comes before the clock, which is published now and then, tells of the new round."""
    path = whole.with_name("later.bag")
    with rosbag.Bag(str(whole)) as bag, rosbag.Bag(str(path), "w") as copy:
        begin = bag.get_start_time()
        for topic, message, at in bag.read_messages():
            if not topic.startswith("/scan") or at.to_sec() > begin + QUIET_S:
                copy.write(topic, message, at)
    return path


def rounds(tracks: List[Tracks]) -> List[List[Tracks]]:
    """Tracks cut where the stamps go back."""
    cuts = [i for i in range(1, len(tracks)) if tracks[i].stamp_ns < tracks[i - 1].stamp_ns - 10**9]
    return [tracks[first:last] for first, last in zip([0, *cuts], [*cuts, len(tracks)])]


def described(tracks: List[Tracks], begin_ns: int, end_ns: int) -> List[Tuple]:
    """What each message says, with identities counted in order of appearance."""
    names: Dict[int, int] = {}
    said = []
    for entry in tracks:
        ids = tuple(names.setdefault(identity, len(names)) for identity in entry.ids.tolist())
        if begin_ns <= entry.stamp_ns <= end_ns:
            said.append((entry.stamp_ns, ids, entry.means.tobytes(), entry.covariances.tobytes()))
    return said


class LoopIdentical(unittest.TestCase):
    def test_each_round_gives_the_same(self) -> None:
        with tempfile.TemporaryDirectory() as directory:
            bag = without_beginning(simulated(Path(directory), "hallway", SECONDS))
            for node in ("/leg_cue_front", "/leg_cue_rear", "/people_tracker"):
                wait_for_subscribers("/tf", node)
            listener = TrackListener()
            with playing(bag, "--rate=2", "--loop"):
                wait_until(lambda: len(rounds(listener.tracks())) > ROUNDS, f"{ROUNDS} rounds", 30.0)
        whole = rounds(listener.tracks())[:ROUNDS]
        begin_ns = max(part[0].stamp_ns for part in whole) + LEARNING_NS
        end_ns = min(part[-1].stamp_ns for part in whole) - EDGE_NS
        said = [described(part, begin_ns, end_ns) for part in whole]
        rospy.loginfo(
            "%d messages a round, %d of them with tracks", len(said[0]), sum(bool(ids) for _, ids, *_ in said[0])
        )
        self.assertGreater(end_ns - begin_ns, (SECONDS - 1.5) * 1e9)
        self.assertTrue(any(ids for _, ids, *_ in said[0]))
        for other in said[1:]:
            differing = [first[0] for first, second in zip(said[0], other) if first != second]
            self.assertEqual([len(other), differing], [len(said[0]), []])
        self.assertTrue(np.all(np.diff([stamp_ns for stamp_ns, *_ in said[0]]) >= 0))


if __name__ == "__main__":
    rospy.init_node("loop_identical")
    rostest.rosrun("people_fusion", "loop_identical", LoopIdentical, sys.argv)
