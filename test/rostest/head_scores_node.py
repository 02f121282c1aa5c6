#!/usr/bin/env python3
"""People are found by scores on the wire, stay while the head cue is dead, and scores count again when it is back."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import unittest
from pathlib import Path
from typing import Any, List

import rospy
import rostest
from graph import TrackListener, playing, simulated, wait_for_subscribers, wait_until
from rospy.numpy_msg import numpy_msg

from people_fusion.core.camera_models import Panorama
from people_fusion.core.stamps import NANOSECONDS
from people_fusion.msg import DetectedPersons, HeadScores
from people_fusion.ros.conversions import stamp_from_msg
from people_fusion.ros.head_scores import scored_from_msg
from people_fusion.tracking.fusion import load_config

IMAGE, NODE = "/panorama/image_raw/compressed", "/head_cues"


class Scores(unittest.TestCase):
    def setUp(self) -> None:
        self.directory = tempfile.TemporaryDirectory()
        self.bag = simulated(Path(self.directory.name), "museum_cameras", 18.0)
        self.detected: List[Any] = []
        self.scored: List[Any] = []
        rospy.Subscriber("/people_fusion/detections", DetectedPersons, self._on_detections)
        rospy.Subscriber("/people_fusion/head_scores", numpy_msg(HeadScores), self.scored.append, buff_size=1 << 25)
        wait_for_subscribers(IMAGE, NODE)
        wait_for_subscribers("/people_fusion/head_scores", "/people_fusion")

    def tearDown(self) -> None:
        self.directory.cleanup()

    def test_tracker_by_scores(self) -> None:
        listener = TrackListener()

        def people() -> int:
            return len(listener.messages[-1].tracks) if listener.messages else 0

        with playing(self.bag):
            wait_until(lambda: people() >= 2 and len(self.scored) > 5, "people by scores")
            panoramas = {frame: Panorama(each) for frame, each in load_config("poschmann_t2").panoramas.items()}
            scores = scored_from_msg(self.scored[-1], panoramas).scores
            assert scores is not None and scores.has_features
            heads = [message for message in self.detected if message.modality == "head"]
            self.assertTrue(any(message.scored for message in heads))
            subprocess.run(["rosnode", "kill", NODE], check=True, stdout=subprocess.DEVNULL)
            killed_at, before = len(self.scored), len(listener.messages)
            wait_until(lambda: len(listener.messages) > before + 10, "tracks while the head cue is dead")
            self.assertGreater(people(), 0)  # their legs are seen
            wait_until(lambda: len(self.scored) > killed_at + 5, "scores when the head cue is back")
            before = len(listener.messages)
            wait_until(lambda: len(listener.messages) > before + 10 and people() >= 2, "people by the new scores")
        stamps_ns = [tracks.stamp_ns for tracks in listener.tracks()]
        self.assertEqual(stamps_ns, sorted(stamps_ns))
        self.assertGreater(stamps_ns[-1] - stamps_ns[0], 2 * NANOSECONDS)
        scored = {(message.cue, stamp_from_msg(message.header.stamp)) for message in self.detected if message.scored}
        told = {(each.detections.cue, stamp_from_msg(each.detections.header.stamp)) for each in self.scored}
        self.assertGreaterEqual(len(scored & told), len(told) - 3)  # the same go out on both topics

    def _on_detections(self, message: Any) -> None:
        self.detected.append(message)


if __name__ == "__main__":
    rospy.init_node("head_scores")
    rostest.rosrun("people_fusion", "head_scores", Scores, sys.argv)
