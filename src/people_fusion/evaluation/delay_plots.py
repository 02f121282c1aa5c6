"""Pictures of how late tracks are, and what that is worth."""

from __future__ import annotations

from typing import Mapping

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

_COLOURS = (
    *("#d62728", "#e377c2", "#1f77b4", "#8c564b", "#7b3fb5"),
    *("#b8860b", "#2ca02c", "#17becf", "#4d4d4d", "#ff8c00"),
)
_MILLISECONDS = 1000.0


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
