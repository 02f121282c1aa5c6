import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
from scenes import random_scene, scene

from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose
from people_fusion.evaluation import plots
from people_fusion.evaluation.evaluate import evaluate
from people_fusion.evaluation.truth import Estimates

HERE = {1: (0.0, 0.0)}
SCENES = {
    "no frames": [],
    "nobody": [({}, {})],
    "no tracks": [(HERE, {}), (HERE, {})],
    "no truth": [({}, {11: (0, 0)})] * 3,
    "one frame": [(HERE, {11: (0.1, 0)})],
}


def all_plots(truth, estimates, grid=None):
    result = evaluate(truth, estimates)
    return [
        plots.plot_tracks(truth, estimates, result, grid),
        plots.plot_identities(truth, estimates, result),
        plots.plot_errors(truth, estimates, result),
        plots.plot_existence(truth, estimates, result),
        plots.plot_counts(truth, result),
        plots.plot_nees(truth, result),
    ]


def points_of(figure, marker):
    """All points that are drawn with a marker."""
    lines = [line for line in figure.axes[0].lines if line.get_marker() == marker]
    return np.concatenate([np.zeros((0, 2)), *(line.get_xydata() for line in lines)])


@pytest.mark.parametrize("frames", SCENES.values(), ids=SCENES.keys())
@pytest.mark.filterwarnings("error")
def test_every_picture_can_be_drawn_of_little(frames):
    for figure in all_plots(*scene(frames)):
        assert plots.png(figure).startswith(b"\x89PNG")


def test_same_run_gives_same_bytes():
    truth, estimates = random_scene(np.random.default_rng(1), 20, 3)
    covariances = np.tile(0.04 * np.eye(2), (len(estimates.ids), 1, 1))
    existence = np.full(len(estimates.ids), 0.7)
    estimates = Estimates(estimates.frames, estimates.ids, estimates.means, covariances, existence)
    first = [plots.png(figure) for figure in all_plots(truth, estimates)]
    assert first == [plots.png(figure) for figure in all_plots(truth, estimates)]


def test_errors_are_marked_where_they_happened():
    frames = [
        ({1: (1.0, 2.0)}, {11: (1.1, 2.0)}),
        ({1: (3.0, 2.0)}, {77: (9.0, 9.0)}),
        ({1: (4.0, 2.0)}, {12: (4.2, 2.0)}),
    ]
    tracks, identities, errors, _, counts, _ = all_plots(*scene(frames))
    assert points_of(tracks, "x").tolist() == [[3.0, 2.0]]
    assert points_of(tracks, "D").tolist() == [[4.0, 2.0]]
    assert points_of(tracks, "+").tolist() == [[9.0, 9.0]]
    assert points_of(errors, "x")[:, 0].tolist() == [1.0]
    assert [points_of(figure, "D")[:, 0].tolist() for figure in (identities, errors, counts)] == [[2.0]] * 3


def test_bars_of_identities_end_where_the_track_changes():
    frames = [(HERE, {11: (0, 0)})] * 3 + [(HERE, {})] * 2 + [(HERE, {12: (0, 0)})] * 4
    figure = all_plots(*scene(frames))[1]
    bars = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in figure.axes[0].patches]
    assert bars == [(0.0, 3.0), (3.0, 5.0), (5.0, 9.0)]
    assert len({bar.get_facecolor() for bar in figure.axes[0].patches}) == 3


def test_path_is_not_drawn_across_frames_in_which_the_person_was_away():
    frames = [({1: (0.0, 0.0)}, {}), ({}, {}), ({1: (5.0, 0.0)}, {}), ({1: (6.0, 0.0)}, {})]
    path = all_plots(*scene(frames))[0].axes[0].lines[0].get_xydata()
    np.testing.assert_array_equal(path, [[0, 0], [np.nan, np.nan], [5, 0], [6, 0]])


def spaced(seconds, frames):
    """A scene whose frames are at these seconds."""
    truth, estimates = scene(frames)
    return dataclasses.replace(truth, stamps_ns=(np.asarray(seconds) * 1e9).astype(np.int64)), estimates


def test_nothing_is_drawn_across_seconds_without_annotations():
    frames = [({1: (k, 0.0)}, {11: (k, 0.0)}) for k in range(6)]
    truth, estimates = spaced([0.0, 0.1, 0.2, 9.0, 9.1, 9.2], frames)
    covariances, existence = np.tile(np.eye(2), (6, 1, 1)), np.ones(6)
    estimates = Estimates(estimates.frames, estimates.ids, estimates.means, covariances, existence)
    tracks, identities, errors, existences, counts, nees = all_plots(truth, estimates)
    bars = [(bar.get_x(), bar.get_x() + bar.get_width()) for bar in identities.axes[0].patches]
    np.testing.assert_allclose(bars, [(0.0, 0.3), (9.0, 9.3)])
    for figure in (tracks, errors, existences, counts, nees):
        line = max(figure.axes[0].lines, key=lambda line: len(line.get_xdata()))
        assert np.isnan(line.get_xydata()[:, 1].astype(float)).sum() >= 1
    people = counts.axes[0].lines[0].get_xydata()
    np.testing.assert_allclose(people[3:5], [[0.3, 1.0], [np.nan, np.nan]])


def test_frames_that_are_somewhat_irregular_are_one_stretch():
    truth, estimates = spaced([0.0, 0.1, 0.35, 0.4, 0.5], [(HERE, {11: (0, 0)})] * 5)
    (bar,) = all_plots(truth, estimates)[1].axes[0].patches
    assert bar.get_width() == pytest.approx(0.6)


def test_map_lies_where_its_origin_says():
    occupancy = np.zeros((10, 20), dtype=np.int8)
    turned = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    grid = OccupancyGrid("map", 0.5, Pose(turned, np.array([3.0, -2.0, 0.0])), occupancy)
    axes = all_plots(*scene(SCENES["one frame"]), grid)[0].axes[0]
    map_from_cells = axes.images[0].get_transform() - axes.transData
    assert map_from_cells.transform((0, 0)) == pytest.approx((3.0, -2.0))
    assert map_from_cells.transform((20, 10)) == pytest.approx((3.0 - 5.0, -2.0 + 10.0))


def test_average_nees_shows_each_treatment_and_the_band():
    times = np.arange(50.0)
    figure = plots.plot_average_nees(times, {"white": times / 10 + 2, "none": times + 2}, 2, 100)
    assert [text.get_text() for text in figure.axes[0].get_legend().get_texts()][:2] == ["white", "none"]
    assert plots.png(figure).startswith(b"\x89PNG")


def test_pyplot_and_its_state_are_left_alone():
    program = "import sys, people_fusion.evaluation.report; sys.exit('matplotlib.pyplot' in sys.modules)"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    assert subprocess.run([sys.executable, "-c", program], env=environment).returncode == 0
