#!/usr/bin/env python3
"""The cue is killed in the middle of a recording; launch starts it again."""

from __future__ import annotations

import os
import signal
import sys
import tempfile
import unittest
from pathlib import Path
from typing import Optional
from xmlrpc.client import ServerProxy

import rosgraph
import rospy
import rostest
from graph import TrackListener, playing, simulated, wait_for_subscribers, wait_until


def process_of(node: str) -> Optional[int]:
    """The node's process, None where there is none behind the name."""
    try:
        uri = rosgraph.Master(rospy.get_name()).lookupNode(node)
        return ServerProxy(uri).getPid(rospy.get_name())[2]
    except (rosgraph.MasterError, OSError):
        return None


def has_people(listener: TrackListener, since: int) -> bool:
    return any(message.tracks for message in listener.messages[since:])


class CueRestart(unittest.TestCase):
    def test_tracker_survives_and_tracks_come_back(self) -> None:
        with tempfile.TemporaryDirectory() as directory:
            bag = simulated(Path(directory), "hallway", 40.0)
            wait_for_subscribers("/scan_front", "/leg_cue")
            wait_for_subscribers("/tf", "/leg_cue", "/people_tracker")
            listener = TrackListener()
            with playing(bag):
                wait_until(lambda: has_people(listener, 0), "tracks")
                cue, tracker = process_of("/leg_cue"), process_of("/people_tracker")
                os.kill(cue, signal.SIGKILL)
                wait_until(lambda: process_of("/leg_cue") not in (cue, None), "the cue to come back")
                killed_at = len(listener.messages)
                wait_until(lambda: has_people(listener, killed_at), "tracks to come back")
                self.assertEqual(process_of("/people_tracker"), tracker)
            stamps = [message.header.stamp for message in listener.messages]
            self.assertEqual(stamps, sorted(stamps))


if __name__ == "__main__":
    rospy.init_node("cue_restart")
    rostest.rosrun("people_fusion", "cue_restart", CueRestart, sys.argv)
