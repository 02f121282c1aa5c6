"""The command `run_experiments`: tables 7.1 to 7.5 of Poschmann 2018 on simulated recordings, several seeds each.

Every finished run stays in the output folder. A command that was interrupted goes on where it was when it is started
again; what is damaged, and what was made by other settings or other code, is done anew.
"""

from __future__ import annotations

import argparse
import fcntl
import multiprocessing
import signal
import time
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List, Optional, Sequence, Set, Tuple

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

from people_fusion.core.errors import ConfigError, PeopleFusionError, RecordingError
from people_fusion.evaluation.report import Part, paper_report
from people_fusion.evaluation.tables import Table
from people_fusion.replay.results import guarded, positive, save_report
from people_fusion.simulation.experiment_runs import Run, runs_of, write_whole
from people_fusion.simulation.experiment_tables import Results, cost_picture, picture_of, table_of
from people_fusion.simulation.experiments import ExperimentsConfig, load_experiments
from people_fusion.simulation.trials import Trial, trials

INTERRUPTED = 130  # exit status, as of a shell
CAPTIONS = {
    "accuracy": (
        "CLEAR-MOT in the ground plane, 0.5 m. Ours: mean ± standard deviation of runs over recordings of their own; "
        "the thesis adds five runs over one recording."
    ),
    "speed": (
        "Laser, image: CPU of the slowest cue for a message; tracker: CPU for a measurement, what the thesis counts to "
        "the image cue of T2 included. Delay: age of the output since its message arrived at the cue, while cues work "
        "as long as the thesis's did. CPU: of all cues and the tracker, of one core. Times are of the computer that "
        "ran this."
    ),
}


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/run_experiments; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)  # who is terminated ends his processes, too
    try:
        return guarded("run_experiments", lambda: run(options, errors), errors)
    except KeyboardInterrupt:
        errors.print("run_experiments: interrupted; started again it goes on from here", highlight=False)
        return INTERRUPTED
    finally:
        signal.signal(signal.SIGTERM, before)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Do what is not done yet, print and write the tables.

    Raises:
        PeopleFusionError: an option, the experiments' file or the folder is not usable, or a run failed; whatever
            could be run was, and the tables are of that. Where there is none, they are left as they were.
    """
    if options.jobs < 1:
        raise ConfigError(f"--jobs: {options.jobs} is not positive")
    experiments = load_experiments(options.experiments)
    chosen = experiments.select(options.only)
    duration_s = positive("--duration", options.duration)
    entries = trials([options.scenario], options.seeds, duration_s, options.first_seed)
    every = _runs(experiments, entries, options.out)
    wanted = {name: every[name] for name in chosen.configurations}
    with _alone(options.out):
        results, failures = _carry_out(wanted, 0 if options.tables_only else options.jobs, notes)
    figures = {name: [results[each.key]["figures"] for each in wanted[name] if each.key in results] for name in wanted}
    total = len({each.key for runs in wanted.values() for each in runs})
    if not results:
        raise PeopleFusionError("; ".join(failures) or f"{options.out}: none of {total} runs is there")
    tables = {number: table_of(table, figures) for number, table in chosen.tables.items()}
    for number, table in tables.items():
        print(f"Table {number}: {chosen.tables[number].title}\n\n{table.as_text()}\n")
    said = _said(entries)
    if len(results) < total:
        said.append(f"{total - len(results)} of {total} runs are not there, or were made by other settings or code.")
        notes.print(said[-1], highlight=False)
    write_whole(options.out / "tables.md", _markdown(chosen, tables, said))
    save_report(options.out, _html(chosen, tables, figures, said))
    if failures:
        raise PeopleFusionError(f"{len(failures)} runs failed: {'; '.join(failures)}")


def _runs(experiments: ExperimentsConfig, entries: Sequence[Trial], folder: Path) -> Dict[str, List[Run]]:
    configurations = {}
    for name, configuration in experiments.configurations.items():
        try:
            configurations[name] = configuration.build()
        except ConfigError as error:
            raise ConfigError(f"configurations/{name}: {error}") from error
    processing_s = {name: configuration.processing for name, configuration in experiments.configurations.items()}
    return runs_of(folder, configurations, processing_s, entries)


def _carry_out(
    wanted: Dict[str, List[Run]], jobs: int, notes: Console
) -> Tuple[Dict[str, Dict[str, Any]], List[str]]:
    """Results by key, and what went wrong; `jobs` 0: only what is there already."""
    unique = {each.key: each for runs in wanted.values() for each in runs}
    results = {}
    for key, each in unique.items():
        found = each.stored()
        if found is not None:
            results[key] = found
        elif each.path.exists():
            notes.print(f"{each.path} is damaged", markup=False, highlight=False, soft_wrap=True)
    open_runs = [each for key, each in unique.items() if key not in results]
    open_runs.sort(key=lambda each: each.trial.seed)  # recording by recording
    failures: List[str] = []
    if not open_runs or jobs == 0:
        return results, failures
    if results:
        notes.print(f"{len(results)} of {len(unique)} runs are there already", highlight=False)
    with _Progress(notes, len(open_runs)) as progress:
        for each, outcome in _outcomes(open_runs, jobs, progress.show):
            if isinstance(outcome, PeopleFusionError):
                failures.append(f"{each.name}, seed {each.trial.seed}: {outcome}")
            else:
                results[each.key] = outcome
            progress.done(each, outcome)
    return results, failures


def _outcomes(
    open_runs: Sequence[Run], jobs: int, show: Callable[[str], None]
) -> Iterator[Tuple[Run, Any]]:
    """Each run with its results or its error, as they come."""
    if jobs == 1:
        for each in open_runs:
            show(f"{each.name}, seed {each.trial.seed}")
            yield each, _attempt(each)
        return
    # Forked, as a spawned process would start the command's script anew.
    context = multiprocessing.get_context("fork")
    with ProcessPoolExecutor(jobs, mp_context=context, initializer=_quiet) as pool:
        try:
            yield from _pooled(pool, open_runs)
        except BrokenProcessPool as error:
            raise PeopleFusionError("a process died; started again the command goes on from here") from error
        except BaseException:
            for child in multiprocessing.active_children():
                child.terminate()
            raise


def _pooled(pool: ProcessPoolExecutor, open_runs: Sequence[Run]) -> Iterator[Tuple[Run, Any]]:
    """The recordings first; whatever is replayed waits for its own."""
    waiting: Dict[Path, List[Run]] = {}
    for each in open_runs:
        waiting.setdefault(each.recording, []).append(each)
    renders: Dict[Future, Path] = {pool.submit(_render, runs[0]): path for path, runs in waiting.items()}
    replays: Dict[Future, Run] = {}
    pending: Set[Future] = set(renders)
    while pending:
        finished, pending = wait(pending, return_when=FIRST_COMPLETED)
        for future in finished:
            if future in replays:
                yield replays[future], future.result()
                continue
            error = future.result()
            for each in waiting[renders[future]]:
                if error is not None:
                    yield each, error
                    continue
                started = pool.submit(_attempt, each)
                replays[started] = each
                pending.add(started)


def _render(each: Run) -> Optional[PeopleFusionError]:
    try:
        each.render()
    except PeopleFusionError as error:
        return error
    return None


def _attempt(each: Run) -> Any:
    """Results, or the error: one run that fails leaves the others alone."""
    try:
        each.render()
        return each.carry_out()
    except PeopleFusionError as error:
        return error


def _quiet() -> None:
    """A process that is interrupted with the command says nothing."""
    for name in (signal.SIGINT, signal.SIGTERM):
        signal.signal(name, signal.SIG_DFL)


class _Progress:
    """A bar where there is a terminal, and one line a run, with an estimate of what is left."""

    def __init__(self, notes: Console, total: int) -> None:
        self._notes, self._total, self._done = notes, total, 0
        self._began_s = time.perf_counter()
        columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
        # Nothing may draw in a thread of its own while processes fork.
        self._bar = Progress(
            *columns, console=notes, transient=True, auto_refresh=False, disable=not notes.is_terminal
        )
        self._task = TaskID(0)

    def __enter__(self) -> _Progress:
        self._bar.start()
        self._task = self._bar.add_task("runs", total=self._total)
        self._bar.refresh()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def show(self, name: str) -> None:
        """What is being done."""
        self._bar.update(self._task, description=name, refresh=True)

    def done(self, each: Run, outcome: Any) -> None:
        """A run is over."""
        self._done += 1
        left_s = (time.perf_counter() - self._began_s) / self._done * (self._total - self._done)
        name, told = f"{each.name}, seed {each.trial.seed}", "failed"
        if not isinstance(outcome, PeopleFusionError):
            mota = outcome["figures"]["mota"]
            told = f"{outcome['wall_s']:.0f} s" + ("" if mota is None else f", MOTA {100.0 * mota:.1f} %")
        line = f"{self._done}/{self._total}  {name}: {told}; about {_duration(left_s)} left"
        self._notes.print(line, markup=False, highlight=False, soft_wrap=True)
        self._bar.update(self._task, advance=1, refresh=True)


def _duration(seconds: float) -> str:
    minutes = round(seconds / 60.0)
    if minutes < 1:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """No second command may work in the folder meanwhile.

    Raises:
        RecordingError: one does, or nothing can be written there.
    """
    try:
        for part in ("runs", "recordings"):
            (folder / part).mkdir(parents=True, exist_ok=True)
        lock = (folder / ".lock").open("w")
    except OSError as error:
        raise RecordingError(f"{folder}: {error.strerror}") from error
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise RecordingError(f"{folder}: another run_experiments is at work there") from error
        yield


def _said(entries: Sequence[Trial]) -> List[str]:
    first, seeds = entries[0].scenario, f"{entries[0].seed} to {entries[-1].seed}"
    said = [
        f"Simulated {Path(entries[0].name).stem}, {first.duration_s:g} s, seeds {seeds}. "
        "Thesis: Poschmann 2018, 7.5, one recording of 267 s in a museum.",
    ]
    if not first.cameras:
        said.append(
            "The scenario has no cameras: detections are emulated or none, and H2, H2A cannot look at any image."
        )
    return said


def _markdown(experiments: ExperimentsConfig, tables: Dict[str, Table], said: Sequence[str]) -> str:
    lines = ["# Experiments of Poschmann 2018, 7.5", *said]
    for number, table in tables.items():
        config = experiments.tables[number]
        lines += [f"## Table {number}: {config.title}", CAPTIONS[config.columns], table.as_markdown()]
    return "\n\n".join(lines) + "\n"


def _html(
    experiments: ExperimentsConfig, tables: Dict[str, Table], figures: Results, said: Sequence[str]
) -> str:
    parts = []
    for number, table in tables.items():
        config = experiments.tables[number]
        heading = f"Table {number}: {config.title}"
        parts.append(Part(heading, CAPTIONS[config.columns], table, picture_of(config, figures)))
    caption = "What accuracy costs: cues and tracker together, on the computer that ran this."
    parts.append(Part("MOTA against CPU", caption, None, cost_picture(figures)))
    settings = {
        name: {
            "preset": each.preset,
            **dict(setting.split("=", 1) for setting in each.overrides),
            **{f"processing/{cue}": seconds for cue, seconds in each.processing.items()},
        }
        for name, each in experiments.configurations.items()
    }
    return paper_report("Experiments of Poschmann 2018, 7.5", parts, settings, said)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="run_experiments", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    add = parser.add_argument
    add("--out", type=Path, default=Path("experiments"), metavar="DIR", help="default: %(default)s")
    add("--scenario", default="museum_cameras", metavar="NAME", help="or YAML (default: %(default)s)")
    add("--duration", type=float, default=60.0, metavar="S", help="of each recording (default: %(default)s)")
    add("--seeds", type=int, default=5, metavar="N", help="recordings (default: %(default)s)")
    add("--first-seed", type=int, default=1, metavar="N", help="default: %(default)s")
    add("--jobs", type=int, default=1, metavar="N", help="processes at work (default: %(default)s)")
    add(
        "--only",
        nargs="+",
        action="extend",
        default=[],
        metavar="TABLE[/ROW]",
        help="some rows, e.g. 7.4 or '*/T2-L2-*' (default: all)",
    )
    add("--experiments", type=Path, metavar="FILE", help="what to compare (default: config/experiments/poschmann.yaml)")
    add("--tables-only", action="store_true", help="run nothing: tables and report of what is there")
    return parser
