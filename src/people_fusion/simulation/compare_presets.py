"""The command `compare_presets`: all presets on all scenarios, several seeds each, in one table."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple

from rich.console import Console

from people_fusion.core.errors import RecordingError
from people_fusion.evaluation.evaluate import Scores
from people_fusion.evaluation.report import report, write_report
from people_fusion.evaluation.tables import UNDEFINED, Table, score_table
from people_fusion.replay.replay_bag import overrides
from people_fusion.replay.results import guarded, write_json
from people_fusion.simulation.trials import replay_all, summed, trials
from people_fusion.tracking.fusion import load_config

SCENARIOS = ("museum", "hallway", "follow", "sitting", "crowd")
PRESETS = ("poschmann_t1", "volkhardt", "default")
# Poschmann 2018, table 7.1: first tracker, laser alone, on his recordings in a museum.
PUBLISHED = ("museum", "poschmann_t1")
PUBLISHED_NAME = "  table 7.1, T1-L1"
PUBLISHED_CELLS = ("60 mm", "48.6 %", "32.5 %", "17.7 %", "1.3 %", UNDEFINED, UNDEFINED, UNDEFINED)


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/compare_presets; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("compare_presets", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Simulate, replay, print and write what was asked for.

    Raises:
        PeopleFusionError: a scenario, preset, number or file is not usable.
    """
    presets = {preset: load_config(preset, overrides(options.set)) for preset in options.presets}
    entries = trials(options.scenarios, options.seeds, options.duration, options.first_seed)
    scores = summed(replay_all(entries, presets, options.jobs, notes))
    table = comparison_table(scores)
    print(table.as_text())
    if options.json is not None:
        write_json(options.json, figures(scores))
    if options.report is not None:
        seconds = {trial.name: trial.scenario.duration_s for trial in entries}
        durations = ", ".join(f"{name} {duration_s:g} s" for name, duration_s in seconds.items())
        named = {f"{scenario} {preset}": entry for (scenario, preset), entry in scores.items()}
        html = report("Presets", named, (), notes=[f"{options.seeds} seeds of each scenario: {durations}"])
        publish(options.report, html)


def comparison_table(scores: Mapping[Tuple[str, str], Scores]) -> Table:
    """A row for each scenario and preset, and Poschmann's own figures beside those that are to meet them."""
    rows: List[Tuple[str, ...]] = []
    header = score_table({}).header
    for (scenario, preset), entry in scores.items():
        rows += score_table({f"{scenario} {preset}": entry}).rows
        if (scenario, preset) == PUBLISHED:
            rows.append((PUBLISHED_NAME, *PUBLISHED_CELLS))
    return Table(header, tuple(rows))


def figures(scores: Mapping[Tuple[str, str], Scores]) -> Dict[str, Dict[str, Any]]:
    """All scores by name, by preset, by scenario."""
    nested: Dict[str, Dict[str, Any]] = {}
    for (scenario, preset), entry in scores.items():
        nested.setdefault(scenario, {})[preset] = entry.to_dict()
    return nested


def publish(directory: Path, html: str) -> None:
    """Write report.html and print its path.

    Raises:
        RecordingError: it cannot be written.
    """
    try:
        write_report(directory / "report.html", html)
    except OSError as error:
        raise RecordingError(f"{directory}: {error.strerror}") from error
    print(directory / "report.html")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="compare_presets", description=__doc__)
    add = parser.add_argument
    add("--scenarios", nargs="+", default=list(SCENARIOS), metavar="NAME", help=f"default: {' '.join(SCENARIOS)}")
    add("--presets", nargs="+", default=list(PRESETS), metavar="NAME", help=f"or YAML; default: {' '.join(PRESETS)}")
    add("--set", action="append", default=[], metavar="KEY=VALUE", help="over every preset, e.g. buffer/type=drop")
    add("--seeds", type=int, default=5, metavar="N", help="recordings of each scenario (default %(default)s)")
    add("--first-seed", type=int, default=1, metavar="N", help="default %(default)s")
    add("--duration", type=float, metavar="S", help="seconds, instead of each scenario's")
    add("--jobs", type=int, metavar="N", help="processes at work (default: one for each processor)")
    add("--json", type=Path, metavar="FILE", help="write the table")
    add("--report", type=Path, metavar="DIR", help="write an HTML report")
    return parser
