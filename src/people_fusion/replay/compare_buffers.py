"""The command `compare_buffers`: what each buffer policy costs in delay and in accuracy on one recording.

Cues announce and deliver at the same times for every policy. Each is scored twice, see docs/buffers.md: as a recorder
has it, each published output counting for its stamp, and as a controller has it, by what is there at the instant.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, Optional, Sequence, Tuple, Union

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from people_fusion.core.config import parse
from people_fusion.core.errors import DataError, NotLooked, RecordingError, TransformUnavailable
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.stamps import to_seconds
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import TransformSource
from people_fusion.cues.cue import Cue, TransformRequest
from people_fusion.evaluation.delay_plots import plot_policies
from people_fusion.evaluation.evaluate import Evaluation
from people_fusion.evaluation.plots import png
from people_fusion.evaluation.tables import UNDEFINED, Table, millimetres, number, percent
from people_fusion.replay.discovery import Sources
from people_fusion.replay.ground_truth import Instant, read_ground_truth
from people_fusion.replay.recording import Recording
from people_fusion.replay.replay import Selection, check_window, score, sources_of
from people_fusion.replay.replay_bag import add_processing, overrides, processing_times
from people_fusion.replay.results import figures, guarded, write_json
from people_fusion.replay.sampling import Sampler
from people_fusion.replay.session import Session, Update, build_cue
from people_fusion.tracking.fusion import FusionConfig, load_config

ZERO_DELAY = "zero delay"
PREVIEW = "revisable: preview"
POLICIES: Dict[str, Dict[str, Any]] = {
    # The sorted run: waits for everything, and counts as if each measurement had been there at its stamp.
    ZERO_DELAY: {"type": "fixed_lag", "lag_s": 2.0, "patience_s": 10.0, "capacity": 4096},
    "drop": {"type": "drop"},
    "predict_forward": {"type": "predict_forward"},
    "reprocess": {"type": "reprocess"},
    "fixed_lag": {"type": "fixed_lag"},
    "dynamic": {"type": "dynamic"},
    "announced, thesis": {"type": "announced", "anticipate": False},
    "announced": {"type": "announced"},
    "revisable": {"type": "revisable"},
}


@dataclass(frozen=True, eq=False)
class Row:
    """What came of one policy.

    Attributes:
        delays_s: (K,) age of each published output, by its stamp.
        since_arrival_s: (K,) the same from when the cue had the sensor's message: without what the sensor itself needs.
        used_after_s: (M,) from each measurement's stamp to the first output that it is in.
        duration_s: from the first scan to the last.
        delivered: measurements that cues delivered.
        recorded: scores where each output counts for its stamp; None where nothing is annotated.
        at_once: scores of what was published by the annotated instants.
        counters: events by name.
    """

    delays_s: np.ndarray
    since_arrival_s: np.ndarray
    used_after_s: np.ndarray
    duration_s: float
    delivered: int
    recorded: Optional[Evaluation]
    at_once: Optional[Evaluation]
    counters: Dict[str, int]

    @property
    def discarded(self) -> float:
        """Share of the measurements that the tracker never took."""
        return 1.0 - len(self.used_after_s) / max(self.delivered, 1)

    def to_dict(self) -> Dict[str, Any]:
        """For JSON: seconds, Hz and fractions of 1; None where undefined."""
        known = len(self.delays_s) > 0
        return {
            "delay_mean_s": float(self.delays_s.mean()) if known else None,
            "delay_p95_s": float(np.percentile(self.delays_s, 95)) if known else None,
            "since_arrival_mean_s": float(self.since_arrival_s.mean()) if known else None,
            "used_after_mean_s": float(self.used_after_s.mean()) if len(self.used_after_s) else None,
            "rate_hz": len(self.delays_s) / self.duration_s if self.duration_s > 0 else None,
            "discarded": self.discarded,
            **figures(self.recorded),
            "at_once": figures(self.at_once),
            "events": self.counters,
        }


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/compare_buffers; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("compare_buffers", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Replay with every policy, print and write what was asked for.

    Raises:
        PeopleFusionError: a file, topic, frame or parameter is not usable.
    """
    config = load_config(options.config, overrides(options.set))
    selection = Selection(ground_truth=options.ground_truth, start_s=options.start, duration_s=options.duration)
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=notes, transient=True, disable=not notes.is_terminal) as bar:
        task = bar.add_task("policies", total=len(options.policies))
        rows = compare(
            options.bag,
            config,
            selection,
            processing_times(options.processing),
            lambda name: bar.update(task, advance=1, description=name),
            options.policies,
        )
    print(policy_table(rows).as_text())
    if options.json is not None:
        write_json(options.json, {name: row.to_dict() for name, row in rows.items()})
    if options.plot is not None:
        shown = {name: row for name, row in rows.items() if name != ZERO_DELAY}
        figure = plot_policies(
            {name: row.delays_s for name, row in shown.items()},
            {name: _mota(row.recorded) for name, row in shown.items()},
            {name: _mota(row.at_once) for name, row in shown.items()},
            _mota(rows[ZERO_DELAY].recorded) if ZERO_DELAY in rows else math.nan,
        )
        try:
            options.plot.write_bytes(png(figure))
        except OSError as error:
            raise RecordingError(f"{options.plot}: {error.strerror}") from error


