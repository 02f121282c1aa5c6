"""Presets are compared on the same recordings, and counts are added over the seeds."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, List, Tuple

import pytest
from rich.console import Console

from people_fusion.core.errors import PeopleFusionError
from people_fusion.evaluation.evaluate import Scores
from people_fusion.simulation.compare_presets import PUBLISHED_NAME, comparison_table, main
from people_fusion.simulation.trials import Run, replay_all, summed, trials
from people_fusion.tracking.fusion import load_config

SHORT = ["--scenarios", "hallway", "--duration", "6"]


@pytest.fixture(scope="module")
def runs() -> Dict[Tuple[str, int], Dict[str, Run]]:
    presets = {name: load_config(name) for name in ("poschmann_t1", "default")}
    return replay_all(trials(["hallway"], 2, 6.0), presets, 1, Console(stderr=True))


def compared(tmp_path: Path, *arguments: str) -> Dict[str, Any]:
    path = tmp_path / "table.json"
    assert main([*SHORT, "--json", str(path), *arguments]) == 0
    return dict(json.loads(path.read_text()))


def test_counts_of_seeds_are_added(runs: Dict[Tuple[str, int], Dict[str, Run]]) -> None:
    total = summed(runs)["hallway", "default"].clear_mot
    single = [runs["hallway", seed]["default"].evaluation.scores.clear_mot for seed in (1, 2)]
    assert single[0] != single[1]
    for name in ("frames", "ground_truth_count", "matches", "misses", "false_positives", "mismatches"):
        assert getattr(total, name) == sum(getattr(entry, name) for entry in single)
    assert total.ground_truth_count > 0


def test_presets_are_compared_on_the_same_people(runs: Dict[Tuple[str, int], Dict[str, Run]]) -> None:
    for of_presets in runs.values():
        first, second = (run.truth for run in of_presets.values())
        assert first.positions.tobytes() == second.positions.tobytes()


def test_command_prints_and_writes_what_the_library_computes(
    runs: Dict[Tuple[str, int], Dict[str, Run]], tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    arguments = ["--presets", "poschmann_t1", "default", "--seeds", "2", "--jobs", "1"]
    table = compared(tmp_path, *arguments, "--report", str(tmp_path / "report"))
    scores = summed(runs)
    assert table["hallway"]["default"] == scores["hallway", "default"].to_dict()
    assert list(table["hallway"]) == ["poschmann_t1", "default"]
    assert comparison_table(scores).as_text() in capsys.readouterr().out
    assert "hallway poschmann_t1" in (tmp_path / "report" / "report.html").read_text()


def test_number_of_processes_changes_nothing(tmp_path: Path) -> None:
    arguments = ["--presets", "default", "--seeds", "3"]
    assert compared(tmp_path, *arguments, "--jobs", "1") == compared(tmp_path, *arguments, "--jobs", "3")


def test_an_error_in_a_process_ends_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise PeopleFusionError("no room")

    monkeypatch.setattr("people_fusion.simulation.trials.simulate", fail)
    with pytest.raises(PeopleFusionError, match="no room"):
        replay_all(trials(["hallway"], 2, 1.0), {"default": load_config()}, 2, Console(stderr=True))


def test_published_figures_stand_beside_those_that_are_to_meet_them() -> None:
    pairs = [("museum", "volkhardt"), ("museum", "poschmann_t1"), ("hallway", "poschmann_t1")]
    names = [row[0] for row in comparison_table(dict.fromkeys(pairs, Scores())).rows]
    assert names == ["museum volkhardt", "museum poschmann_t1", PUBLISHED_NAME, "hallway poschmann_t1"]


@pytest.mark.parametrize(
    "arguments, complaint",
    [
        (["--scenarios", "desert"], "no scenario 'desert'"),
        (["--presets", "nonsense"], "nonsense"),
        (["--seeds", "0"], "--seeds: 0 is not positive"),
        (["--duration", "-1"], "--duration: -1.0 is not positive"),
        (["--jobs", "0"], "--jobs: 0 is not positive"),
        (["--seeds", "1", "--presets", "default", "--json", "/nowhere/table.json"], "/nowhere/table.json"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    capsys: pytest.CaptureFixture, arguments: List[str], complaint: str
) -> None:
    assert main([*SHORT, "--duration", "2", *arguments]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("compare_presets: ") and complaint in line
