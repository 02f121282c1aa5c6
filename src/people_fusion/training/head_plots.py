"""Pictures of how well heads are found."""

from __future__ import annotations

from pathlib import Path
from typing import Mapping

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from people_fusion.core.errors import RecordingError
from people_fusion.evaluation.detection import DetCurve, log_average_miss_rate


def plot_det(curves: Mapping[str, DetCurve], title: str, path: Path) -> None:
    """Miss rate over false positives per image, both logarithmic, by name; with the log-average miss rate of each.

    Raises:
        RecordingError: the picture cannot be written.
    """
    figure = Figure(figsize=(7.5, 5.5), dpi=110)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name, curve in sorted(curves.items(), key=lambda entry: log_average_miss_rate(entry[1])):
        label = f"{log_average_miss_rate(curve):.0%}  {name}"
        axes.step(curve.false_positives.clip(1e-3), curve.miss_rates, where="post", label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(3e-3, 10.0)
    axes.set_ylim(0.05, 1.05)
    ticks = [0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0]
    axes.set_yticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_yticks([], minor=True)
    axes.set_xlabel("false positives per image")
    axes.set_ylabel("miss rate")
    axes.set_title(title, fontsize=10)
    axes.grid(True, which="both", alpha=0.3)
    axes.legend(loc="lower left", fontsize=8)
    figure.tight_layout()
    try:
        figure.savefig(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
