"""Pictures of experiments: bars with deviations beside published figures, and accuracy against what it costs."""

from __future__ import annotations

from typing import NamedTuple, Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

_OURS = "#1f77b4"
_PUBLISHED = "#d62728"


class Panel(NamedTuple):
    """One figure of all rows.

    Attributes:
        title: with its unit.
        means, deviations: (R,) ours; NaN where there is none.
        published: (R,) NaN where there is none.
    """

    title: str
    means: np.ndarray
    deviations: np.ndarray
    published: np.ndarray


def plot_rows(names: Sequence[str], panels: Sequence[Panel]) -> Figure:
    """A bar for each row with its standard deviation, and a mark where the published figure is; a panel a figure."""
    figure = Figure(figsize=(13.0, 1.0 + 0.36 * max(3, len(names))), constrained_layout=True)
    FigureCanvasAgg(figure)
    places = np.arange(len(names))
    for column, (axes, panel) in enumerate(zip(figure.subplots(1, len(panels), sharey=True), panels)):
        axes.barh(places, panel.means, height=0.62, color=_OURS, alpha=0.75, zorder=2)
        known = np.isfinite(panel.deviations)
        axes.errorbar(
            panel.means[known], places[known], xerr=panel.deviations[known], fmt="none", ecolor="black", capsize=2.5
        )
        axes.plot(panel.published, places, "D", color=_PUBLISHED, markersize=5, zorder=4)
        axes.set_title(panel.title, fontsize=10)
        axes.set_yticks(places)
        if column == 0:
            axes.set_yticklabels(names, fontsize=9)
        axes.set_ylim(len(names) - 0.4, -0.6)
        for side in ("top", "right", "left"):
            axes.spines[side].set_visible(False)
        axes.tick_params(axis="y", length=0)
        axes.tick_params(axis="x", labelsize=8)
        axes.grid(axis="x", linewidth=0.4, color="#d8d8d8", zorder=0)
    handles = [
        Patch(facecolor=_OURS, alpha=0.75, label="ours, mean and standard deviation"),
        Line2D([], [], color=_PUBLISHED, marker="D", linestyle="none", markersize=5, label="thesis"),
    ]
    figure.legend(handles=handles, loc="upper left", ncol=2, frameon=False, fontsize=8, bbox_to_anchor=(0.0, 1.04))
    return figure


def plot_cost(names: Sequence[str], shares: np.ndarray, mota: np.ndarray, deviations: np.ndarray) -> Figure:
    """MOTA against the share of one core that cues and tracker need.

    Args:
        names: of the N configurations.
        shares: (N,) of one core.
        mota, deviations: (N,) fractions of 1.
    """
    figure = Figure(figsize=(11.0, 5.2), constrained_layout=True)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    bars = 100.0 * np.nan_to_num(deviations)
    axes.errorbar(100.0 * shares, 100.0 * mota, yerr=bars, fmt="o", color=_OURS, ecolor="#8c8c8c", capsize=2.5)
    for name, share, height in zip(names, 100.0 * shares, 100.0 * mota):
        axes.annotate(name, (share, height), xytext=(6, 4), textcoords="offset points", fontsize=8)
    axes.set_xscale("log")
    axes.set_xlabel("CPU of cues and tracker [% of one core]")
    axes.set_ylabel("MOTA [%]")
    axes.margins(x=0.12, y=0.12)
    axes.grid(linewidth=0.4, color="#d8d8d8", zorder=0, which="both")
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure
