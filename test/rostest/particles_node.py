#!/usr/bin/env python3
"""Particles of somebody who walks are where the track is, in its colour, and no oftener than is said."""

from __future__ import annotations

import sys
import unittest
from typing import Any, List

import numpy as np
import rospy
import rostest
from graph import wait_for_subscribers, wait_until
from scans import PERIOD_S, good_scan
from sensor_msgs.msg import LaserScan
from visualization_msgs.msg import MarkerArray

from people_fusion.core.stamps import to_seconds
from people_fusion.core.tracks import Particles
from people_fusion.msg import TrackedPersons, TrackParticles
from people_fusion.ros.conversions import particles_from_msg, tracks_from_msg

SPEED, RATE = 0.5, 5.0


class ParticlesSeen(unittest.TestCase):
    def setUp(self) -> None:
        self.particles: List[Particles] = []
        self.shown: List[Any] = []
        self.tracks: List[Any] = []
        self._scans = rospy.Publisher("/scan", LaserScan, queue_size=10)
        rospy.Subscriber("/people_fusion/particles", TrackParticles, self._on_particles)
        rospy.Subscriber("/people_fusion/particle_markers", MarkerArray, self.shown.append)
        rospy.Subscriber("/people_fusion/tracks", TrackedPersons, self._on_tracks)
        wait_for_subscribers("/scan", "/people_fusion")

    def test_particles_are_where_the_track_is(self) -> None:
        began = rospy.get_time()

        def walked() -> bool:
            way = SPEED * (rospy.get_time() - began)
            self._scans.publish(good_scan(1.0 + way % 4.0, 0.0))
            rospy.sleep(PERIOD_S)
            return sum(each.confirmed.any() for each in self.particles) > 5 and len(self.shown) > 5

        wait_until(walked, "particles of a person")
        particles = self.particles[-1]
        tracks = {each.stamp_ns: each for each in self.tracks}[particles.stamp_ns]
        (row,) = np.flatnonzero(particles.ids == tracks.ids[0])
        mean = particles.weights[row] @ particles.positions[row]
        np.testing.assert_allclose(mean, tracks.means[0, :3], atol=1e-3)
        apart_s = np.diff([to_seconds(each.stamp_ns) for each in self.particles])
        self.assertGreaterEqual(apart_s.min(), 1.0 / RATE - 1e-6)
        points = [marker for marker in self.shown[-1].markers if marker.ns == "particle"]
        self.assertEqual(len(points[0].points), particles.weights.shape[1])
        self.assertEqual(len(points[0].colors), particles.weights.shape[1])

    def _on_particles(self, message: Any) -> None:
        self.particles.append(particles_from_msg(message))

    def _on_tracks(self, message: Any) -> None:
        self.tracks.append(tracks_from_msg(message))


if __name__ == "__main__":
    rospy.init_node("particles")
    rostest.rosrun("people_fusion", "particles", ParticlesSeen, sys.argv)
