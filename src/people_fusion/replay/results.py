"""Scores as a table on the screen and as JSON, and the one way in which the commands of this room fail."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any, Callable, Dict, Mapping, Optional

from rich.console import Console

from people_fusion.core.errors import ConfigError, PeopleFusionError, RecordingError
from people_fusion.evaluation.evaluate import Evaluation, Scores
from people_fusion.evaluation.report import write_report
from people_fusion.evaluation.tables import count_table, score_table


def figures(evaluation: Optional[Evaluation]) -> Dict[str, Any]:
    """All scores by name; every one is None where nothing is annotated."""
    if evaluation is None:
        return dict.fromkeys(Scores().to_dict())
    return evaluation.to_dict()


def print_scores(
    name: str, evaluation: Optional[Evaluation], image: Optional[str] = None, in_image: Optional[Evaluation] = None
) -> None:
    """The CLEAR-MOT table, with a row for what was scored in an image; or a line that says why there is none."""
    if evaluation is None:
        print("nothing is annotated, nothing is scored")
        return
    rows = {name: evaluation.scores}
    if in_image is not None:
        rows[f"  in {image}"] = in_image.scores
    print(score_table(rows).as_text())
    print()
    print(count_table(evaluation.scores).as_text())


def settings(config: Any) -> Dict[str, Any]:
    """A config dataclass as the mapping that YAML would hold, parts with their `type`."""
    mapping: Dict[str, Any] = {}
    for field in dataclasses.fields(config):
        value = getattr(config, field.name)
        registry = field.metadata.get("registry")
        if registry is None:
            mapping[field.name] = _setting(value)
        elif field.metadata.get("many"):
            mapping[field.name] = {key: {"type": registry.name_of(one), **settings(one)} for key, one in value.items()}
        else:
            mapping[field.name] = {"type": registry.name_of(value), **settings(value)}
    return mapping


def _setting(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _setting(one) for key, one in value.items()}
    return settings(value) if dataclasses.is_dataclass(value) else value


def image_figures(image: Optional[str], evaluation: Optional[Evaluation]) -> Dict[str, Any]:
    """What JSON says of an image: nothing, if none was asked for."""
    return {} if image is None else {"image": {"topic": image, **figures(evaluation)}}


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


def save_report(directory: Path, html: str) -> None:
    """Write a report into a directory and print where it is.

    Raises:
        RecordingError: the file cannot be written.
    """
    try:
        write_report(directory / "report.html", html)
    except OSError as error:
        raise RecordingError(f"{directory}: {error.strerror}") from error
    print(directory / "report.html")


def positive(name: str, value: float) -> float:
    """An option's value.

    Raises:
        ConfigError: it is not a positive number; the message names the option.
    """
    if not 0.0 < value < math.inf:
        raise ConfigError(f"{name}: {value} is not positive")
    return value


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
