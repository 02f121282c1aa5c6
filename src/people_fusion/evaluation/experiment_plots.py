"""Pictures of experiments: bars with deviations beside published figures, and accuracy against what it costs."""

from __future__ import annotations

from typing import NamedTuple, Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import FuncFormatter

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
    height = 0.36 * max(3, len(names))
    figure = Figure(figsize=(13.0, 1.1 + height), constrained_layout=True)
    FigureCanvasAgg(figure)
    places = np.arange(len(names))
    grid = figure.add_gridspec(2, len(panels), height_ratios=(0.3, height))
    for column, panel in enumerate(panels):
        axes = figure.add_subplot(grid[1, column])
        axes.barh(places, panel.means, height=0.62, color=_OURS, alpha=0.75, zorder=2)
        known = np.isfinite(panel.deviations)
        axes.errorbar(
            panel.means[known], places[known], xerr=panel.deviations[known], fmt="none", ecolor="black", capsize=2.5
        )
        axes.plot(panel.published, places, "D", color=_PUBLISHED, markersize=5, zorder=4)
        axes.set_title(panel.title, fontsize=10)
        axes.set_yticks(places)
        axes.set_yticklabels(names if column == 0 else [], fontsize=9)
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
    above = figure.add_subplot(grid[0, :])
    above.axis("off")
    above.legend(handles=handles, loc="center left", ncol=2, frameon=False, fontsize=9)
    return figure


def plot_cost(names: Sequence[str], shares: np.ndarray, mota: np.ndarray, deviations: np.ndarray) -> Figure:
    """MOTA against the share of one core that cues and tracker need; names stand in a column beside it.

    Args:
        names: of the N configurations.
        shares: (N,) of one core.
        mota, deviations: (N,) fractions of 1.
    """
    figure = Figure(figsize=(11.0, 1.2 + 0.22 * max(20, len(names))), constrained_layout=True)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    heights, bars = 100.0 * mota, 100.0 * np.nan_to_num(deviations)
    axes.errorbar(100.0 * shares, heights, yerr=bars, fmt="o", color=_OURS, ecolor="#8c8c8c", capsize=2.5, zorder=3)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(FuncFormatter(lambda share, _: f"{share:g}"))
    axes.set_xlabel("CPU of cues and tracker [% of one core]")
    axes.set_ylabel("MOTA [%]")
    axes.margins(y=0.05)
    low, high = axes.get_ylim()
    places = _apart((heights - low) / (high - low), 1.0 / max(20, len(names)))
    for name, share, height, place in zip(names, 100.0 * shares, heights, places):
        axes.annotate(
            name, (share, height), xytext=(1.03, place), textcoords="axes fraction", fontsize=8, va="center",
            arrowprops={"arrowstyle": "-", "color": "#b0b0b0", "linewidth": 0.6, "shrinkB": 3.0},
        )  # fmt: skip
    axes.set_ylim(low, high)
    axes.grid(linewidth=0.4, color="#d8d8d8", zorder=0)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure


def _apart(places: np.ndarray, least: float) -> np.ndarray:
    """Places between 0 and 1 moved up as little as keeps them apart, and down again where they leave the picture."""
    order = np.argsort(places, kind="stable")
    steps = least * np.arange(len(places))
    moved = np.maximum.accumulate(places[order] - steps) + steps
    moved = np.minimum.accumulate((np.minimum(moved, 1.0 - steps[::-1]) - steps)[::-1])[::-1] + steps
    apart = np.empty(len(places))
    apart[order] = moved
    return apart
