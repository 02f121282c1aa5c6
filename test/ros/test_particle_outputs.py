from __future__ import annotations

from typing import Any, Dict

import numpy as np
import pytest

pytest.importorskip("people_fusion.msg", reason="the messages are not built; tools/test builds them")

from visualization_msgs.msg import Marker

from people_fusion.core.tracks import Particles
from people_fusion.core.transforms import FramesConfig
from people_fusion.ros import outputs, topics
from people_fusion.ros.outputs import TrackOutputs

MS = 10**6


class Topic:
    """A publisher without a graph."""

    def __init__(self) -> None:
        self.listeners = 0
        self.sent: list = []

    def get_num_connections(self) -> int:
        return self.listeners

    def publish(self, message: Any) -> None:
        self.sent.append(message)


@pytest.fixture()
def graph(monkeypatch: pytest.MonkeyPatch) -> Dict[str, Topic]:
    advertised: Dict[str, Topic] = {}
    monkeypatch.setattr(
        outputs.rospy, "Publisher", lambda name, *_args, **_settings: advertised.setdefault(name, Topic())
    )
    return advertised


def made(particle_rate: float) -> TrackOutputs:
    return TrackOutputs(None, FramesConfig(), "none", particle_rate=particle_rate)  # type: ignore[arg-type]


def particles_at(stamp_ns: int) -> Particles:
    ids, confirmed = np.array([3]), np.array([True])
    return Particles(stamp_ns, "map", ids, confirmed, np.zeros((1, 2, 3)), np.zeros((1, 2, 2)), np.full((1, 2), 0.5))


def test_trackers_without_particles_advertise_none(graph: Dict[str, Topic]) -> None:
    shown = made(0.0)
    assert not {topics.PARTICLES, topics.PARTICLE_MARKERS} & set(graph)
    assert not shown.particles_due(1000 * MS)


def test_particles_are_not_due_while_nobody_looks(graph: Dict[str, Topic]) -> None:
    shown = made(5.0)
    assert not shown.particles_due(1000 * MS)
    graph[topics.PARTICLE_MARKERS].listeners = 1
    assert shown.particles_due(1000 * MS)
    shown.publish_particles(particles_at(1000 * MS))
    assert len(graph[topics.PARTICLE_MARKERS].sent) == 1
    assert not graph[topics.PARTICLES].sent


def test_particles_come_no_oftener_than_is_said_and_at_once_after_a_jump_back(graph: Dict[str, Topic]) -> None:
    shown = made(5.0)
    graph[topics.PARTICLES].listeners = 1
    shown.publish_particles(particles_at(1000 * MS))
    assert [shown.particles_due(ms * MS) for ms in (1000, 1199, 1200, 999)] == [False, False, True, True]


def test_particles_go_from_the_screen_when_time_jumps(graph: Dict[str, Topic]) -> None:
    made(5.0).reset()
    (array,) = graph[topics.PARTICLE_MARKERS].sent
    assert [marker.action for marker in array.markers] == [Marker.DELETEALL]
    assert not graph[topics.PARTICLES].sent
