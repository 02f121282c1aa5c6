"""Pictures of how well legs are told from what is none."""

from __future__ import annotations

from pathlib import Path
from typing import Mapping, Tuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from people_fusion.core.errors import RecordingError


def plot_roc(curves: Mapping[str, Tuple[np.ndarray, np.ndarray, float]], path: Path) -> None:
    """ROC curves: false positive rates, true positive rates and the area, by name; false positives logarithmic.

    Raises:
        RecordingError: the picture cannot be written.
    """
    figure = Figure(figsize=(7.0, 5.0), dpi=120)
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    for name, (false, true, area) in curves.items():
        axes.plot(np.maximum(false, 1e-4), true, label=f"{name} ({area:.3f})", marker="o" if len(false) == 3 else "")
    axes.set_xscale("log")
    axes.set_xlim(1e-4, 1.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_xlabel("false positive rate")
    axes.set_ylabel("true positive rate")
    axes.grid(True, which="both", alpha=0.3)
    axes.legend(loc="lower right", fontsize=8)
    figure.tight_layout()
    try:
        figure.savefig(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