def compare(
    path: Union[str, Path],
    config: FusionConfig,
    selection: Selection,
    processing_s: Mapping[str, float],
    done: Callable[[str], None] = lambda _name: None,
    policies: Sequence[str] = tuple(POLICIES),
) -> Dict[str, Row]:
    """Run a preset with each policy over a recording; by name, in their order, the preview last.

    Args:
        path: ROS 1 bag.
        config: preset; its own buffer is not used.
        selection: which part, and how it is scored.
        processing_s: see Session.
        done: called with the name of each policy that is done.
        policies: names in POLICIES.

    Raises:
        RecordingError: as `replay`.
        ConfigError: `processing_s` names no cue of a scan.
    """
    rows: Dict[str, Row] = {}
    with Recording(path) as recording:
        check_window(recording, selection)
        sources = sources_of(recording, config, selection)
        instants: Sequence[Instant] = ()
        if sources.ground_truth is not None:
            window = (selection.start_s, selection.duration_s)
            instants = read_ground_truth(recording, sources.ground_truth, sources.scans, *window)
        framed = dataclasses.replace(config, frames=sources.frames)
        memory: Memory = {}
        for name in policies:
            policy = parse(FusionConfig, {"buffer": POLICIES[name]}).buffer
            with_policy = dataclasses.replace(framed, buffer=policy)
            listener = Listener(with_policy, sources, instants, memory, processing_s)
            listener.session.run(recording, selection.start_s, selection.duration_s)
            if not listener.used_after_s:
                raise RecordingError(f"{path}: no measurement could be used")
            rows[name] = listener.row(selection)
            if name == ZERO_DELAY:
                rows[name] = _without_delay(rows[name])
            if listener.previewed:
                rows[PREVIEW] = listener.preview_row(selection)
            done(name)
    return rows


def policy_table(rows: Mapping[str, Row]) -> Table:
    """One row for each policy."""
    at_once = ("MOTA at once", "MOTP at once")
    header = ("", "delay", "95 %", "since arrival", "rate", "lost", "MOTA", "MOTP", "IDF1", "NEES", *at_once)
    lines = []
    for name, row in rows.items():
        values = row.to_dict()
        lines.append((
            name,
            *(_milliseconds(values[key]) for key in ("delay_mean_s", "delay_p95_s", "since_arrival_mean_s")),
            UNDEFINED if values["rate_hz"] is None else f"{values['rate_hz']:.1f} Hz",
            percent(values["discarded"]),
            percent(values["mota"]),
            millimetres(values["motp_m"]),
            percent(values["idf1"]),
            number(values["nees"]),
            percent(values["at_once"]["mota"]),
            millimetres(values["at_once"]["motp_m"]),
        ))  # fmt: skip
    return Table(header, tuple(lines))


