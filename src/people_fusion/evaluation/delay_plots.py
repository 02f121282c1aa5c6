"""Pictures of how late tracks are, and what that is worth."""

from __future__ import annotations

from typing import Any, Mapping, NamedTuple, Sequence

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

_COLOURS = (
    *("#d62728", "#e377c2", "#1f77b4", "#8c564b", "#7b3fb5"),
    *("#b8860b", "#2ca02c", "#17becf", "#4d4d4d", "#ff8c00"),
)
_MILLISECONDS = 1000.0


class Life(NamedTuple):
    """One message of a cue: when it was exposed, announced, worked on, delivered, released to the tracker; seconds."""

    exposed_s: float
    announced_s: float
    begun_s: float
    delivered_s: float
    released_s: float


def plot_policies(
    delays_s: Mapping[str, np.ndarray], recorded: Mapping[str, float], at_once: Mapping[str, float], zero_delay: float
) -> Figure:
    """Mean delay against MOTA on the left, how the delays spread on the right.

    Args:
        delays_s: (K,) of the outputs by policy.
        recorded, at_once: MOTA of them, fractions of 1; NaN where unknown.
        zero_delay: MOTA of the run without any delay.
    """
    figure = Figure(figsize=(11.0, 4.2), constrained_layout=True)
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, gridspec_kw={"width_ratios": (1.0, 1.15)})
    names = [name for name, values in delays_s.items() if len(values)]
    for name, colour in zip(names, _COLOURS * len(names)):
        mean = _MILLISECONDS * float(np.mean(delays_s[name]))
        for scores, filled in ((recorded, colour), (at_once, "white")):
            left.plot(mean, 100.0 * scores[name], "o", color=colour, markerfacecolor=filled, markersize=7, zorder=3)
        both = [100.0 * recorded[name], 100.0 * at_once[name]]
        left.plot([mean, mean], both, color=colour, linewidth=0.8)
    if np.isfinite(zero_delay):
        left.axhline(100.0 * zero_delay, color="#8c8c8c", linewidth=1.0, linestyle="--")
        left.annotate("zero delay", (1.0, 100.0 * zero_delay), xycoords=("axes fraction", "data"), ha="right",
                      va="bottom", fontsize=8, color="#6c6c6c")  # fmt: skip
    left.plot([], [], "o", color="#4d4d4d", label="each output counts for its stamp")
    left.plot([], [], "o", color="#4d4d4d", markerfacecolor="white", label="what is there at the instant")
    left.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncol=2, frameon=False, fontsize=8, borderaxespad=0.2)
    left.set_xlim(left=0.0)
    left.set_xlabel("mean age of the output [ms]")
    left.set_ylabel("MOTA [%]")
    boxes = right.boxplot(
        [_MILLISECONDS * delays_s[name] for name in reversed(names)],
        vert=False,
        whis=(5, 95),
        showfliers=False,
        showmeans=True,
        widths=0.6,
        patch_artist=True,
        meanprops={"marker": "o", "markersize": 4, "markerfacecolor": "white", "markeredgecolor": "black"},
        medianprops={"color": "black"},
    )
    colours = list(zip(names, _COLOURS * len(names)))
    for box, (_, colour) in zip(boxes["boxes"], reversed(colours)):
        box.set(facecolor=colour, alpha=0.6)
    right.set_yticks(range(1, len(names) + 1))
    right.set_yticklabels(reversed(names), fontsize=9)
    right.set_xlim(left=0.0)
    right.set_xlabel("age of the output [ms]: 5, 25, 50, 75, 95 %, mean")
    for axes in (left, right):
        axes.spines["top"].set_visible(False)
        axes.spines["right"].set_visible(False)
        axes.grid(axis="x", linewidth=0.4, color="#d8d8d8")
    return figure


def plot_timing(lives: Mapping[str, Mapping[str, Sequence[Life]]], start_s: float, end_s: float) -> Figure:
    """What becomes of each cue's messages in a stretch of time, a panel for each policy and a lane for each cue.

    Args:
        lives: by policy and cue.
        start_s, end_s: what is shown.
    """
    figure = Figure(figsize=(11.0, 0.5 + 2.1 * len(lives)), constrained_layout=True)
    FigureCanvasAgg(figure)
    panels = figure.subplots(len(lives), 1, sharex=True, squeeze=False)[:, 0]
    for axes, (policy, of_cues) in zip(panels, lives.items()):
        for lane, messages in enumerate(of_cues.values()):
            _draw_lane(axes, lane, messages, _COLOURS[2 * lane % len(_COLOURS)])
        known = [life for messages in of_cues.values() for life in messages if start_s <= life.released_s < end_s]
        mean = _MILLISECONDS * float(np.mean([life.released_s - life.exposed_s for life in known]))
        axes.set_title(f"{policy}: used {mean:.0f} ms after exposure on average", loc="left", fontsize=10)
        axes.set_yticks(range(len(of_cues)))
        axes.set_yticklabels(of_cues, fontsize=9)
        axes.set_ylim(len(of_cues) - 0.4, -0.6)
        axes.set_xlim(start_s, end_s)
        axes.spines["top"].set_visible(False)
        axes.spines["right"].set_visible(False)
    ticks = np.arange(start_s, end_s + 0.05, 0.1)
    panels[-1].set_xticks(ticks)
    panels[-1].set_xticklabels([f"{_MILLISECONDS * (tick - start_s):.0f}" for tick in ticks])
    panels[-1].set_xlabel("time [ms]")
    handles = [
        Line2D([], [], color="#4d4d4d", marker="|", linestyle="none", markersize=9, label="exposed"),
        Line2D([], [], color="#8c8c8c", linewidth=1.0, label="read out"),
        Line2D([], [], color="#4d4d4d", marker=">", linestyle="none", markersize=4, label="announced"),
        Patch(facecolor="#4d4d4d", alpha=0.75, label="cue works"),
        Patch(facecolor="#4d4d4d", alpha=0.2, label="held by the buffer"),
        Line2D([], [], color="black", marker="o", linestyle="none", markersize=4, label="released to the tracker"),
    ]
    panels[0].legend(
        handles=handles, loc="lower left", bbox_to_anchor=(0.0, 1.12), ncol=len(handles), frameon=False, fontsize=8
    )
    return figure


def _draw_lane(axes: Any, lane: int, messages: Sequence[Life], colour: str) -> None:
    """Messages overlap where one is held while the next are worked on: they are drawn on three levels by turns."""
    for turn, life in enumerate(messages):
        level = lane + 0.26 * (turn % 3 - 1)
        axes.plot(life.exposed_s, level, "|", color=colour, markersize=7, markeredgewidth=1.6)
        axes.plot([life.exposed_s, life.begun_s], [level, level], color="#8c8c8c", linewidth=1.0, zorder=1)
        axes.plot(life.announced_s, level, ">", color=colour, markersize=4)
        for begin, end, alpha in ((life.begun_s, life.delivered_s, 0.75), (life.delivered_s, life.released_s, 0.2)):
            axes.barh(level, end - begin, left=begin, height=0.22, color=colour, alpha=alpha, linewidth=0.0)
        axes.plot(life.released_s, level, "o", color="black", markersize=3.5, zorder=4)
