#!/usr/bin/env python3
"""Nodes with a wrong parameter end with one line that names its whole path."""

from __future__ import annotations

import subprocess
import sys
import unittest
from typing import Any

import rospy
import rostest

EXECUTABLES = ("leg_cue", "people_tracker", "people_fusion")


class BadParameter(unittest.TestCase):
    def test_unknown_key_is_named_by_every_node(self) -> None:
        for executable in EXECUTABLES:
            self.assert_refused("tracker", {"type": "kalman", "gaet": 1.0}, "tracker/gaet", executable)

    def test_wrong_type_is_named(self) -> None:
        self.assert_refused("frames", {"world": 7}, "frames/world")

    def test_value_out_of_range_is_named(self) -> None:
        self.assert_refused("leg_cue", {"type": "legs", "group_gap": -1.0}, "leg_cue/group_gap")

    def assert_refused(self, name: str, value: Any, path: str, executable: str = "people_fusion") -> None:
        node = f"wrong_{executable}"
        rospy.set_param(f"/{node}", {name: value})
        done = subprocess.run(
            ["rosrun", "people_fusion", executable, f"__name:={node}"],
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )
        self.assertEqual(done.returncode, 1, done.stderr)
        self.assertIn(f"/{node}/{path}: ", done.stderr)
        self.assertEqual(len(done.stderr.strip().splitlines()), 1, done.stderr)
        rospy.delete_param(f"/{node}")


if __name__ == "__main__":
    rospy.init_node("bad_parameter")
    rostest.rosrun("people_fusion", "bad_parameter", BadParameter, sys.argv)
