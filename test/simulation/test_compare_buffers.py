"""What each buffer policy costs on the museum with emulated camera cues: delays, losses, accuracy."""

import dataclasses
import json
import subprocess
import sys

import numpy as np
import pytest

from people_fusion.core.errors import ConfigError
from people_fusion.replay.compare_buffers import POLICIES, PREVIEW, ZERO_DELAY, compare, main, policy_table
from people_fusion.replay.replay import Selection
from people_fusion.simulation import buffer_timing
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import simulate
from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.fusion import load_config

LASERS = {"scan_front": 0.007, "scan_rear": 0.007}  # table 7.5
ORDERED = ("fixed_lag", "dynamic", "announced, thesis", "announced", "revisable")


def recording(folder, **changes):
    path = folder / "cues.bag"
    write_bag(path, simulate(dataclasses.replace(load_scenario("museum_cues"), **changes), 1))
    return path


@pytest.fixture(scope="module")
def short(tmp_path_factory):
    return recording(tmp_path_factory.mktemp("short"), duration_s=20.0)


@pytest.fixture(scope="module")
def rows(short):
    return compare(short, load_config(), Selection(), LASERS)


def delay(row, quantile=None):
    return row.delays_s.mean() if quantile is None else np.quantile(row.delays_s, quantile)


def check(rows):
    """What must hold of any museum with cues."""
    mota = {name: row.recorded.scores.clear_mot.mota for name, row in rows.items()}
    assert delay(rows["announced"]) <= 0.75 * delay(rows["dynamic"])
    assert delay(rows["announced"]) <= 0.75 * delay(rows["announced, thesis"])
    assert delay(rows["announced"], 0.95) <= 0.150
    assert delay(rows["reprocess"]) < delay(rows["announced"])
    assert delay(rows["reprocess"]) <= 0.060
    for name in ORDERED:
        assert rows[name].discarded == 0.0 and mota[name] == pytest.approx(mota[ZERO_DELAY], abs=0.01)
    assert rows["drop"].discarded > 0.15 and mota["drop"] < mota[ZERO_DELAY] - 0.02


def test_every_policy_is_compared(rows):
    assert {mapping["type"] for mapping in POLICIES.values()} == set(BUFFERS.names())
    assert list(rows) == [*POLICIES, PREVIEW]


def test_the_announced_buffer_waits_least_and_only_drop_loses(rows):
    check(rows)


def test_what_comes_out_in_order_is_the_sorted_run_to_the_last_digit(rows):
    expected = rows[ZERO_DELAY].recorded.to_dict()
    for name in ("fixed_lag", "dynamic", "announced, thesis", "announced", "revisable"):
        assert rows[name].recorded.to_dict() == pytest.approx(expected, abs=1e-9, nan_ok=True), name


def test_a_preview_is_as_fresh_as_reprocessing(rows):
    assert delay(rows[PREVIEW]) == pytest.approx(delay(rows["reprocess"]), abs=0.002)
    assert delay(rows[PREVIEW]) < delay(rows["revisable"])


def test_delays_hold_what_sensors_and_cues_need(rows):
    for row in rows.values():
        if row is not rows[ZERO_DELAY]:
            assert row.delays_s.min() >= 0.030 + 0.007  # a sweep and the work on it
            assert (row.delays_s >= row.since_arrival_s).all()
    assert rows["reprocess"].used_after_s.mean() > delay(rows["reprocess"])


def test_processing_time_of_scans_is_seen_in_the_output(short):
    window = Selection(duration_s=8.0)
    only = ["reprocess"]
    fast, slow = (
        compare(short, load_config(), window, {"scan_front": seconds}, policies=only) for seconds in (0.0, 0.02)
    )
    grown = delay(slow["reprocess"]) - delay(fast["reprocess"])
    assert 0.004 < grown <= 0.021


def test_who_will_have_the_motion_of_the_sweep_itself_waits_for_odometry(short, rows):
    exact = {"leg_cue": {"deskew_lag_s": 0.0}}
    (row,) = compare(short, load_config(None, exact), Selection(), LASERS, policies=["reprocess"]).values()
    assert delay(row) > delay(rows["reprocess"]) + 0.010


def test_without_ground_truth_delays_are_told_all_the_same(tmp_path, capsys):
    path = tmp_path / "unscored.bag"
    scenario = dataclasses.replace(load_scenario("museum_cues"), duration_s=4.0)
    write_bag(path, (event for event in simulate(scenario, 1) if event[0] != "/ground_truth"))
    assert main([str(path), "--policies", "announced", "--plot", str(tmp_path / "a.png")]) == 0
    assert "announced" in capsys.readouterr().out


def test_the_command_prints_and_writes_all_rows(short, tmp_path, capsys):
    arguments = [str(short), "--duration", "6", "--json", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png")]
    assert main([*arguments, "--processing", "scan_front=0.007", "/scan_rear=0.007"]) == 0
    table = capsys.readouterr().out
    written = json.loads((tmp_path / "a.json").read_text())
    assert list(written) == [*POLICIES, PREVIEW]
    assert all(name in table for name in written)
    assert written["announced"]["delay_p95_s"] >= written["announced"]["delay_mean_s"]
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("setting", ["scan_front", "scan_front=soon", "scan_front=-1", "scan_front=inf", "camera=0.1"])
def test_a_processing_time_that_is_none_or_of_nobody_is_refused(short, setting, capsys):
    assert main([str(short), "--processing", setting]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith("compare_buffers: ")


def test_a_processing_time_names_the_cues_that_there_are(short):
    with pytest.raises(ConfigError, match="scan_front, scan_rear"):
        compare(short, load_config(), Selection(), {"camera": 0.1})


@pytest.mark.parametrize("policy", buffer_timing.SHOWN)
def test_the_timing_picture_shows_messages_that_are_released_after_they_were_delivered(policy):
    shown = buffer_timing.lives(policy)
    lives = [life for messages in shown.values() for life in messages]
    assert len(shown) == 5 and len(lives) >= 12 + 5 + 2 * 4 + 9
    assert all(list(life) == sorted(life) for life in lives)
    if policy == "reprocess":
        assert all(life.released_s == life.delivered_s for life in lives)


def test_the_timing_picture_is_written(tmp_path):
    path = tmp_path / "timing.png"
    subprocess.run([sys.executable, "-m", buffer_timing.__name__, str(path)], check=True, timeout=60)
    assert path.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_the_whole_museum(tmp_path, capsys):
    path = recording(tmp_path)
    rows = compare(path, load_config(), Selection(), LASERS)
    with capsys.disabled():
        print("\n" + policy_table(rows).as_text())
    check(rows)
