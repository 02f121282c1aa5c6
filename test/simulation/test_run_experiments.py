"""Experiments: every run is done once, whatever interrupts them; tables set ours beside the thesis's figures."""

from __future__ import annotations

import fcntl
import itertools
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List

import pytest
import yaml

from people_fusion.core.config import parse
from people_fusion.core.errors import PeopleFusionError, RecordingError
from people_fusion.simulation import experiment_runs
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.experiment_runs import COST, Run, code_version, replay_timed, runs_of
from people_fusion.simulation.experiment_tables import spread, table_of
from people_fusion.simulation.experiments import ExperimentsConfig, TableConfig, load_experiments
from people_fusion.simulation.run_experiments import main
from people_fusion.simulation.simulator import simulate
from people_fusion.simulation.trials import trials

SCRIPT = Path(__file__).parents[2] / "scripts" / "run_experiments"
TINY = ["--scenario", "museum", "--duration", "5", "--seeds", "2", "--only", "7.1"]
ROWS, SEEDS = ("T1-L1", "T2-L1", "T2-L2"), 2


def tiny(folder: Path, *arguments: str) -> int:
    return main([*TINY, "--out", str(folder), *arguments])


def kept(folder: Path) -> Dict[str, Dict[str, Any]]:
    return {path.name: json.loads(path.read_text()) for path in (folder / "runs").glob("*.json")}


def figures(folder: Path) -> Dict[str, Dict[str, Any]]:
    """Of all runs, but for what depends on the computer."""
    return {
        name: {figure: value for figure, value in run["figures"].items() if figure not in COST}
        for name, run in kept(folder).items()
    }


@pytest.fixture(scope="module", autouse=True)
def _same_code() -> Iterator[None]:
    """Whoever edits while the tests run makes no results old."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiment_runs, "code_version", ",".join)
        yield


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("done")
    assert tiny(folder) == 0
    return folder


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording with images."""
    path = tmp_path_factory.mktemp("seen") / "seen.bag"
    (trial,) = trials(["museum_cameras"], 1, 2.0)
    write_bag(path, simulate(trial.scenario, trial.seed))
    return path


def test_one_run_for_each_configuration_and_seed_is_kept(done: Path) -> None:
    runs = kept(done)
    assert len(runs) == len(ROWS) * SEEDS
    assert {(run["configuration"], run["seed"]) for run in runs.values()} == {
        (row, seed) for row in ROWS for seed in (1, 2)
    }
    for name, run in runs.items():
        assert name == f"{run['configuration']}_museum_{run['seed']}_{run['key']}.json"
        assert run["settings"]["tracker"]["type"] == ("kalman" if run["configuration"] == "T1-L1" else "particle")
    assert len(list((done / "recordings").iterdir())) == SEEDS
    assert not list(done.rglob("*.unfinished"))


def test_tables_tell_mean_and_deviation_beside_the_thesis(done: Path) -> None:
    lines = (done / "tables.md").read_text().splitlines()
    assert "## Table 7.1: Laser scan cues" in lines
    (row,) = [line for line in lines if line.startswith("| T2-L2 ")]
    runs = [run["figures"]["mota"] for run in kept(done).values() if run["configuration"] == "T2-L2"]
    half = abs(runs[0] - runs[1]) / 2.0**0.5  # the standard deviation of a sample of two
    assert f"{50.0 * sum(runs):.1f} ± {100.0 * half:.1f} % | 47.0 %" in row


def test_report_holds_all_tables_and_pictures_and_loads_nothing(done: Path) -> None:
    html = (done / "report.html").read_text()
    assert html.count('src="data:image/png;base64,') == 2  # the table's, and MOTA against CPU
    assert not re.search(r"https?://|<script|<link", html)
    assert "48.6 %" in html and "tracker/models/legs/starts" in html


def test_what_is_done_is_not_done_again(done: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Run, "carry_out", lambda _: pytest.fail("a run was done again"))
    monkeypatch.setattr(Run, "render", lambda _: pytest.fail("a recording was made again"))
    assert tiny(done) == 0


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"key": "another"}', '{"figures": 3}', "\x00\xff"])
def test_a_damaged_result_is_computed_anew(done: Path, damage: str, capsys: pytest.CaptureFixture) -> None:
    before = figures(done)
    victim = sorted((done / "runs").glob("*.json"))[0]
    others = {path: path.stat().st_mtime_ns for path in (done / "runs").glob("*.json") if path != victim}
    victim.write_text(damage)
    assert tiny(done) == 0
    assert figures(done) == before
    assert {path: path.stat().st_mtime_ns for path in others} == others
    assert f"{victim} is damaged" in capsys.readouterr().err


