"""The command `compare_localisation`: what becomes of the covariance when the localisation's slow error is treated as
what it is, as noise, or not at all. One tracker, the same recordings, four treatments; see docs/localisation_error.md.
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Dict, List, Mapping, Optional, Sequence

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError, RecordingError
from people_fusion.core.stamps import NANOSECONDS
from people_fusion.evaluation.evaluate import Scores
from people_fusion.evaluation.plots import plot_average_nees, png
from people_fusion.evaluation.report import report
from people_fusion.evaluation.tables import Table, millimetres, number, percent
from people_fusion.replay.results import guarded, write_json
from people_fusion.simulation.compare_presets import publish
from people_fusion.simulation.localisation import AmclConfig
from people_fusion.simulation.scenario import ScenarioConfig
from people_fusion.simulation.trials import Run, replay_all, summed, trials
from people_fusion.tracking.fusion import TREATMENTS, load_config

DIMENSION = 2  # of positions in the plane


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/compare_localisation; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("compare_localisation", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Simulate, replay, print and write what was asked for.

    Raises:
        PeopleFusionError: a scenario, preset, number or file is not usable.
    """
    presets = {name: load_config(options.preset, {"localisation": name}) for name in TREATMENTS}
    given = {
        "position_std": options.position_std,
        "yaw_std": options.yaw_std,
        "correlation_time_s": options.correlation_time,
    }
    entries = [
        dataclasses.replace(trial, scenario=with_amcl(trial.scenario, given))
        for trial in trials([options.scenario], options.seeds, options.duration)
    ]
    runs = list(replay_all(entries, presets, options.jobs, notes).items())
    scores = {treatment: entry for (_, treatment), entry in summed(dict(runs)).items()}
    print(treatment_table(scores).as_text())
    if options.json is not None:
        write_json(options.json, {name: entry.to_dict() for name, entry in scores.items()})
    if options.picture is None and options.report is None:
        return
    figure = picture([of_presets for _, of_presets in runs])
    if options.picture is not None:
        try:
            options.picture.write_bytes(png(figure))
        except OSError as error:
            raise RecordingError(f"{options.picture}: {error.strerror}") from error
    if options.report is not None:
        amcl = entries[0].scenario.amcl
        title = f"Treatments of the localisation's error, {options.scenario}"
        notes_of_report = [
            f"{options.seeds} seeds, preset {options.preset}, localisation off by {amcl.position_std:g} m and "
            f"{amcl.yaw_std:g} rad for {amcl.correlation_time_s:g} s"
        ]
        caption = "Of matched people in the plane; above the band the published covariance is too small."
        publish(options.report, report(title, scores, [("NEES", caption, figure)], notes=notes_of_report))


def with_amcl(scenario: ScenarioConfig, given: Mapping[str, Optional[float]]) -> ScenarioConfig:
    """The scenario with those parameters of its localisation that are not None.

    Raises:
        ConfigError: one is out of range.
    """
    chosen = {name: value for name, value in given.items() if value is not None}
    try:
        amcl = parse(AmclConfig, {**dataclasses.asdict(scenario.amcl), **chosen})
    except ConfigError as error:
        raise ConfigError(f"amcl/{error}") from error
    return dataclasses.replace(scenario, amcl=amcl)


def treatment_table(scores: Mapping[str, Scores]) -> Table:
    """One row for each treatment."""
    header = ("localisation", "NEES (2 is honest)", "in 95 % band", "MOTP", "MOTA")
    rows = tuple(
        (
            name,
            number(entry.position_consistency.average),
            percent(entry.position_consistency.inside_share),
            millimetres(entry.clear_mot.motp_m),
            percent(entry.clear_mot.mota),
        )
        for name, entry in scores.items()
    )
    return Table(header, rows)


def picture(runs: Sequence[Mapping[str, Run]]) -> Figure:
    """NEES over time for each treatment, averaged over the matched people of a second and then over the runs."""
    series = {name: [by_second(treatments[name]) for treatments in runs] for name in runs[0]}
    known = {second for of_runs in series.values() for run in of_runs for second in run}
    seconds = np.arange(min(known), max(known) + 1) if known else np.zeros(0, dtype=np.int64)
    averages = {}
    for name, of_runs in series.items():
        values = np.array([[run.get(second, np.nan) for second in seconds.tolist()] for run in of_runs])
        counts = np.isfinite(values).sum(axis=0)
        averages[name] = np.divide(
            np.nansum(values, axis=0), counts, out=np.full(len(seconds), np.nan), where=counts > 0
        )
    return plot_average_nees(seconds - seconds[:1], averages, DIMENSION, len(runs))


def by_second(run: Run) -> Dict[int, float]:
    """Mean NEES of the people who were matched in each second, by the second of the stamps."""
    events, nees = run.evaluation.events, run.evaluation.nees
    known = np.isfinite(nees)
    stamps_ns = run.truth.stamps_ns[events.frames[known]]
    seconds, groups = np.unique(stamps_ns // NANOSECONDS, return_inverse=True)
    means = np.bincount(groups, nees[known]) / np.bincount(groups)
    return dict(zip(seconds.tolist(), means.tolist()))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="compare_localisation", description=__doc__)
    add = parser.add_argument
    add("--scenario", default="museum", metavar="NAME", help="name or YAML file (default %(default)s)")
    add("--preset", default="default", metavar="NAME", help="name or YAML file of the tracker (default %(default)s)")
    add("--seeds", type=int, default=5, metavar="N", help="recordings (default %(default)s)")
    add("--duration", type=float, metavar="S", help="seconds, instead of the scenario's")
    add("--position-std", type=float, metavar="M", help="error of the localisation, instead of the scenario's")
    add("--yaw-std", type=float, metavar="RAD", help="the same of its direction")
    add("--correlation-time", type=float, metavar="S", help="how long it stays as it is")
    add("--jobs", type=int, metavar="N", help="processes at work (default: one for each processor)")
    add("--picture", type=Path, metavar="PNG", help="write NEES over time")
    add("--json", type=Path, metavar="FILE", help="write the table")
    add("--report", type=Path, metavar="DIR", help="write an HTML report")
    return parser
