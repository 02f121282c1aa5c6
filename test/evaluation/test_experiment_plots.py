"""Pictures and pages of experiments: what is unknown is left out, names do not overlap, nothing is loaded."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from people_fusion.evaluation.experiment_plots import Panel, _apart, plot_cost, plot_rows
from people_fusion.evaluation.plots import png
from people_fusion.evaluation.report import Part, paper_report
from people_fusion.evaluation.tables import Table

NAMES = ("A", "B", "C")
UNKNOWN = np.full(3, np.nan)


def panel(title: str = "MOTA [%]") -> Panel:
    means, deviations, published = [80.0, np.nan, -20.0], [2.0, np.nan, np.nan], [70.0, 60.0, np.nan]
    return Panel(title, np.array(means), np.array(deviations), np.array(published))


def test_a_bar_stands_for_each_known_mean_and_a_mark_for_each_published_figure() -> None:
    _, axes = plot_rows(NAMES, [panel()]).axes[::-1]
    assert [bar.get_width() for bar in axes.patches if np.isfinite(bar.get_width())] == [80.0, -20.0]
    marks = next(line for line in axes.lines if line.get_marker() == "D")
    np.testing.assert_array_equal(marks.get_xdata(), [70.0, 60.0, np.nan])
    assert [label.get_text() for label in axes.get_yticklabels()] == list(NAMES)


@pytest.mark.parametrize("panels", [[panel()], [panel(), panel("rate [Hz]")], [Panel("x", UNKNOWN, UNKNOWN, UNKNOWN)]])
def test_what_is_unknown_is_drawn_without_a_word(panels: list) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert png(plot_rows(NAMES, panels)).startswith(b"\x89PNG")
        shares = np.array([0.01, 0.2, 1.4])
        assert png(plot_cost(NAMES, shares, np.array([0.5, 0.5, 0.1]), UNKNOWN)).startswith(b"\x89PNG")


def test_nothing_to_show_is_no_error() -> None:
    assert png(plot_cost((), np.zeros(0), np.zeros(0), np.zeros(0))).startswith(b"\x89PNG")


@given(st.lists(st.floats(0.0, 1.0), max_size=20))
def test_names_keep_apart_in_their_order_and_stay_in_the_picture(places: list) -> None:
    least = 1.0 / 20.0
    moved = _apart(np.array(places), least)
    order = np.argsort(np.array(places), kind="stable")
    assert np.all(np.diff(moved[order]) >= least - 1e-9)
    assert np.all((moved > -1e-9) & (moved < 1.0 + 1e-9))


def test_names_that_do_not_overlap_stay_where_they_are() -> None:
    places = np.array([0.9, 0.1, 0.5])
    np.testing.assert_allclose(_apart(places, 0.05), places)


def test_page_holds_tables_and_pictures_in_their_order() -> None:
    table = Table(("", "MOTA"), (("<A>", "80.0 %"),))
    parts = [Part("One", "first", table, plot_rows(NAMES, [panel()])), Part("Two", "second", table)]
    html = paper_report("Title", parts)
    places = [html.index(word) for word in ("<h1>Title", "<h2>One", ">first<", "<table", "data:image/png", "<h2>Two")]
    assert places == sorted(places)
    assert html.count("<table") == 2 and html.count("<img") == 1
    assert "&lt;A&gt;" in html and "<A>" not in html and "http" not in html.replace("http-equiv", "")
