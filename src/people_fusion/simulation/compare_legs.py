"""The command `compare_legs`: leg tracking with occlusion probabilities that adapt to people, and without.

The experiments of Arras et al. 2012, 3.4, on simulated recordings; see docs/legs.md.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any, Dict, List, Mapping, NamedTuple, Optional, Set, Tuple

import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.progress import track

from people_fusion.core.errors import ConfigError
from people_fusion.core.stamps import to_seconds
from people_fusion.evaluation.evaluate import Scores
from people_fusion.evaluation.report import report
from people_fusion.evaluation.tables import Table
from people_fusion.replay.replay import Selection, replay
from people_fusion.replay.results import guarded, write_json
from people_fusion.replay.session import Session, Update
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.compare_presets import publish
from people_fusion.simulation.simulator import simulate
from people_fusion.simulation.trials import Trial, trials
from people_fusion.tracking.fusion import FusionConfig, load_config
from people_fusion.tracking.trackers.leg_mht import LegMht

EXPERIMENTS = ("arras_eight", "arras_turning", "arras_corridor", "arras_moving")
FREE = {"p_detected": 0.3, "p_occluded": 0.63, "p_deleted": 0.07}
APPROVED = {"p_detected": 0.2, "p_occluded": 0.79, "p_deleted": 0.01}
WAYS: Dict[str, Dict[str, Any]] = {
    "adaptive": {},
    "fixed": {"adaptive": False, "mht": FREE},
    "fixed, as approved": {"adaptive": False, "mht": APPROVED},
}


class Course(NamedTuple):
    """One recording, one way.

    Attributes:
        times_s: (K,) of the scans.
        made: (K,) leg tracks made so far, of those that were in the best hypothesis for a second.
        legs: (K,) leg tracks in the best hypothesis.
        hypotheses: (K,).
        persons: identities given to people.
        cycle_ms: (K,) time of the process from scan to tracks.
        scores: against the truth.
        people: how many there are.
    """

    times_s: np.ndarray
    made: np.ndarray
    legs: np.ndarray
    hypotheses: np.ndarray
    persons: int
    cycle_ms: np.ndarray
    scores: Scores
    people: int


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/compare_legs; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("compare_legs", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Simulate, track, print and write what was asked for.

    Raises:
        PeopleFusionError: a scenario, preset, number or file is not usable.
    """
    entries = trials(options.experiments, options.seeds, options.duration)
    courses: Dict[Tuple[str, str], List[Course]] = {}
    for trial in track(entries, "recordings", console=notes, disable=not notes.is_terminal):
        for way, course in courses_of(trial, options.preset).items():
            courses.setdefault((trial.name, way), []).append(course)
    table = course_table(courses)
    print(table.as_text())
    if options.json is not None:
        figures: Dict[str, Dict[str, Any]] = {}
        for (name, way), several in courses.items():
            figures.setdefault(name, {})[way] = summary(several)
        write_json(options.json, figures)
    if options.report is not None:
        named = {f"{name} {way}": _added(several) for (name, way), several in courses.items()}
        pictures = [
            (name, "Seed 1, as figures 8 and 9 of the paper.", picture({way: courses[name, way][0] for way in WAYS}))
            for name in options.experiments
        ]
        publish(options.report, report("Legs", named, pictures, notes=[f"{options.seeds} seeds of each experiment"]))


def courses_of(trial: Trial, preset: str) -> Dict[str, Course]:
    """One recording in all ways."""
    found: Dict[str, Course] = {}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{Path(trial.name).stem}_{trial.seed}.bag"
        write_bag(path, simulate(trial.scenario, trial.seed))
        for way, options in WAYS.items():
            config = load_config(preset, {"tracker": {"type": "leg_mht", **options}})
            found[way] = _course(path, config, sum(person.count for person in trial.scenario.people))
    return found


