"""What the rostests share: recordings made on the fly, players, listeners and conditions to wait for."""

from __future__ import annotations

import dataclasses
import subprocess
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Sequence

import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray

from people_fusion.core.tracks import Tracks
from people_fusion.evaluation.clear_mot import ClearMot
from people_fusion.msg import TrackedPersons
from people_fusion.replay.evaluate_tracks import read_truth, sample
from people_fusion.replay.recording import Recording
from people_fusion.replay.replay import Selection, replay, score
from people_fusion.replay.track_bag import TRACKS_TOPIC, read_tracks
from people_fusion.ros.conversions import tracks_from_msg
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import simulate
from people_fusion.tracking.fusion import load_config

PATIENCE_S = 20.0  # by the wall; for what should take much less


def simulated(directory: Path, scenario: str, duration_s: float, seed: int = 1) -> Path:
    """A recording with ground truth."""
    shortened = dataclasses.replace(load_scenario(scenario), duration_s=duration_s)
    path = directory / f"{scenario}.bag"
    write_bag(path, simulate(shortened, seed))
    return path


def offline(bag: Path) -> List[Tracks]:
    """Tracks of the default preset without a graph."""
    with tempfile.TemporaryDirectory() as directory:
        out = Path(directory) / "tracks.bag"
        replay(bag, load_config(), Selection(), out=out)
        with Recording(out) as recording:
            return read_tracks(recording, recording.topic(TRACKS_TOPIC))


def scored(bag: Path, tracks: Sequence[Tracks]) -> ClearMot:
    """CLEAR-MOT of tracks against a recording's ground truth."""
    instants, transforms = read_truth(bag, None, tracks[0].frame_id)
    return score(sample(list(tracks), instants, transforms), Selection())[2].scores.clear_mot


@contextmanager
def playing(bag: Path, *options: str) -> Iterator[subprocess.Popen]:
    """A player of the recording under its own clock; what listens to it has a second to connect."""
    command = ["rosbag", "play", "--clock", "--quiet", "--delay=1", *options, str(bag)]
    player = subprocess.Popen(command, stdin=subprocess.DEVNULL)
    try:
        yield player
    finally:
        player.terminate()
        player.wait()


def play(bag: Path, *options: str) -> None:
    """Play to the end."""
    with playing(bag, *options) as player:
        assert player.wait() == 0


def wait_until(condition: Callable[[], Any], what: str, patience_s: float = PATIENCE_S) -> None:
    """Wait by the wall; a node's own clock may stand still.

    Raises:
        AssertionError: it did not happen.
    """
    end = time.monotonic() + patience_s
    while not condition():
        assert time.monotonic() < end, f"waited {patience_s} s in vain for {what}"
        time.sleep(0.05)


def wait_for_subscribers(topic: str, *nodes: str) -> None:
    """Wait until all these nodes listen to a topic."""
    master = rosgraph.Master(rospy.get_name())

    def connected() -> bool:
        listeners = dict(master.getSystemState()[1]).get(topic, [])
        return set(nodes) <= set(listeners)

    wait_until(connected, f"{nodes} to listen to {topic}")


class TrackListener:
    """All tracks that come on a topic, in order of arrival."""

    def __init__(self, topic: str = "/people_fusion/tracks") -> None:
        self.messages: List[Any] = []
        rospy.Subscriber(topic, TrackedPersons, self.messages.append, queue_size=1000, tcp_nodelay=True)

    def tracks(self) -> List[Tracks]:
        """As core types."""
        return [tracks_from_msg(message) for message in list(self.messages)]


class DiagnosticListener:
    """The newest status of every node."""

    def __init__(self) -> None:
        self._statuses: Dict[str, Any] = {}
        rospy.Subscriber("/diagnostics", DiagnosticArray, self._on_array, queue_size=100)

    def level(self, node: str) -> int:
        """DiagnosticStatus's level, -1 before the first."""
        return self._statuses[node].level if node in self._statuses else -1

    def message(self, node: str) -> str:
        """Message of the status."""
        return self._statuses[node].message if node in self._statuses else ""

    def value(self, node: str, key: str) -> str:
        """A value, empty where there is none."""
        entries = self._statuses[node].values if node in self._statuses else []
        return next((entry.value for entry in entries if entry.key == key), "")

    def count(self, node: str, key: str) -> int:
        """A counter, 0 where there is none."""
        return int(self.value(node, key) or 0)

    def _on_array(self, message: Any) -> None:
        for status in message.status:
            self._statuses[status.name.split(":")[0]] = status