class Listener:
    """Hears everything that a session publishes under one policy.

    Args:
        config: preset with the frames of this recording.
        sources: what to take of it.
        instants: when people are annotated.
        memory: what cues measured already, for the next listener to the same recording with the same leg cue.
        processing_s, clock: see Session.

    Attributes:
        session: to be run.
        used_after_s: from each measurement's stamp to the first output that it is in.
    """

    def __init__(
        self,
        config: FusionConfig,
        sources: Sources,
        instants: Sequence[Instant],
        memory: Memory,
        processing_s: Mapping[str, float],
        clock: Optional[Callable[[], float]] = None,
    ) -> None:
        self.session = Session(
            config,
            sources,
            self._measured,
            self._before,
            self._after,
            self._told,
            self._passing,
            lambda topic: _Remembering(build_cue(config, topic), memory),
            processing_s,
            clock,
        )
        self.published: List[Tuple[int, int]] = []  # stamp, when
        self.previewed: List[Tuple[int, int]] = []
        self.used_after_s: List[float] = []
        self._arrivals: Dict[int, int] = {}  # by stamp
        self._delivered = 0
        self._world = config.frames.world
        self._sampler = Sampler(instants)
        self._instants, self._next = instants, 0
        self._now_ns = 0
        self._at_once: List[Tuple[Instant, Tracks]] = []
        self._at_once_previewed: List[Tuple[Instant, Tracks]] = []

    def row(self, selection: Selection) -> Row:
        """Of the ordered output."""
        return self._row(self.published, self._sampler.samples, self._at_once, selection)

    def preview_row(self, selection: Selection) -> Row:
        """Of the output that is revised; it is published once for its instant."""
        return self._row(self.previewed, self._at_once_previewed, self._at_once_previewed, selection)

    def _row(
        self,
        outputs: Sequence[Tuple[int, int]],
        recorded: Sequence[Tuple[Instant, Tracks]],
        at_once: Sequence[Tuple[Instant, Tracks]],
        selection: Selection,
    ) -> Row:
        scored = {instant.stamp_ns for instant, _ in self._sampler.samples}  # the same instants for all
        kept = [[sample for sample in samples if sample[0].stamp_ns in scored] for samples in (recorded, at_once)]
        evaluations = [score(samples, selection)[2] if samples else None for samples in kept]
        return Row(
            delays_s=np.array([to_seconds(now_ns - stamp_ns) for stamp_ns, now_ns in outputs]),
            since_arrival_s=np.array([to_seconds(now_ns - self._arrivals[stamp_ns]) for stamp_ns, now_ns in outputs]),
            used_after_s=np.array(self.used_after_s),
            duration_s=self.session.recorded_s,
            delivered=self._delivered,
            recorded=evaluations[0],
            at_once=evaluations[1],
            counters=self.session.counters(),
        )

    def _passing(self, now_ns: int) -> None:
        """What a user has at the instants that are over, of what is published by then."""
        self._now_ns = now_ns
        fusion = self.session.fusion
        while self._next < len(self._instants) and self._instants[self._next].stamp_ns <= now_ns:
            instant = self._instants[self._next]
            self._next += 1
            with suppress(TransformUnavailable):
                there = instant.into(self._world, self.session.transforms)
                self._add(self._at_once, there, fusion.tracks(instant.stamp_ns))
                if fusion.buffer.revisable:
                    self._add(self._at_once_previewed, there, fusion.preview(instant.stamp_ns))

    def _add(self, samples: List[Tuple[Instant, Tracks]], instant: Instant, tracks: Tracks) -> None:
        if tracks.frame_id == self._world:
            samples.append((instant, tracks))

    def _told(self, announcement: Announcement) -> None:
        self._arrivals.setdefault(announcement.stamp_ns, self._now_ns)

    def _measured(self, measurement: Measurement, _arrival_ns: int) -> None:
        self._delivered += 1
        self._arrivals.setdefault(measurement.stamp_ns, self._now_ns)
        fusion = self.session.fusion
        if fusion.buffer.revisable:
            self.previewed.append((fusion.preview().stamp_ns, self._now_ns))

    def _before(self, stamp_ns: int) -> None:
        self._sampler.until(stamp_ns, self.session.fusion, self.session.transforms)

    def _after(self, update: Update) -> None:
        if not update.changed:
            return
        published_ns = self.session.fusion.tracker.stamp_ns
        assert published_ns is not None
        self.published.append((published_ns, self._now_ns))
        self.used_after_s.append(to_seconds(self._now_ns - update.measurement.stamp_ns))