def _course(path: Path, config: FusionConfig, people: int) -> Course:
    rows: List[Tuple[float, int, int, int, float]] = []
    first_seen: Dict[int, int] = {}
    made: Set[int] = set()
    persons: Set[int] = set()
    began = time.process_time()

    def watch(session: Session, update: Update) -> None:
        nonlocal began
        tracker = session.fusion.tracker
        cycle_ms = 1e3 * (time.process_time() - began)
        if not isinstance(tracker, LegMht):
            raise ConfigError("tracker: compare_legs is about leg_mht")
        legs = tracker.leg_tracks.ids.tolist()
        for leg in legs:
            if update.measurement.stamp_ns - first_seen.setdefault(leg, update.measurement.stamp_ns) >= 10**9:
                made.add(leg)
        persons.update(session.fusion.tracks().ids.tolist())
        now_s = to_seconds(update.measurement.stamp_ns - min(first_seen.values(), default=update.measurement.stamp_ns))
        rows.append((now_s, len(made), len(legs), tracker.hypotheses, cycle_ms))
        began = time.process_time()

    outcome = replay(path, config, Selection(), watch=watch)
    if outcome.evaluation is None:
        raise ConfigError(f"{path.stem}: nothing is annotated")
    columns = np.array(rows, dtype=float).reshape(-1, 5).T
    return Course(
        columns[0], columns[1], columns[2], columns[3], len(persons), columns[4], outcome.evaluation.scores, people
    )


def summary(courses: List[Course]) -> Dict[str, float]:
    """Means over the seeds, and the slowest twentieth of all cycles."""
    clear = _added(courses).clear_mot
    cycles = np.concatenate([course.cycle_ms for course in courses])
    return {
        "leg_tracks_made": float(np.mean([course.made[-1] for course in courses])),
        "legs": 2.0 * courses[0].people,
        "person_tracks_made": float(np.mean([course.persons for course in courses])),
        "people": float(courses[0].people),
        "identity_switches": clear.mismatches / len(courses),
        "mota": float("nan") if clear.mota is None else clear.mota,
        "largest_leg_count": float(max(course.legs.max() for course in courses)),
        "hypotheses": float(np.mean([course.hypotheses.mean() for course in courses])),
        "cycle_median_ms": float(np.median(cycles)),
        "cycle_p95_ms": float(np.percentile(cycles, 95)),
    }


def course_table(courses: Mapping[Tuple[str, str], List[Course]]) -> Table:
    """A row for each experiment and way."""
    rows = []
    for (name, way), several in courses.items():
        entry = summary(several)
        rows.append((
            f"{name} {way}",
            f"{entry['leg_tracks_made']:.1f} ({entry['legs']:.0f})",
            f"{entry['person_tracks_made']:.1f} ({entry['people']:.0f})",
            f"{entry['identity_switches']:.1f}",
            f"{100 * entry['mota']:.1f} %",
            f"{entry['largest_leg_count']:.0f}",
            f"{entry['hypotheses']:.0f}",
            f"{entry['cycle_median_ms']:.1f} / {entry['cycle_p95_ms']:.1f} ms",
        ))  # fmt: skip
    header = (
        "", "legs made (true)", "people made (true)", "switches", "MOTA", "most legs", "hypotheses", "cycle 50 / 95 %"
    )  # fmt: skip
    return Table(header, tuple(rows))


def picture(ways: Mapping[str, Course]) -> Figure:
    """Leg tracks made, as in figure 8, and tracks and hypotheses at each time, as in figure 9."""
    figure = Figure(figsize=(8.0, 8.0), dpi=100)
    axes = figure.subplots(3, 1, sharex=True)
    for way, course in ways.items():
        axes[0].plot(course.times_s, course.made, label=way)
        axes[1].plot(course.times_s, course.legs, label=way, linewidth=0.8)
        axes[2].plot(course.times_s, course.hypotheses, label=way, linewidth=0.8)
    truth = 2 * next(iter(ways.values())).people
    for panel in axes[:2]:
        panel.axhline(truth, color="black", linestyle="--", linewidth=0.8, label="truth")
    for panel, title in zip(axes, ("leg tracks made", "leg tracks", "hypotheses")):
        panel.set_ylabel(title)
        panel.grid(True, alpha=0.3)
    axes[0].legend(fontsize=8)
    axes[2].set_xlabel("seconds")
    figure.tight_layout()
    return figure


def _added(courses: List[Course]) -> Scores:
    total = Scores()
    for course in courses:
        total = total + course.scores
    return total


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="compare_legs", description=__doc__)
    add = parser.add_argument
    add("--experiments", nargs="+", default=list(EXPERIMENTS), metavar="NAME", help=f"default: {' '.join(EXPERIMENTS)}")
    add("--preset", default="default", metavar="NAME", help="whose leg cue is used (default %(default)s)")
    add("--seeds", type=int, default=3, metavar="N", help="recordings of each experiment (default %(default)s)")
    add("--duration", type=float, metavar="S", help="seconds, instead of each experiment's")
    add("--json", type=Path, metavar="FILE", help="write the table")
    add("--report", type=Path, metavar="DIR", help="write an HTML report with pictures")
    return parser
