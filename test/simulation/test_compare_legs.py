"""The experiments with legs."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Dict

import numpy as np
import pytest

from people_fusion.simulation.compare_legs import EXPERIMENTS, WAYS, main
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import Simulation


def test_table_report_and_figures_tell_of_every_way(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    arguments = ["--experiments", "arras_eight", "--seeds", "1", "--duration", "8"]
    assert main([*arguments, "--json", str(tmp_path / "t.json"), "--report", str(tmp_path / "report")]) == 0
    table = json.loads((tmp_path / "t.json").read_text())["arras_eight"]
    assert set(table) == set(WAYS)
    assert table["adaptive"]["people"] == 1 and table["adaptive"]["leg_tracks_made"] >= 2
    assert table["adaptive"]["cycle_p95_ms"] > 0
    printed = capsys.readouterr().out
    assert "arras_eight fixed, as approved" in printed
    assert "data:image/png" in (tmp_path / "report" / "report.html").read_text()


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_people_of_the_experiments_walk_to_the_end(name: str) -> None:
    history = Simulation(load_scenario(name), 1).history
    steps = np.linalg.norm(np.diff(history.heads[:, :, :2], axis=0), axis=2)
    for third in np.array_split(steps, 3):
        assert (third.sum(axis=0) > 5.0).all()


def test_one_who_spins_turns_about_while_walking() -> None:
    history = Simulation(load_scenario("arras_turning"), 1).history
    turned = history.headings[300, 0] - history.headings[100, 0]  # 4 s at 4 rad/s
    assert turned == pytest.approx(16.0, rel=0.1)
    assert np.linalg.norm(history.heads[300, 0, :2] - history.heads[100, 0, :2]) > 1.0


@pytest.mark.slow
def test_a_person_on_ten_figure_eights_is_one_person_on_two_legs(tmp_path: Path) -> None:
    adaptive = measured("arras_eight", tmp_path)["adaptive"]
    assert adaptive["person_tracks_made"] == 1 and adaptive["identity_switches"] == 0
    assert adaptive["leg_tracks_made"] == 2


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arras_turning", "arras_corridor", "arras_moving"])
def test_adaptive_occlusion_makes_fewer_tracks_and_switches_than_fixed(name: str, tmp_path: Path) -> None:
    table = measured(name, tmp_path)
    for fixed in (table["fixed"], table["fixed, as approved"]):
        for figure in ("leg_tracks_made", "person_tracks_made", "identity_switches"):
            assert table["adaptive"][figure] < fixed[figure]
        assert table["adaptive"]["mota"] > fixed["mota"]


def measured(name: str, folder: Path) -> Dict[str, Dict[str, float]]:
    assert main(["--experiments", name, "--seeds", "1", "--json", str(folder / "t.json")]) == 0
    table: Dict[str, Dict[str, float]] = json.loads((folder / "t.json").read_text())[name]
    return table
