"""The command `simulate`: a recording with ground truth from a scenario."""

from __future__ import annotations

import argparse
import dataclasses
import sys
from pathlib import Path
from typing import List, Optional

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from people_fusion.core.errors import ConfigError, PeopleFusionError
from people_fusion.core.stamps import to_seconds
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import START_NS, simulate


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/simulate; returns the exit status."""
    parser = argparse.ArgumentParser(prog="simulate", description=__doc__)
    parser.add_argument("scenario", help="name in config/scenarios, or a YAML file")
    parser.add_argument("--seed", type=int, default=1, help="same seed, same bytes (default %(default)s)")
    parser.add_argument("--out", type=Path, help="bag to write (default SCENARIO_SEED.bag)")
    parser.add_argument("--duration", type=float, metavar="S", help="seconds, instead of the scenario's")
    options = parser.parse_args(arguments)
    console = Console(stderr=True)
    try:
        out = run(options.scenario, options.seed, options.out, options.duration, console)
    except PeopleFusionError as error:
        print(f"simulate: {error}", file=sys.stderr)
        return 1
    print(out)
    return 0


def run(name: str, seed: int, out: Optional[Path], duration_s: Optional[float], console: Console) -> Path:
    """Simulate and write; returns the bag's path."""
    scenario = load_scenario(name)
    if seed < 0:
        raise ConfigError(f"--seed: {seed} is negative")
    if duration_s is not None:
        if not duration_s > 0.0:
            raise ConfigError(f"--duration: {duration_s} is not positive")
        scenario = dataclasses.replace(scenario, duration_s=duration_s)
    path = out or Path(f"{Path(name).stem}_{seed}.bag")
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task("people walk", total=None)
        events = simulate(scenario, seed)
        progress.update(task, description="scanners scan", total=scenario.duration_s)
        write_bag(path, events, lambda arrival_ns: progress.update(task, completed=to_seconds(arrival_ns - START_NS)))
    return path
