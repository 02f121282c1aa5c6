"""Runs of experiments: one configuration over one recording each, kept as one JSON file each: none is done twice.

A file's name ends in a digest of all that its figures depend on: settings, scenario, seed and the code itself. What is
found under that name is taken as it is; what is damaged is done anew.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
import os
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, Optional, Sequence, Tuple

from people_fusion.core.errors import ConfigError, RecordingError
from people_fusion.core.resources import directory
from people_fusion.core.stamps import to_seconds
from people_fusion.replay.compare_buffers import Listener
from people_fusion.replay.discovery import Sources
from people_fusion.replay.ground_truth import read_ground_truth
from people_fusion.replay.recording import Recording
from people_fusion.replay.replay import Selection, sources_of
from people_fusion.replay.results import settings
from people_fusion.replay.session import TRACKER, Work
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.experiments import FIGURES, LEGS
from people_fusion.simulation.scenario import ScenarioConfig
from people_fusion.simulation.simulator import simulate
from people_fusion.simulation.trials import Trial
from people_fusion.tracking.fusion import FusionConfig

SOURCE = Path(__file__).resolve().parents[1]
MAKES = ("core", "simulation")  # rooms on which a recording depends
REPLAYS = ("core", "cues", "association", "filtering", "tracking", "replay", "evaluation", "simulation")
SHOWS = (  # modules that only tell what came out
    *("run_experiments.py", "experiments.py", "experiment_tables.py", "experiment_plots.py", "plots.py"),
    *("delay_plots.py", "report.py", "tables.py", "compare_presets.py", "compare_legs.py"),
    *("compare_localisation.py", "buffer_timing.py"),
)  # fmt: skip
Figures = Dict[str, Any]
COST = ("laser_s", "image_s", "tracker_s", "cpu_share")  # of the machine, not of the seed


@dataclass(frozen=True)
class Run:
    """One configuration over one recording.

    Attributes:
        name: of the configuration.
        config: its preset.
        processing_s: see ConfigurationConfig.
        trial: scenario and seed.
        recording: the bag, which is made if it is not there.
        path: of its results.
        key: digest of all that the results depend on.
    """

    name: str
    config: FusionConfig
    processing_s: Mapping[str, float]
    trial: Trial
    recording: Path
    path: Path
    key: str

    def stored(self) -> Optional[Dict[str, Any]]:
        """Results of an earlier run; None where there are none, or only damaged ones."""
        try:
            found = json.loads(self.path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return found if _is_whole(found, self.key) else None

    def carry_out(self) -> Dict[str, Any]:
        """Replay the recording and keep the results; the recording must be there.

        Raises:
            PeopleFusionError: the recording cannot be replayed, or nothing of it is annotated.
            RecordingError: the results cannot be written.
        """
        began_s = time.perf_counter()
        figures, events = replay_timed(self.recording, self.config, self.processing_s)
        results = {
            "key": self.key,
            "configuration": self.name,
            "seed": self.trial.seed,
            "scenario": self.trial.name,
            "recorded_s": self.trial.scenario.duration_s,
            "wall_s": time.perf_counter() - began_s,
            "figures": figures,
            "events": events,
            "processing_s": dict(self.processing_s),
            "settings": _plain(settings(self.config)),
        }
        write_whole(self.path, json.dumps(results, indent=1, allow_nan=False) + "\n")
        return results

    def render(self) -> None:
        """Make the recording, unless it is there.

        Raises:
            RecordingError: it cannot be written.
        """
        if not self.recording.is_file():
            write_bag(self.recording, simulate(self.trial.scenario, self.trial.seed))


def runs_of(
    folder: Path,
    configurations: Mapping[str, FusionConfig],
    processing_s: Mapping[str, Mapping[str, float]],
    trials: Sequence[Trial],
) -> Dict[str, List[Run]]:
    """A run of each configuration for each trial, by configuration. Those that are equal in all but name share one."""
    made, replayed = code_version(MAKES), code_version(REPLAYS)
    first: Dict[str, Run] = {}
    runs: Dict[str, List[Run]] = {}
    for name, config in configurations.items():
        runs[name] = []
        for trial in trials:
            recorded = digest(made, _said(trial.scenario), trial.seed)
            key = digest(replayed, recorded, settings(config), dict(processing_s[name]))
            stem = f"{Path(trial.name).stem}_{trial.seed}"
            recording = folder / "recordings" / f"{stem}_{recorded}.bag"
            path = folder / "runs" / f"{_in_a_name(name)}_{stem}_{key}.json"
            run = first.setdefault(key, Run(name, config, processing_s[name], trial, recording, path, key))
            runs[name].append(run)
    return runs


def replay_timed(path: Path, config: FusionConfig, processing_s: Mapping[str, float]) -> Tuple[Figures, Dict[str, int]]:
    """Figures and counters of a preset over a recording, as delays and busy cues make them.

    Args:
        path: the bag.
        config: preset. Where it names modalities, cues of others do not run.
        processing_s: by `legs` or head cue, see ConfigurationConfig.

    Raises:
        PeopleFusionError: the recording is not usable, or nothing of it is annotated.
    """
    config = _heeded(config)
    with Recording(path) as recording:
        sources = sources_of(recording, config, Selection())
        if sources.ground_truth is None:
            raise RecordingError(f"{path}: nothing is annotated")
        instants = read_ground_truth(recording, sources.ground_truth, sources.scans, 0.0, None)
        if config.modalities and LEGS not in config.modalities:
            sources = dataclasses.replace(sources, scans=())
        framed = dataclasses.replace(config, frames=sources.frames)
        times = _processing(sources, config, processing_s)
        listener = Listener(framed, sources, instants, {}, times, time.process_time)
        listener.session.run(recording)
        recorded_s = to_seconds(recording.end_ns - recording.start_ns)
    row = dataclasses.replace(listener.row(Selection()), duration_s=recorded_s)
    if row.recorded is None:
        raise RecordingError(f"{path}: no measurement could be used")
    values = row.to_dict()
    events = values.pop("events")
    values.pop("at_once")
    values["delay_s"] = values["since_arrival_mean_s"]
    return {**values, **_cost(listener.session.work, sources, recorded_s)}, events


def code_version(rooms: Iterable[str]) -> str:
    """Digest of the code of some rooms, and of the models that come with the package."""
    files = [file for room in rooms for file in sorted((SOURCE / room).rglob("*.py")) if file.name not in SHOWS]
    files += sorted((directory("config") / "models").glob("*"))
    native = SOURCE.parents[1] / "native"
    files += sorted(native.glob("*.c"))
    return digest(*(f"{file.name} {hashlib.sha256(file.read_bytes()).hexdigest()}" for file in files if file.is_file()))


def digest(*parts: Any) -> str:
    """Twelve digits that stand for what JSON can say."""
    return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()[:12]


def write_whole(path: Path, text: str) -> None:
    """Write a file so that nobody ever sees a part of it.

    Raises:
        RecordingError: it cannot be written.
    """
    unfinished = path.with_name(f"{path.name}.{os.getpid()}.unfinished")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished.write_text(text, encoding="utf-8")
        unfinished.replace(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error


def _heeded(config: FusionConfig) -> FusionConfig:
    if not config.modalities:
        return config
    cues = {name: cue for name, cue in config.head_cues.items() if name in config.modalities}
    return dataclasses.replace(config, head_cues=cues)


def _processing(sources: Sources, config: FusionConfig, processing_s: Mapping[str, float]) -> Dict[str, float]:
    """Times by the names of the cues that there are."""
    times = {topic.name.strip("/"): processing_s.get(LEGS, 0.0) for topic in sources.scans}
    for camera in sources.cameras:
        for key in config.head_cues:
            times[f"{camera.name.strip('/')}/{key}"] = processing_s.get(key, 0.0)
    return times


def _cost(work: Mapping[str, Work], sources: Sources, recorded_s: float) -> Dict[str, Optional[float]]:
    """Seconds of the CPU, of cues of one kind the slowest's; and the share of one core that all need."""
    lasers = {topic.name.strip("/") for topic in sources.scans}
    kinds: Dict[str, List[float]] = {"laser_s": [], "image_s": [], "tracker_s": []}
    for name, done in work.items():
        kind = "tracker_s" if name == TRACKER else "laser_s" if name in lasers else "image_s"
        kinds[kind].append(done.seconds / done.times)
    means = {kind: max(times, default=None) for kind, times in kinds.items()}
    return {**means, "cpu_share": sum(done.seconds for done in work.values()) / recorded_s}


def _plain(value: Any) -> Any:
    """Settings as any reader of JSON takes them: what is infinite becomes a word."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def _is_whole(found: Any, key: str) -> bool:
    if not isinstance(found, dict) or found.get("key") != key or not isinstance(found.get("figures"), dict):
        return False
    values = [found["figures"].get(name, "") for name in (*FIGURES, *COST)]
    return all(value is None or isinstance(value, (int, float)) for value in values)


def _said(scenario: ScenarioConfig) -> str:
    """All that a scenario says, the contents of its grid included."""
    grid = scenario.room.grid
    try:
        contents = hashlib.sha256(Path(grid).read_bytes()).hexdigest() if grid else ""
    except OSError as error:
        raise ConfigError(f"{grid}: {error.strerror}") from error
    return f"{scenario!r} {contents}"


def _in_a_name(name: str) -> str:
    return "".join(letter if letter.isalnum() or letter in "-." else "_" for letter in name)
