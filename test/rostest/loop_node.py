#!/usr/bin/env python3
"""A recording that begins again at its end."""

from __future__ import annotations

import sys
import tempfile
import unittest
from pathlib import Path
from typing import List

import numpy as np
import rospy
import rostest
from graph import DiagnosticListener, TrackListener, playing, scored, simulated, wait_for_subscribers, wait_until

from people_fusion.core.tracks import Tracks

SECONDS = 14.0


def rounds(tracks: List[Tracks]) -> List[List[Tracks]]:
    """Tracks cut where the stamps go back."""
    cuts = [i for i in range(1, len(tracks)) if tracks[i].stamp_ns < tracks[i - 1].stamp_ns - 10**9]
    return [tracks[first:last] for first, last in zip([0, *cuts], [*cuts, len(tracks)])]


def identities(tracks: List[Tracks]) -> set:
    return set(np.concatenate([entry.ids for entry in tracks]).tolist())


class Loop(unittest.TestCase):
    def test_each_round_starts_anew_with_new_identities(self) -> None:
        nodes = ("leg_cue", "people_tracker")
        with tempfile.TemporaryDirectory() as directory:
            bag = simulated(Path(directory), "hallway", SECONDS)
            wait_for_subscribers("/tf", *(f"/{node}" for node in nodes))
            listener, diagnostics = TrackListener(), DiagnosticListener()
            with playing(bag, "--rate=2", "--loop"):
                wait_until(lambda: len(rounds(listener.tracks())) > 2, "three rounds", 60.0)
                wait_until(lambda: diagnostics.count("people_tracker", "time jumps") >= 2, "the diagnostics' say")
            for node in nodes:
                self.assertEqual(diagnostics.count(node, "time jumps"), len(rounds(listener.tracks())) - 1, node)
            first, second = rounds(listener.tracks())[:2]
            self.assertTrue(identities(first))
            self.assertTrue(identities(second))
            self.assertFalse(identities(first) & identities(second))
            self.assertGreater(min(identities(second)), max(identities(first)))
            self.assertLess(abs(len(second) - len(first)), 0.05 * len(first))
            self.assertLess(abs(scored(bag, second).mota - scored(bag, first).mota), 0.05)


if __name__ == "__main__":
    rospy.init_node("loop")
    rostest.rosrun("people_fusion", "loop", Loop, sys.argv)