Memory = Dict[Tuple[str, int], Union[Measurement, DataError, NotLooked, TransformUnavailable]]


class _Remembering(Cue):
    """A cue that measures each scan once for all policies, as no cue knows of them."""

    modality = "any"

    def __init__(self, cue: Cue, memory: Memory) -> None:
        self._cue, self._memory, self.name, self.takes = cue, memory, cue.name, cue.takes

    def wants(self, stamp_ns: int) -> bool:
        """See Cue."""
        return self._cue.wants(stamp_ns)

    def transforms_needed(self, data: Any) -> Tuple[TransformRequest, ...]:
        """See Cue."""
        return self._cue.transforms_needed(data)

    def measure(self, data: Any, transforms: Optional[TransformSource]) -> Measurement:
        """See Cue."""
        key = (self.name, data.stamp_ns)
        if key not in self._memory:
            try:
                self._memory[key] = self._cue.measure(data, transforms)
            except (DataError, NotLooked, TransformUnavailable) as error:
                self._memory[key] = error
        outcome = self._memory[key]
        if isinstance(outcome, Measurement):
            return outcome
        raise outcome

    def set_map(self, grid: Optional[OccupancyGrid]) -> None:
        """See Cue."""
        self._cue.set_map(grid)

    def set_localisation(self, covariance: np.ndarray) -> None:
        """See Cue."""
        self._cue.set_localisation(covariance)

    def reset(self) -> None:
        """See Cue."""
        self._cue.reset()


def _without_delay(row: Row) -> Row:
    return dataclasses.replace(
        row,
        delays_s=np.zeros(len(row.delays_s)),
        since_arrival_s=np.zeros(len(row.delays_s)),
        used_after_s=np.zeros(len(row.used_after_s)),
        at_once=row.recorded,
    )


def _mota(evaluation: Optional[Evaluation]) -> float:
    mota = None if evaluation is None else evaluation.scores.clear_mot.mota
    return math.nan if mota is None else mota


def _milliseconds(value_s: Optional[float]) -> str:
    return UNDEFINED if value_s is None else f"{1000.0 * value_s:.0f} ms"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="compare_buffers", description=__doc__)
    add = parser.add_argument
    add("bag", type=Path, help="ROS 1 bag with scans; announcements and detections of other cues are taken, too")
    add("--config", metavar="FILE", help="preset by its name, or a YAML file (default: default)")
    add("--set", metavar="KEY=VALUE", action="append", default=[], help="over the preset, e.g. tracker/gate=9.2")
    add("--ground-truth", metavar="TOPIC", help="annotated people (default: found by name and type)")
    names = "; ".join(POLICIES)
    add("--policies", nargs="+", choices=POLICIES, default=list(POLICIES), metavar="NAME", help=f"default: {names}")
    add_processing(parser)
    add("--start", type=float, default=0.0, metavar="S", help="seconds to leave out at the beginning")
    add("--duration", type=float, metavar="S", help="seconds to replay")
    add("--json", type=Path, metavar="FILE", help="write the table")
    add("--plot", type=Path, metavar="PNG", help="write delay against MOTA, and how the delays spread")
    return parser
