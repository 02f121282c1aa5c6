"""The localisation's slow error: which treatment publishes an honest covariance."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Dict, List

import numpy as np
import pytest

from people_fusion.evaluation.evaluate import evaluate
from people_fusion.evaluation.truth import Estimates, Truth
from people_fusion.simulation.compare_localisation import by_second, main, picture
from people_fusion.simulation.trials import Run

TREATMENTS = ["output", "white", "consider", "none"]


def compared(folder: Path, *arguments: str) -> Dict[str, Any]:
    path = folder / "table.json"
    assert main(["--jobs", "1", "--json", str(path), *arguments]) == 0
    return dict(json.loads(path.read_text()))


def run_of(stamps_s: List[float], errors: List[List[float]]) -> Run:
    """People far apart, whose tracks are off by the given distances along x, with unit covariance over 100."""
    stamps = [int(1e9 * stamp) for stamp in stamps_s]
    ids = [np.arange(len(entry)) for entry in errors]
    positions = [np.column_stack([5.0 * numbers, 0.0 * numbers]) for numbers in ids]
    means = [place + np.column_stack([entry, 0.0 * place[:, 1]]) for place, entry in zip(positions, errors)]
    truth = Truth.from_frames(stamps, ids, positions)
    estimates = Estimates.from_frames(ids, means, [np.tile(np.eye(2) / 100, (len(n), 1, 1)) for n in ids])
    return Run(truth, evaluate(truth, estimates))


@pytest.fixture(scope="module")
def badly_localised(tmp_path_factory: pytest.TempPathFactory) -> Dict[str, Any]:
    folder = tmp_path_factory.mktemp("localisation")
    error = ["--position-std", "0.15", "--yaw-std", "0.03"]
    files = ["--picture", str(folder / "nees.png"), "--report", str(folder)]
    table = compared(folder, "--scenario", "follow", "--seeds", "2", "--duration", "10", *error, *files)
    assert (folder / "nees.png").read_bytes().startswith(b"\x89PNG")
    assert "consider" in (folder / "report.html").read_text()
    return table


def test_error_added_on_output_or_considered_is_honest(badly_localised: Dict[str, Any]) -> None:
    assert list(badly_localised) == TREATMENTS
    for name in ("output", "consider"):
        assert 1.0 <= badly_localised[name]["nees"] <= 4.0


def test_error_taken_for_noise_is_averaged_away(badly_localised: Dict[str, Any]) -> None:
    nees = {name: entry["nees"] for name, entry in badly_localised.items()}
    assert nees["white"] > 1.3 * nees["output"]
    assert nees["none"] > 3.0 * nees["output"]


def test_without_error_there_is_nothing_to_treat(tmp_path: Path) -> None:
    arguments = ["--scenario", "hallway", "--seeds", "1", "--duration", "6", "--position-std", "0", "--yaw-std", "0"]
    table = compared(tmp_path, *arguments)
    assert table["white"] == table["none"] == table["consider"]
    assert table["output"]["nees"] == pytest.approx(table["none"]["nees"], rel=0.01)


def test_nees_is_averaged_over_people_of_a_second_and_then_over_runs() -> None:
    first = run_of([0.0, 0.5, 1.0, 2.0], [[0.1], [0.3], [0.2], []])
    second = run_of([0.0, 1.0, 4.0], [[0.2], [0.4, 0.4, 0.4], [0.1]])
    assert by_second(first) == pytest.approx({0: 5.0, 1: 4.0})
    (line,) = (e for e in picture([{"output": first}, {"output": second}]).axes[0].lines if e.get_label() == "output")
    np.testing.assert_allclose(line.get_xdata(), [0, 1, 2, 3, 4])
    np.testing.assert_allclose(line.get_ydata(), [4.5, 10.0, np.nan, np.nan, 1.0])


def test_picture_of_nobody_is_empty() -> None:
    assert picture([{"output": run_of([0.0], [[]])}]).axes


@pytest.mark.slow
def test_museum_is_honest_and_clearly_worse_without_pose_covariance(tmp_path: Path) -> None:
    table = compared(tmp_path, "--scenario", "museum", "--seeds", "2")
    assert 1.0 <= table["output"]["nees"] <= 4.0
    assert table["none"]["nees"] > 1.15 * table["output"]["nees"]


@pytest.mark.parametrize(
    "arguments, complaint",
    [
        (["--scenario", "desert"], "no scenario 'desert'"),
        (["--position-std", "-1"], "amcl/position_std"),
        (["--preset", "nonsense"], "nonsense"),
        (["--scenario", "hallway", "--seeds", "1", "--duration", "2", "--picture", "/nowhere/a.png"], "/nowhere/a.png"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    capsys: pytest.CaptureFixture, arguments: List[str], complaint: str
) -> None:
    assert main(arguments) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("compare_localisation: ") and complaint in line
