"""The command `replay_bag`: cues and tracker over a recording, without a master, with the CLEAR-MOT table."""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import Any, Dict, List, Optional

import yaml
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from people_fusion.core.config import merge
from people_fusion.core.errors import ConfigError
from people_fusion.evaluation.clear_mot import THRESHOLD_M
from people_fusion.evaluation.report import run_report, unscored_report
from people_fusion.replay.discovery import Sources
from people_fusion.replay.misses import Scenes, save_misses
from people_fusion.replay.replay import Outcome, Selection, replay
from people_fusion.replay.results import (
    figures,
    guarded,
    image_figures,
    positive,
    print_scores,
    save_report,
    settings,
    write_json,
)
from people_fusion.replay.sampling import Sightings
from people_fusion.replay.session import Session, Update
from people_fusion.tracking.fusion import load_config

ARRIVALS = ("scans", "scans processed")


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/replay_bag; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("replay_bag", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Replay, print and write what was asked for.

    Raises:
        PeopleFusionError: a file, topic, frame or parameter is not usable.
    """
    config = load_config(options.config, overrides(options.set))
    selection = Selection(
        scans=tuple(options.scan),
        world_frame=options.world_frame,
        ground_truth=options.ground_truth,
        odometry="" if options.odometry == "none" else options.odometry,
        start_s=options.start,
        duration_s=options.duration,
        only_annotated=options.only_annotated,
        threshold_m=positive("--threshold", options.threshold),
        image=options.image,
    )
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=notes, transient=True, disable=not notes.is_terminal) as bar:
        task = bar.add_task("replay", total=None)

        def found(sources: Sources) -> None:
            for line in sources.notes:
                notes.print(line, markup=False, highlight=False, soft_wrap=True)

        wall_s, cpu_s = time.perf_counter(), time.process_time()
        sightings = Sightings() if options.report is not None else None
        scenes = Scenes() if options.misses is not None else None

        def watch(session: Session, update: Update) -> None:
            for watcher in (sightings, scenes):
                if watcher is not None:
                    watcher.watch(session, update)

        outcome = replay(
            options.bag,
            config,
            selection,
            options.out,
            found,
            progress=lambda seconds: bar.update(task, completed=seconds),
            watch=watch,
            processing_s=processing_times(options.processing),
        )
        wall_s, cpu_s = time.perf_counter() - wall_s, time.process_time() - cpu_s
    result = {
        **figures(outcome.evaluation),
        **image_figures(options.image, outcome.in_image),
        "realtime_factor": outcome.recorded_s / wall_s,
        "cpu_ms_per_scan": 1000.0 * cpu_s / outcome.scans,
        "recorded_s": outcome.recorded_s,
        "scans": outcome.scans,
        "scans_processed": outcome.processed,
        "events": outcome.counters,
        "taken": list(outcome.sources.notes),
    }
    name = Path(options.config or "default").stem
    print_scores(name, outcome.evaluation, options.image, outcome.in_image)
    for line in _lines(outcome, result):
        print(line)
    if options.json is not None:
        write_json(options.json, result)
    if sightings is not None:
        title, said = f"{options.bag.stem}, {name}", [*outcome.sources.notes, _lines(outcome, result)[0]]
        save_report(options.report, _report(title, outcome, sightings, settings(config), said))
    if scenes is not None:
        for line in save_misses(options.misses, outcome, scenes):
            print(line)


def overrides(settings: List[str]) -> Dict[str, Any]:
    """Nested mapping of `key/path=value` settings, the values in YAML.

    Raises:
        ConfigError: a setting has no `=` or its value is not YAML.
    """
    mapping: Dict[str, Any] = {}
    for setting in settings:
        path, equals, text = setting.partition("=")
        if not equals or not path:
            raise ConfigError(f"--set {setting}: expected key/path=value")
        try:
            value = yaml.safe_load(text)
        except yaml.YAMLError as error:
            raise ConfigError(f"--set {setting}: the value is not YAML") from error
        for key in reversed(path.split("/")):
            value = {key: value}
        mapping = merge(mapping, value)
    return mapping


def add_processing(parser: argparse.ArgumentParser) -> None:
    """The option whose value `processing_times` reads."""
    parser.add_argument(
        "--processing",
        metavar="CUE=SECONDS",
        nargs="+",
        action="extend",
        default=[],
        help="how long a cue shall work on each scan, e.g. scan_front=0.007 (default: no time)",
    )


def processing_times(settings: List[str]) -> Dict[str, float]:
    """Seconds by cue of `CUE=SECONDS` settings.

    Raises:
        ConfigError: a setting is none, or its time is negative.
    """
    times = {}
    for setting in settings:
        cue, _, text = setting.partition("=")
        try:
            times[cue.strip("/")] = float(text)
        except ValueError as error:
            raise ConfigError(f"--processing {setting}: expected cue=seconds") from error
        if not 0.0 <= times[cue.strip("/")] < math.inf:
            raise ConfigError(f"--processing {setting}: not a time")
    return times


def _lines(outcome: Outcome, result: Dict[str, Any]) -> List[str]:
    events = sorted((name, count) for name, count in outcome.counters.items() if count and name not in ARRIVALS)
    return [
        f"{outcome.processed} of {outcome.scans} scans in {outcome.recorded_s:.1f} s of recording, "
        f"{result['realtime_factor']:.0f} times real time, {result['cpu_ms_per_scan']:.2f} ms CPU a scan",
        *(f"{name}: {count}" for name, count in events),
    ]


def _report(
    title: str, outcome: Outcome, sightings: Sightings, parameters: Dict[str, Any], notes: List[str]
) -> str:
    if outcome.truth is not None and outcome.estimates is not None and outcome.evaluation is not None:
        scored = (outcome.truth, outcome.estimates, outcome.evaluation)
        return run_report(title, *scored, outcome.grid, parameters, outcome.counters, notes)
    frames, estimates, hits = sightings.result()
    return unscored_report(title, frames, estimates, hits, outcome.grid, parameters, outcome.counters, notes)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="replay_bag", description=__doc__)
    add = parser.add_argument
    add("bag", type=Path, help="ROS 1 bag")
    add("--config", metavar="FILE", help="preset by its name, or a YAML file (default: default)")
    add("--set", metavar="KEY=VALUE", action="append", default=[], help="over the preset, e.g. buffer/type=drop")
    add("--scan", metavar="TOPIC", nargs="+", action="extend", default=[], help="default: one of each scanner")
    add("--world-frame", metavar="FRAME", help="frame of the tracks (default: map, else odom, else the scanner's)")
    add("--ground-truth", metavar="TOPIC", help="annotated people (default: found by name and type)")
    add(
        "--image",
        metavar="TOPIC",
        help="score people as boxes in this camera's images too (Volkhardt et al. 2013): overlap of 0.25 and more",
    )
    add("--odometry", metavar="TOPIC", help="where tf lacks odom to base (default: found by type), or `none`")
    add_processing(parser)
    add("--start", type=float, default=0.0, metavar="S", help="seconds to leave out at the beginning")
    add("--duration", type=float, metavar="S", help="seconds to replay")
    add("--out", type=Path, metavar="BAG", help="write detections and tracks")
    add("--json", type=Path, metavar="FILE", help="write the table")
    add("--report", type=Path, metavar="DIR", help="write an HTML report with plots")
    add("--misses", type=Path, metavar="DIR", help="draw people who were missed, with all that was seen about them")
    add("--only-annotated", action="store_true", help="not everybody is annotated: count no false positives")
    add("--threshold", type=float, default=THRESHOLD_M, metavar="M", help="largest distance of a match, default 0.5")
    return parser
