"""Everything that the tracker publishes; made only for topics that somebody listens to."""

from __future__ import annotations

from typing import Any, Callable, List, Optional, Tuple

import numpy as np
import rospy
from geometry_msgs.msg import PoseArray, PoseStamped
from visualization_msgs.msg import MarkerArray

from people_fusion.core.errors import TransformUnavailable
from people_fusion.core.stamps import from_seconds
from people_fusion.core.tracks import Legs, Particles, Tracks
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.msg import TrackedPersons, TrackParticles
from people_fusion.ros import topics
from people_fusion.ros.adapters import people_adapter, spencer_adapter
from people_fusion.ros.conversions import header_to_msg, particles_to_msg, poses_to_msg, tracks_to_msg
from people_fusion.ros.markers import TrackMarkers, clear, leg_markers, particle_markers

COMPATIBLE = ("none", "strands")
QUEUE = 10


class TrackOutputs:
    """The tracker's publishers.

    Args:
        source: for the robot's place among the tracks.
        compatible: one of COMPATIBLE.
        revisable: whether there are previews.
        with_legs: whether the tracker follows legs.
        particle_rate: how often particles are published at most, by stamps, a second; 0: the tracker has none.
    """

    def __init__(
        self,
        source: TransformSource,
        frames: FramesConfig,
        compatible: str,
        revisable: bool = False,
        with_legs: bool = False,
        particle_rate: float = 0.0,
    ) -> None:
        self._source, self._base = source, frames.base
        self._markers = TrackMarkers(on_legs=with_legs)
        self._publishers: List[Tuple[Any, Callable[[Tracks], Any]]] = []
        self._hypotheses = rospy.Publisher(topics.HYPOTHESES, TrackedPersons, queue_size=QUEUE, tcp_nodelay=True)
        self._marker_publishers = [rospy.Publisher(topics.MARKERS, MarkerArray, queue_size=QUEUE)]
        self._preview: Optional[Any] = None
        if revisable:
            self._preview = rospy.Publisher(topics.PREVIEW, TrackedPersons, queue_size=QUEUE, tcp_nodelay=True)
        self._legs: Optional[Any] = None
        if with_legs:
            self._legs = rospy.Publisher(topics.LEG_MARKERS, MarkerArray, queue_size=QUEUE)
        self._particles: List[Tuple[Any, Callable[[Particles], Any]]] = []
        self._particles_every_ns, self._particles_ns = 0, 0
        if particle_rate > 0.0:
            self._particles_every_ns = from_seconds(1.0 / particle_rate)
            for topic, kind, convert in (
                (topics.PARTICLES, TrackParticles, particles_to_msg),
                (topics.PARTICLE_MARKERS, MarkerArray, particle_markers),
            ):
                self._particles.append((rospy.Publisher(topic, kind, queue_size=2), convert))
        self._add(topics.TRACKS, TrackedPersons, tracks_to_msg)
        self._add(topics.POSES, PoseArray, poses_to_msg)
        people, spencer = people_adapter(), spencer_adapter()
        if people is not None:
            self._add(topics.PEOPLE, people.message_type, people.convert)
        if spencer is not None:
            self._add(topics.SPENCER_TRACKS, spencer.message_type, spencer.convert)
        if compatible == "strands":
            if people is not None:
                self._add(topics.STRANDS_PEOPLE, people.message_type, people.convert)
            self._add(topics.STRANDS_POSES, PoseArray, poses_to_msg)
            self._add(topics.STRANDS_NEAREST, PoseStamped, self._nearest)
            self._marker_publishers.append(rospy.Publisher(topics.STRANDS_MARKERS, MarkerArray, queue_size=QUEUE))

    def publish(self, tracks: Tracks) -> None:
        """Publish tracks; those that are not confirmed are for rviz and for cues alone."""
        confirmed = tracks.select(tracks.confirmed)
        for publisher, convert in self._publishers:
            if publisher.get_num_connections():
                message = convert(confirmed)
                if message is not None:
                    publisher.publish(message)
        if self._hypotheses.get_num_connections():
            self._hypotheses.publish(tracks_to_msg(tracks))
        watched = [publisher for publisher in self._marker_publishers if publisher.get_num_connections()]
        if watched:
            markers = self._markers.update(tracks)
            for publisher in watched:
                publisher.publish(markers)

    @property
    def previewed(self) -> bool:
        """Whether somebody listens to previews."""
        return self._preview is not None and self._preview.get_num_connections() > 0

    def publish_preview(self, tracks: Tracks) -> None:
        """Publish tracks that will be revised."""
        if self._preview is not None:
            self._preview.publish(tracks_to_msg(tracks.select(tracks.confirmed)))

    @property
    def legs_watched(self) -> bool:
        """Whether somebody looks at legs."""
        return self._legs is not None and self._legs.get_num_connections() > 0

    def publish_legs(self, legs: Legs) -> None:
        """Publish the markers of legs."""
        if self._legs is not None:
            self._legs.publish(leg_markers(legs))

    def particles_due(self, stamp_ns: int) -> bool:
        """Whether somebody looks at particles, and the last were long enough ago."""
        is_due = not 0 <= stamp_ns - self._particles_ns < self._particles_every_ns
        return is_due and any(publisher.get_num_connections() for publisher, _ in self._particles)

    def publish_particles(self, particles: Particles) -> None:
        """Publish particles to those who listen."""
        self._particles_ns = particles.stamp_ns
        for publisher, convert in self._particles:
            if publisher.get_num_connections():
                publisher.publish(convert(particles))

    def reset(self) -> None:
        """Time has jumped: all markers go."""
        for publisher, convert in self._particles:
            if convert is particle_markers:
                publisher.publish(clear())
        for publisher in self._marker_publishers:
            publisher.publish(self._markers.clear())
        if self._legs is not None:
            self._legs.publish(clear())

    def _add(self, topic: str, message_type: Any, convert: Callable[[Tracks], Any]) -> None:
        publisher = rospy.Publisher(topic, message_type, queue_size=QUEUE, tcp_nodelay=True)
        self._publishers.append((publisher, convert))

    def _nearest(self, tracks: Tracks) -> Optional[Any]:
        """geometry_msgs/PoseStamped of the person nearest to the robot, None where there is none."""
        if len(tracks) == 0:
            return None
        try:
            robot = self._source.lookup(tracks.frame_id, self._base, tracks.stamp_ns).translation
        except TransformUnavailable:
            return None
        nearest = np.argmin(np.hypot(*(tracks.means[:, :2] - robot[:2]).T))
        header = header_to_msg(tracks.stamp_ns, tracks.frame_id)
        return PoseStamped(header=header, pose=poses_to_msg(tracks).poses[nearest])
