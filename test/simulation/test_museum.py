"""The museum is calibrated to table 7.1 and frozen; what the default preset gains there, and how honest it is."""

import dataclasses
import os

import pytest
from rich.console import Console

from people_fusion.simulation.trials import replay_all, summed, trials
from people_fusion.tracking.fusion import load_config

pytestmark = pytest.mark.slow

TABLE_7_1 = {"mota": 0.486, "miss_rate": 0.325, "false_positive_rate": 0.177, "mismatch_rate": 0.013}


@pytest.fixture(scope="module")
def scores():
    default = load_config("default")
    presets = {
        "poschmann_t1": load_config("poschmann_t1"),
        "default": default,
        "none": dataclasses.replace(default, localisation="none"),
    }
    runs = replay_all(trials(["museum"], seeds=5), presets, os.cpu_count(), Console(stderr=True))
    return {preset: entry.to_dict() for (_, preset), entry in summed(runs).items()}


@pytest.mark.parametrize("figure", TABLE_7_1)
def test_faithful_tracker_is_within_5_points_of_the_thesis(scores, figure):
    assert scores["poschmann_t1"][figure] == pytest.approx(TABLE_7_1[figure], abs=0.05)


def test_default_is_at_least_10_points_of_mota_better(scores):
    assert scores["default"]["mota"] >= scores["poschmann_t1"]["mota"] + 0.10


def test_confirmed_tracks_are_consistent_with_localisation_error(scores):
    assert 1.0 <= scores["default"]["nees"] <= 4.0


def test_tracks_without_the_pose_covariance_are_less_consistent(scores):
    assert scores["none"]["nees"] > 1.1 * scores["default"]["nees"]
