"""Recordings that other people made with their robots."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from people_fusion.core.errors import PeopleFusionError, RecordingError
from people_fusion.replay.recording import Recording
from people_fusion.replay.replay import Selection, replay
from people_fusion.tracking.fusion import load_config

SMOKE = {
    "merged_scan_many_frames.bag": ("/zed/scan_merged", "map"),
    "neato_person_following.bag": ("/scan", "odom"),
    "neato_with_camera.bag": ("/scan", "odom"),
    "turtlebot3_person_following.bag": ("/scan", "base_scan"),
    "two_hokuyo.bag": ("/front_scan", "front_scanner"),
}
EVERY_PRESET = ("default", "poschmann_t1", "volkhardt", "leg_mht", "kalman_over_legs", "poschmann_t2", "particles")
MOVING = "laser_people_moving/general_tracking_moving_1.bag"
OTHERS = (
    "laser_legs/demo_stationary_simple_environment.bag",
    "laser_legs/negative_2.bag",
    "laser_legs/positive_1_extracted.bag",
    "laser_legs/raw/positive_1.bag",
    "laser_legs_mir/corridor.bag",
    "laser_legs_mir/front_extracted.bag",
    MOVING,
)


@pytest.mark.parametrize("preset", ["default", "leg_mht", "kalman_over_legs", "poschmann_t2", "particles"])
@pytest.mark.parametrize("name", SMOKE)
def test_smoke_bags_run(recordings: Path, name: str, preset: str) -> None:
    outcome = replay(recordings / "smoke_bags" / name, load_config(preset), Selection(duration_s=5.0))
    topic, world = SMOKE[name]
    assert [scan.name for scan in outcome.sources.scans] == [topic]
    assert outcome.sources.frames.world == world
    assert outcome.processed >= 0.85 * outcome.scans


def test_labelled_scans_are_preferred(recordings: Path) -> None:
    outcome = replay(recordings / "laser_legs_mir/front_extracted.bag", load_config(), Selection(duration_s=5.0))
    assert [scan.name for scan in outcome.sources.scans] == ["/training_scan"]


@pytest.mark.slow
@pytest.mark.parametrize("preset", EVERY_PRESET)
@pytest.mark.parametrize("name", [*(f"smoke_bags/{name}" for name in SMOKE), *OTHERS])
def test_whole_recordings_run_with_every_preset(recordings: Path, name: str, preset: str) -> None:
    outcome = replay(recordings / name, load_config(preset), Selection())
    assert outcome.processed >= 0.9 * outcome.scans


def test_annotated_people_are_found_where_they_are_annotated(recordings: Path) -> None:
    selection = Selection(start_s=16.0, duration_s=18.0, only_annotated=True)
    outcome = replay(recordings / MOVING, load_config(), selection)
    assert outcome.sources.ground_truth is not None
    assert outcome.sources.ground_truth.type == "leg_tracker/Person"
    assert outcome.evaluation is not None
    scores = outcome.evaluation.scores.clear_mot
    assert scores.ground_truth_count > 30 and scores.frames > 25
    assert scores.recall is not None and scores.recall > 0.3
    assert scores.motp_m is not None and scores.motp_m < 0.2


def test_people_who_stand_while_the_robot_passes_are_found(recordings: Path) -> None:
    selection = Selection(start_s=36.0, duration_s=20.0, only_annotated=True)
    outcome = replay(recordings / MOVING, load_config(), selection)
    assert outcome.evaluation is not None
    scores = outcome.evaluation.scores.clear_mot
    assert scores.ground_truth_count > 90
    assert scores.recall is not None and scores.recall > 0.75
    assert scores.motp_m is not None and scores.motp_m < 0.15


@pytest.mark.parametrize("share", [0.1, 0.6, 0.99])
def test_a_truncated_recording_is_refused(recordings: Path, tmp_path: Path, share: float) -> None:
    content = (recordings / "smoke_bags" / "turtlebot3_person_following.bag").read_bytes()
    path = tmp_path / "cut.bag"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RecordingError, match=r"cut\.bag"):
        Recording(path)


def test_flipped_bytes_of_a_real_recording_end_in_one_error_at_most(recordings: Path, tmp_path: Path) -> None:
    content = np.frombuffer((recordings / "smoke_bags" / "turtlebot3_person_following.bag").read_bytes(), np.uint8)
    rng = np.random.default_rng(7)
    for trial in range(6):
        damaged = content.copy()
        damaged[rng.integers(0, len(content), 100)] ^= 0xFF
        path = tmp_path / f"{trial}.bag"
        path.write_bytes(damaged.tobytes())
        try:
            replay(path, load_config(), Selection(duration_s=5.0))
        except PeopleFusionError as error:
            assert f"{trial}.bag" in str(error)
