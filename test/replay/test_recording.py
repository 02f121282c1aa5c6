"""Recordings are read, or refused in one line that names them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags import BagBuilder, walk

from people_fusion.core.errors import PeopleFusionError, RecordingError
from people_fusion.core.transforms import FramesConfig
from people_fusion.replay.discovery import discover
from people_fusion.replay.recording import Recording


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walk(tmp_path_factory.mktemp("bags") / "walk.bag", duration_s=2.0)


def test_topics_are_listed_with_ros_type_names(bag: Path) -> None:
    with Recording(bag) as recording:
        assert [(topic.name, topic.type, topic.count) for topic in recording.topics] == [
            ("/ground_truth", "leg_tracker/PersonArray", 4),
            ("/scan", "sensor_msgs/LaserScan", 20),
            ("/tf", "tf2_msgs/TFMessage", 120),
        ]


def test_messages_come_in_order_of_arrival_within_the_window(bag: Path) -> None:
    with Recording(bag) as recording:
        messages = list(recording.messages(recording.topics, start_s=0.5, duration_s=1.0))
        arrivals = [message.arrival_ns for message in messages]
        assert arrivals == sorted(arrivals)
        assert (arrivals[0] - recording.start_ns) / 1e9 >= 0.5 and (arrivals[-1] - recording.start_ns) / 1e9 < 1.5
        assert {message.topic for message in messages} == {"/ground_truth", "/scan", "/tf"}


def test_ranges_survive_as_an_array(bag: Path) -> None:
    with Recording(bag) as recording:
        message = next(recording.messages(recording.of_kind("LaserScan"))).read()
    assert isinstance(message.ranges, np.ndarray) and message.ranges.shape == (541,)


def test_a_topic_is_found_without_its_leading_slash(bag: Path) -> None:
    with Recording(bag) as recording:
        assert recording.topic("scan").name == "/scan"


def test_a_missing_topic_is_named_beside_those_that_are_there(bag: Path) -> None:
    expected = r"no topic /laser.*/scan.*LaserScan"
    with Recording(bag) as recording, pytest.raises(RecordingError, match=expected) as error:
        recording.topic("/laser")
    assert str(bag) in str(error.value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"nowhere\.bag"):
        Recording(tmp_path / "nowhere.bag")


@pytest.mark.parametrize("content", [b"", b"#ROSBAG V2.0\n", b"no bag at all" * 1000])
def test_a_file_that_is_no_bag_is_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "text.bag"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=r"text\.bag"):
        Recording(path)


@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.999])
def test_a_truncated_bag_is_named(bag: Path, tmp_path: Path, share: float) -> None:
    content = bag.read_bytes()
    path = tmp_path / "short.bag"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RecordingError, match=r"short\.bag"):
        Recording(path)


def test_flipped_bytes_end_in_a_recording_error_or_in_data(bag: Path, tmp_path: Path) -> None:
    content = np.frombuffer(bag.read_bytes(), dtype=np.uint8)
    rng = np.random.default_rng(3)
    failures = 0
    for trial in range(60):
        damaged = content.copy()
        places = rng.integers(0, len(content), 20)
        damaged[places] ^= rng.integers(1, 256, 20).astype(np.uint8)
        path = tmp_path / f"{trial}.bag"
        path.write_bytes(damaged.tobytes())
        try:
            with Recording(path) as recording:
                discover(recording, FramesConfig())
                for message in recording.messages(recording.topics):
                    message.read()
        except PeopleFusionError as error:
            assert f"{trial}.bag" in str(error)
            failures += 1
    assert failures > 10


def test_an_empty_bag_is_refused(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "empty.bag"):
        pass
    with pytest.raises(RecordingError, match=r"empty\.bag: no messages"):
        Recording(tmp_path / "empty.bag")
