"""Trials: seeds of scenarios, each simulated once and replayed with every preset that is compared."""

from __future__ import annotations

import dataclasses
import multiprocessing
import os
import tempfile
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Iterable, Iterator, Mapping, Optional, Sequence, Tuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from people_fusion.core.errors import ConfigError
from people_fusion.evaluation.evaluate import Evaluation, Scores
from people_fusion.evaluation.truth import Truth
from people_fusion.replay.replay import Selection, replay
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.scenario import ScenarioConfig, load_scenario
from people_fusion.simulation.simulator import simulate
from people_fusion.tracking.fusion import FusionConfig


@dataclass(frozen=True, eq=False)
class Run:
    """What one preset made of one trial."""

    truth: Truth
    evaluation: Evaluation


@dataclass(frozen=True)
class Trial:
    """One recording.

    Attributes:
        name: of the scenario.
        scenario: what happens.
        seed: the same seed, the same recording.
    """

    name: str
    scenario: ScenarioConfig
    seed: int

    def replay(self, presets: Mapping[str, FusionConfig]) -> Dict[str, Run]:
        """Simulate it and replay it with each preset."""
        runs: Dict[str, Run] = {}
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"{Path(self.name).stem}_{self.seed}.bag"
            write_bag(path, simulate(self.scenario, self.seed))
            for name, config in presets.items():
                outcome = replay(path, config, Selection())
                if outcome.truth is None or outcome.evaluation is None:
                    raise ConfigError(f"scenario {self.name}: nothing of seed {self.seed} is annotated")
                runs[name] = Run(outcome.truth, outcome.evaluation)
        return runs


def trials(
    names: Iterable[str], seeds: int, duration_s: Optional[float] = None, first_seed: int = 1
) -> Tuple[Trial, ...]:
    """So many seeds of each scenario, of `duration_s` instead of its own duration.

    Raises:
        ConfigError: a scenario is not usable or a number not positive.
    """
    if seeds < 1:
        raise ConfigError(f"--seeds: {seeds} is not positive")
    if duration_s is not None and not duration_s > 0.0:
        raise ConfigError(f"--duration: {duration_s} is not positive")
    if first_seed < 0:
        raise ConfigError(f"--first-seed: {first_seed} is negative")
    scenarios = {name: load_scenario(name) for name in names}
    if duration_s is not None:
        scenarios = {name: dataclasses.replace(entry, duration_s=duration_s) for name, entry in scenarios.items()}
    numbers = range(first_seed, first_seed + seeds)
    return tuple(Trial(name, entry, seed) for name, entry in scenarios.items() for seed in numbers)


def replay_all(
    entries: Sequence[Trial], presets: Mapping[str, FusionConfig], jobs: Optional[int], notes: Console
) -> Dict[Tuple[str, int], Dict[str, Run]]:
    """Every trial with every preset, in order of the trials however many processes work.

    Args:
        entries: to be replayed.
        presets: by name.
        jobs: processes; None: one for each processor.
        notes: where progress is shown.

    Returns:
        Runs by preset, by scenario and seed.

    Raises:
        ConfigError: `jobs` is not positive.
        PeopleFusionError: as `Trial.replay`.
    """
    if jobs is not None and jobs < 1:
        raise ConfigError(f"--jobs: {jobs} is not positive")
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    runs: Dict[Tuple[str, int], Dict[str, Run]] = {}
    # Nothing may draw in a thread of its own while processes fork.
    bar = Progress(*columns, console=notes, transient=True, auto_refresh=False, disable=not notes.is_terminal)
    with bar:
        task = bar.add_task("recordings", total=len(entries))
        bar.refresh()
        for trial, of_presets in _replayed(entries, presets, jobs or os.cpu_count() or 1):
            runs[trial.name, trial.seed] = of_presets
            bar.update(task, advance=1, refresh=True)
    return {(trial.name, trial.seed): runs[trial.name, trial.seed] for trial in entries}


def summed(runs: Mapping[Tuple[str, int], Mapping[str, Run]]) -> Dict[Tuple[str, str], Scores]:
    """Scores by scenario and preset; counts are added over the seeds, as Poschmann adds five runs (7.5.2)."""
    scores: Dict[Tuple[str, str], Scores] = {}
    for (scenario, _), of_presets in runs.items():
        for preset, run in of_presets.items():
            scores[scenario, preset] = scores.get((scenario, preset), Scores()) + run.evaluation.scores
    return scores


def _replayed(
    entries: Sequence[Trial], presets: Mapping[str, FusionConfig], jobs: int
) -> Iterator[Tuple[Trial, Dict[str, Run]]]:
    if jobs == 1 or len(entries) == 1:
        for trial in entries:
            yield trial, trial.replay(presets)
        return
    # Forked, as a spawned process would start the command's script anew.
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(min(jobs, len(entries)), mp_context=context) as pool:
        waiting = {pool.submit(trial.replay, presets): trial for trial in entries}
        try:
            for done in as_completed(waiting):
                yield waiting[done], done.result()
        finally:
            for future in waiting:  # after an error nobody wants the rest
                future.cancel()