@pytest.mark.parametrize("change", [{"key": "of other settings"}, {"figures": {"mota": 1.0}}])
def test_a_result_of_something_else_or_in_part_is_computed_anew(done: Path, change: Dict[str, Any]) -> None:
    before = figures(done)
    victim = sorted((done / "runs").glob("*.json"))[0]
    victim.write_text(json.dumps({**json.loads(victim.read_text()), **change}))
    assert tiny(done) == 0
    assert figures(done) == before
    assert json.loads(victim.read_text())["key"] in victim.name


def test_an_interrupted_command_goes_on_where_it_was(
    done: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    carry_out, calls = Run.carry_out, []

    def interrupted(run: Run) -> Dict[str, Any]:
        calls.append(run.path.name)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return carry_out(run)

    monkeypatch.setattr(Run, "carry_out", interrupted)
    assert tiny(tmp_path) == 130
    assert sorted(kept(tmp_path)) == sorted(calls[:2])
    assert "interrupted" in capsys.readouterr().err
    assert tiny(tmp_path) == 0
    assert len(calls) == len(ROWS) * SEEDS + 1  # the interrupted one twice
    assert figures(tmp_path) == figures(done)


@pytest.mark.parametrize("jobs", ["1", "2"])
@pytest.mark.parametrize("name", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_all_processes_and_what_is_done_is_kept(
    name: signal.Signals, jobs: str, tmp_path: Path
) -> None:
    command = [sys.executable, str(SCRIPT), *TINY, "--duration", "40", "--jobs", jobs, "--out", str(tmp_path)]
    started = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    deadline_s = time.monotonic() + 60.0
    while not list((tmp_path / "runs").glob("*.json")) and time.monotonic() < deadline_s:
        time.sleep(0.05)
    started.send_signal(name)
    _, errors = started.communicate(timeout=20.0)
    assert started.returncode == 130 and "Traceback" not in errors
    assert 0 < len(kept(tmp_path)) < len(ROWS) * SEEDS
    assert not subprocess.run(["pgrep", "-f", str(tmp_path)], stdout=subprocess.PIPE, check=False).stdout


def test_number_of_processes_changes_no_figure(done: Path, tmp_path: Path) -> None:
    assert tiny(tmp_path, "--jobs", "2") == 0
    assert figures(tmp_path) == figures(done)


def test_a_run_that_fails_leaves_the_others_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    carry_out = Run.carry_out

    def failing(run: Run) -> Dict[str, Any]:
        if run.name == "T2-L1":
            raise RecordingError("no room")
        return carry_out(run)

    monkeypatch.setattr(Run, "carry_out", failing)
    assert tiny(tmp_path) == 1
    assert len(kept(tmp_path)) == 4
    output = capsys.readouterr()
    assert "2 runs failed: T2-L1, seed 1: no room" in output.err
    assert "T2-L2" in output.out


def test_tables_only_runs_nothing(done: Path, capsys: pytest.CaptureFixture) -> None:
    before = kept(done)
    assert tiny(done, "--tables-only", "--seeds", "3") == 0
    assert kept(done) == before
    told = "3 of 9 runs are not there, or were made by other settings or code."
    assert told in capsys.readouterr().err and told in (done / "tables.md").read_text()


def test_tables_of_nothing_are_not_written(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "tables.md").write_text("of old code")
    assert tiny(tmp_path, "--tables-only") == 1
    assert (tmp_path / "tables.md").read_text() == "of old code"
    assert "none of 6 runs is there" in capsys.readouterr().err


def test_two_commands_do_not_work_in_one_folder(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    with (tmp_path / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_SH)
        assert tiny(tmp_path) == 1
    assert "another run_experiments is at work there" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments, complaint",
    [
        (["--scenario", "desert"], "no scenario 'desert'"),
        (["--seeds", "0"], "--seeds: 0 is not positive"),
        (["--first-seed", "-1"], "--first-seed: -1 is negative"),
        (["--duration", "-1"], "--duration: -1.0 is not positive"),
        (["--jobs", "0"], "--jobs: 0 is not positive"),
        (["--only", "9.1"], "--only 9.1: names no row; tables are 7.1"),
        (["--only", "7.1/T3*"], "--only 7.1/T3*: names no row"),
        (["--out", "/proc/nowhere"], "/proc/nowhere"),
        (["--out", __file__], __file__),
        (["--experiments", "/nowhere.yaml"], "/nowhere.yaml"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture, arguments: List[str], complaint: str
) -> None:
    assert tiny(tmp_path, *arguments) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("run_experiments: ") and complaint in line


ONE: Dict[str, Any] = {
    "configurations": {"A": {"preset": "poschmann_t1"}},
    "tables": {"1": {"columns": "accuracy", "rows": [{"configuration": "A", "thesis": {"mota": 50}}]}},
}


@pytest.mark.parametrize(
    "path, value, complaint",
    [
        (["figures"], {}, "figures: unknown parameter"),
        (["configurations", "A", "set"], [], "configurations/A/set: unknown parameter"),
        (["configurations", "A", "preset"], "nonsense", "configurations/A: "),
        (["configurations", "A", "overrides"], ["tracker/mass=3"], "tracker/mass: unknown parameter"),
        (["configurations", "A", "overrides"], ["tracker"], "expected key/path=value"),
        (["configurations", "A", "processing"], {"face": 0.1}, "processing/face: there is no such cue"),
        (["configurations", "A", "processing"], {"legs": -0.1}, "is not within"),
        (["tables", "1", "columns"], "beauty", "tables/1/columns: 'beauty' is not one of"),
        (["tables", "1", "rows"], [{"configuration": "B"}], "there is no configuration 'B'"),
        (["tables", "1", "rows"], [{"configuration": "A", "thesis": {"delay": 3}}], "thesis/delay: no such column"),
        (["tables", "1", "rows"], [{"configuration": "A", "thesis": {"mota": "half"}}], "expected float"),
    ],
)
def test_what_the_file_does_not_know_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture, path: List[str], value: Any, complaint: str
) -> None:
    content = json.loads(json.dumps(ONE))
    part = content
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(content))
    assert main(["--experiments", str(file), "--out", str(tmp_path / "out")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert complaint in line
    assert not (tmp_path / "out").exists()


def test_the_thesis_tables_are_whole() -> None:
    experiments = load_experiments()
    assert [len(table.rows) for table in experiments.tables.values()] == [3, 6, 8, 10, 12]
    best = experiments.tables["7.4"].rows[6]
    assert best.configuration == "T2-L2-H2A-P"
    assert best.thesis == {"motp": 98, "mota": 81.7, "misses": 14.7, "false_positives": 1.9, "mismatches": 1.8}
    for number in ("7.1", "7.2", "7.3", "7.4"):
        for row in experiments.tables[number].rows:
            if not row.thesis:
                continue  # our own
            errors = sum(row.thesis[name] for name in ("misses", "false_positives", "mismatches"))
            misprint = row.configuration in ("T2-H2A-P", "T2-H2A-P 0.00")  # 59.5 stands there, and in the row below it
            mota = 60.3 if misprint else row.thesis["mota"]
            assert mota == pytest.approx(100.0 - errors, abs=0.21), row  # rounded figures


def test_configurations_have_the_components_they_are_named_for() -> None:
    for name, entry in load_experiments().configurations.items():
        config = entry.build()
        parts = re.split(r"[ ,]", name)[0].split("-")
        if parts[0] not in ("T1", "T2"):
            continue  # our own presets
        tracker: Any = config.tracker
        heeds = set(config.modalities) or {"legs"}
        assert type(tracker).__name__ == {"T1": "KalmanConfig", "T2": "ParticleConfig"}[parts[0]]
        assert ("legs" in heeds) == ("L1" in parts or "L2" in parts), name
        assert ("face" in heeds, "upper_body" in heeds) == ("F" in parts, "U" in parts), name
        assert ("head" in heeds) == bool({"H1", "H2", "H2A"} & set(parts)), name
        if parts[0] == "T2":
            models = {key: type(model).__name__ for key, model in tracker.models.items()}
            assert (tracker.proximity.distance_max > 0.0) == ("P" in parts), name
            if "legs" in heeds:
                assert models["legs"] == ("LegModelConfig" if "L2" in parts else "GaussianModelConfig"), name
                assert tracker.models["legs"].starts == (heeds == {"legs"}), name
            if "head" in heeds:
                assert models["head"] == ("GaussianModelConfig" if "H1" in parts else "HeadScoreModelConfig"), name
                assert getattr(tracker.models["head"], "adaptive", None) == (
                    None if "H1" in parts else "H2A" in parts
                ), name


@pytest.mark.parametrize(
    "patterns, rows",
    [
        ([], 39),
        (["7.3"], 8),
        (["7.4/T1-*"], 3),
        (["*/T2-L2-H2A-P"], 2),
        (["7.1", "7.4/T2-L2-H2A-P"], 4),
    ],
)
def test_rows_are_chosen_by_pattern(patterns: List[str], rows: int) -> None:
    chosen = load_experiments().select(patterns)
    assert sum(len(table.rows) for table in chosen.tables.values()) == rows
    assert set(chosen.configurations) == {row.configuration for table in chosen.tables.values() for row in table.rows}


def test_configurations_that_are_equal_share_a_run(tmp_path: Path) -> None:
    content = json.loads(json.dumps(ONE))
    content["configurations"]["B"] = {"preset": "poschmann_t1", "overrides": ["tracker/gate=11.345"]}
    content["configurations"]["C"] = {"preset": "poschmann_t1", "overrides": ["tracker/gate=9.0"]}
    content["configurations"]["D"] = {"preset": "poschmann_t1", "processing": {"legs": 0.02}}
    experiments = parse(ExperimentsConfig, content)
    configs = {name: entry.build() for name, entry in experiments.configurations.items()}
    times = {name: entry.processing for name, entry in experiments.configurations.items()}
    runs = runs_of(tmp_path, configs, times, trials(["museum"], 2, 5.0))
    assert runs["A"] == runs["B"]
    assert len({run.key for of_one in runs.values() for run in of_one}) == 6
    assert len({run.recording for of_one in runs.values() for run in of_one}) == 2


def test_code_that_computes_makes_results_old_and_code_that_shows_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("core/a.py", "evaluation/report.py", "ros/node.py"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text("x = 1\n")
    monkeypatch.setattr(experiment_runs, "SOURCE", tmp_path)
    rooms = ("core", "evaluation")
    before = code_version(rooms)
    for name in ("evaluation/report.py", "ros/node.py"):
        (tmp_path / name).write_text("x = 2\n")
        assert code_version(rooms) == before
    (tmp_path / "core" / "a.py").write_text("x = 2\n")
    assert code_version(rooms) != before


def test_cues_whose_modality_is_not_named_do_not_run(seen: Path) -> None:
    configurations = load_experiments().configurations
    camera, _ = replay_timed(seen, configurations["T2-H2-P"].build(), {"head": 0.077})
    assert camera["laser_s"] is None and camera["image_s"] > 0.0
    assert camera["rate_hz"] == pytest.approx(9.0, abs=1.0)
    laser, _ = replay_timed(seen, configurations["T2-L2"].build(), {"legs": 0.006})
    assert laser["image_s"] is None and laser["laser_s"] > 0.0
    assert laser["rate_hz"] == pytest.approx(17.0, abs=1.5)


def test_delay_is_how_long_cues_work_and_buffers_wait(seen: Path) -> None:
    config = load_experiments().configurations["T1-L1"].build()
    delays = [replay_timed(seen, config, {"legs": seconds})[0]["delay_s"] for seconds in (0.0, 0.007)]
    assert delays == [pytest.approx(0.0, abs=1e-3), pytest.approx(0.007, abs=1e-3)]


def test_cost_is_that_of_the_slowest_cue_and_of_all_together(seen: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(experiment_runs.time, "process_time", itertools.count().__next__)  # each work takes a second
    config = load_experiments().configurations["T1-L1-F-U"].build()
    figures, events = replay_timed(seen, config, {})
    assert [figures[name] for name in ("laser_s", "image_s", "tracker_s")] == [1.0, 1.0, 1.0]
    measured = events["scans processed"] + events["images processed"]
    assert figures["cpu_share"] * 2.0 == pytest.approx(2 * measured, rel=0.1)  # each measured, each processed


def test_a_recording_without_annotation_is_refused(tmp_path: Path) -> None:
    (trial,) = trials(["museum"], 1, 2.0)
    path = tmp_path / "nobody.bag"
    write_bag(path, (event for event in simulate(trial.scenario, 1) if "ground_truth" not in str(event)))
    with pytest.raises(PeopleFusionError, match=r"nobody\.bag: nothing is annotated"):
        replay_timed(path, load_experiments().configurations["T1-L1"].build(), {})


def test_figures_of_a_single_run_have_no_deviation() -> None:
    table = parse(TableConfig, {"columns": "speed", "rows": [{"configuration": "A", "thesis": {"delay": 60}}]})
    times = {"laser_s": 0.002, "image_s": None, "tracker_s": 1e-4, "rate_hz": 17.0, "delay_s": 0.05}
    results = {"A": [{**times, "cpu_share": 0.02, "mota": 0.5}]}
    (row,) = table_of(table, results).rows
    assert row == ("A", "1", "2.0 ms", "–", "0.1 ms", "17.0 Hz", "50 ms", "60 ms", "2.0 %", "50.0 %")
    assert spread(results, "A", "rate_hz")[0] == 17.0


def test_rows_without_runs_are_told_as_such() -> None:
    table = parse(TableConfig, {"rows": [{"configuration": "A", "thesis": {"mota": 60}}]})
    (row,) = table_of(table, {}).rows
    assert row[:2] == ("A", "0") and row[3:5] == ("–", "60.0 %")


def test_progress_tells_what_is_left(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert tiny(tmp_path, "--seeds", "1") == 0
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == len(ROWS)
    assert re.fullmatch(r"3/3  T2-L2, seed 1: \d+ s, MOTA [\d.-]+ %; about 0 s left", lines[-1])


def test_seeds_that_nothing_was_chosen_on_can_be_taken() -> None:
    assert [trial.seed for trial in trials(["museum"], 2, 5.0, 11)] == [11, 12]
