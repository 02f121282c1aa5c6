"""Scores as a table on the screen and as JSON, and the one way in which the commands of this room fail."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any, Callable, Dict, Mapping, Optional

from rich.console import Console
from rich.table import Table

from people_fusion.core.errors import PeopleFusionError, RecordingError
from people_fusion.evaluation.evaluate import Evaluation, Scores

PERCENT = ("mota", "miss_rate", "false_positive_rate", "mismatch_rate", "recall", "precision", "idf1", "hota")
COUNTS = ("identity_switches", "ground_truth_count", "frames")


def figures(evaluation: Optional[Evaluation]) -> Dict[str, Any]:
    """All scores by name; every one is None where nothing is annotated."""
    if evaluation is None:
        return dict.fromkeys(Scores().to_dict())
    return evaluation.to_dict()


def print_scores(scores: Mapping[str, Any], console: Console) -> None:
    """The CLEAR-MOT table, or a line that says why there is none."""
    if scores["ground_truth_count"] is None:
        console.print("No ground truth: nothing is scored.")
        return
    table = Table(show_edge=False)
    values = []
    for name in PERCENT:
        table.add_column(name.replace("_rate", "").replace("_", " "), justify="right")
        values.append("–" if scores[name] is None else f"{100.0 * scores[name]:.1f} %")
    table.add_column("motp", justify="right")
    values.append("–" if scores["motp_m"] is None else f"{1000.0 * scores['motp_m']:.0f} mm")
    table.add_column("nees", justify="right")
    values.append("–" if scores["nees"] is None else f"{scores['nees']:.2f}")
    for name in COUNTS:
        table.add_column(name.replace("_", " "), justify="right")
        values.append(str(scores[name]))
    table.add_row(*values)
    console.print(table)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Content as JSON; numbers that are not finite become null.

    Raises:
        RecordingError: the file cannot be written.
    """
    text = json.dumps({key: _finite(value) for key, value in content.items()}, indent=2, allow_nan=False)
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


def guarded(name: str, work: Callable[[], None], errors: Console) -> int:
    """Exit status of a command: 1 and one line where it fails on what it was given."""
    try:
        work()
    except PeopleFusionError as error:
        errors.print(f"{name}: {error}", markup=False, highlight=False, soft_wrap=True)
        return 1
    return 0
