"""replay_bag and evaluate_tracks: tables, files, and one clear line where something is wrong."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, List

import numpy as np
import pytest
from bags import LASER_AT, BagBuilder, walk

from people_fusion.core.errors import ConfigError
from people_fusion.replay import evaluate_tracks, replay_bag

SCORES = ["mota", "motp_m", "miss_rate", "false_positive_rate", "mismatch_rate", "recall", "precision", "idf1", "hota"]
SCORES += ["nees", "identity_switches", "ground_truth_count", "frames"]
COSTS = ["realtime_factor", "cpu_ms_per_scan"]


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return walk(tmp_path_factory.mktemp("bags") / "walk.bag", duration_s=5.0)


def replayed(path: Path, tmp_path: Path, *arguments: str) -> Dict[str, Any]:
    assert replay_bag.main([str(path), "--json", str(tmp_path / "out.json"), *arguments]) == 0
    return json.loads((tmp_path / "out.json").read_text())


def test_json_holds_every_figure(bag: Path, tmp_path: Path) -> None:
    result = replayed(bag, tmp_path)
    assert {*SCORES, *COSTS} <= set(result) and all(result[key] > 0.0 for key in COSTS)
    assert result["ground_truth_count"] == result["frames"] == 10
    assert result["mota"] == pytest.approx(
        1.0 - result["miss_rate"] - result["false_positive_rate"] - result["mismatch_rate"]
    )


def test_figures_are_null_without_ground_truth(tmp_path: Path) -> None:
    result = replayed(walk(tmp_path / "a.bag", 1.0, truth=False), tmp_path)
    assert [result[key] for key in SCORES] == [None] * len(SCORES) and result["scans"] == 10


def test_only_annotated_counts_no_false_positives(bag: Path, tmp_path: Path) -> None:
    result = replayed(bag, tmp_path, "--only-annotated")
    assert result["false_positives"] == 0 and result["precision"] is None and result["only_annotated"]


def test_what_was_taken_is_said_and_the_table_printed(bag: Path, capsys: pytest.CaptureFixture) -> None:
    assert replay_bag.main([str(bag)]) == 0
    out, err = capsys.readouterr()
    assert "MOTA" in out and "times real time" in out
    assert "scan /scan: 541 beams in laser" in err and "ground truth /ground_truth" in err


@pytest.mark.parametrize("preset", ["default", "poschmann_t1", "volkhardt"])
def test_repetition_writes_the_same_bytes(bag: Path, tmp_path: Path, preset: str) -> None:
    for name in ("a.bag", "b.bag"):
        assert replay_bag.main([str(bag), "--config", preset, "--out", str(tmp_path / name)]) == 0
    assert (tmp_path / "a.bag").read_bytes() == (tmp_path / "b.bag").read_bytes()


def test_another_process_writes_the_same_bytes(bag: Path, tmp_path: Path) -> None:
    assert replay_bag.main([str(bag), "--out", str(tmp_path / "a.bag")]) == 0
    program = "import sys; from people_fusion.replay.replay_bag import main; sys.exit(main())"
    subprocess.run([sys.executable, "-c", program, str(bag), "--out", str(tmp_path / "b.bag")], check=True)
    assert (tmp_path / "a.bag").read_bytes() == (tmp_path / "b.bag").read_bytes()


def test_recorded_tracks_score_as_the_replay_that_wrote_them(bag: Path, tmp_path: Path) -> None:
    direct = replayed(bag, tmp_path, "--out", str(tmp_path / "tracks.bag"))
    json_path = tmp_path / "again.json"
    arguments = [str(tmp_path / "tracks.bag"), "--truth", str(bag), "--json", str(json_path)]
    assert evaluate_tracks.main([*arguments, "--report", str(tmp_path / "live")]) == 0
    assert "MOTA" in (tmp_path / "live" / "report.html").read_text()
    again = json.loads(json_path.read_text())
    for key in ("mota", "motp_m", "miss_rate", "ground_truth_count"):
        assert again[key] == pytest.approx(direct[key], abs=1e-3)


def test_report_is_written(bag: Path, tmp_path: Path) -> None:
    assert replay_bag.main([str(bag), "--report", str(tmp_path / "report")]) == 0
    assert "MOTA" in (tmp_path / "report" / "report.html").read_text()


def test_report_without_annotations_shows_the_tracks(tmp_path: Path) -> None:
    bag = walk(tmp_path / "a.bag", 3.0, truth=False)
    result = replayed(bag, tmp_path, "--report", str(tmp_path / "report"))
    html = (tmp_path / "report" / "report.html").read_text()
    assert "Nothing is annotated" in html and "MOTA" not in html
    assert html.count("<img") == 2 and "longest identity" in html
    assert f">{result['scans_processed']}</td>" in html


def test_settings_reach_the_preset() -> None:
    assert replay_bag.overrides(["buffer/type=drop", "transforms/patience_s=0.1", "frames/odom=''"]) == {
        "buffer": {"type": "drop"},
        "transforms": {"patience_s": 0.1},
        "frames": {"odom": ""},
    }
    with pytest.raises(ConfigError, match="key/path=value"):
        replay_bag.overrides(["buffer"])


@pytest.mark.parametrize(
    "arguments, complaint",
    [
        (["--scan", "/lidar"], "no topic /lidar"),
        (["--ground-truth", "/labels"], "no topic /labels"),
        (["--ground-truth", "/scan"], "no people in the messages of /scan"),
        (["--world-frame", "mars"], "no frame mars"),
        (["--config", "nonsense"], "nonsense"),
        (["--set", "tracker/nonsense=1"], "tracker/nonsense: unknown parameter"),
        (["--set", "transforms/patience_s=-1"], "transforms/patience_s"),
        (["--start", "-1"], "nothing starts at -1 s; the recording goes from 0 to 5.0 s"),
        (["--start", "nan"], "nothing starts at nan s; the recording goes from 0 to 5.0 s"),
        (["--start", "100"], "nothing starts at 100 s; the recording goes from 0 to 5.0 s"),
        (["--duration", "0"], "nothing lasts 0 s; the recording goes from 0 to 5.0 s"),
        (["--duration", "-3"], "nothing lasts -3 s; the recording goes from 0 to 5.0 s"),
        (["--threshold", "0"], "--threshold: 0.0 is not positive"),
        (["--out", "/nowhere/out.bag"], "/nowhere/out.bag"),
        (["--json", "/nowhere/out.json"], "/nowhere/out.json"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    bag: Path, capsys: pytest.CaptureFixture, arguments: List[str], complaint: str
) -> None:
    assert replay_bag.main([str(bag), *arguments]) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("replay_bag: ")]
    assert complaint in line


def test_a_damaged_bag_ends_in_one_line_and_leaves_no_half_output(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    content = bytearray(bag.read_bytes())
    rng = np.random.default_rng(1)
    ended = 0
    for trial in range(12):
        damaged = bytearray(content)
        for place in rng.integers(5000, len(content), 30):
            damaged[place] ^= 0x55
        path = tmp_path / f"{trial}.bag"
        path.write_bytes(damaged)
        status = replay_bag.main([str(path), "--out", str(tmp_path / "out.bag")])
        assert status in (0, 1)
        if status == 1:
            ended += 1
            assert f"{trial}.bag" in capsys.readouterr().err.splitlines()[-1]
            assert not (tmp_path / "out.bag").exists()
        else:
            (tmp_path / "out.bag").unlink()
    assert ended > 3


def test_evaluate_tracks_names_what_is_missing(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert evaluate_tracks.main([str(bag)]) == 1
    assert "no topic /people_fusion/tracks" in capsys.readouterr().err
    assert replay_bag.main([str(bag), "--out", str(tmp_path / "tracks.bag")]) == 0
    capsys.readouterr()
    assert evaluate_tracks.main([str(tmp_path / "tracks.bag")]) == 1
    assert "no ground truth in this recording" in capsys.readouterr().err
    assert evaluate_tracks.main([str(tmp_path / "tracks.bag"), "--threshold", "-1"]) == 1
    assert "--threshold: -1.0 is not positive" in capsys.readouterr().err


def test_recorded_tracks_find_the_transforms_of_a_bag_that_was_written_in_a_hurry(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "walk.bag") as bag:
        for step in range(400):
            seconds, hurry = step * 0.1, -step * 0.0999
            bag.link(seconds, "odom", "base_link", (0.5 * seconds, 0.0, 0.0), latency_s=hurry)
            bag.link(seconds, "base_link", "laser", LASER_AT, latency_s=hurry)
            bag.scan(seconds, latency_s=hurry)
            bag.person_array(seconds, latency_s=hurry)
    assert replay_bag.main([str(tmp_path / "walk.bag"), "--out", str(tmp_path / "tracks.bag")]) == 0
    arguments = [str(tmp_path / "tracks.bag"), "--truth", str(tmp_path / "walk.bag")]
    assert evaluate_tracks.main([*arguments, "--json", str(tmp_path / "out.json")]) == 0
    assert json.loads((tmp_path / "out.json").read_text())["frames"] > 350
