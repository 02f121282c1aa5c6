"""Scans in which somebody has said what is a leg: labelled bags, csv files, simulated recordings.

A recipe names them; it is kept with the model that was learned from them.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Dict, Iterable, Iterator, List, NamedTuple, Optional, Tuple

import numpy as np

from people_fusion.core.config import load_yaml, parameter, parse, section
from people_fusion.core.errors import ConfigError, RecordingError
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.cues.legs import beams
from people_fusion.cues.legs.features import MIN_POINTS, NAMES, OURS, PAPER, features
from people_fusion.cues.legs.segments import Segments, segment
from people_fusion.replay import conversions
from people_fusion.replay.recording import Recording
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import Simulation

SAME_LEG_M = 0.1  # a label farther than this from a segment's middle is of something else
PREVIOUS_S = 0.5  # a scan is compared with its predecessor if that is not older
PAPER_STILL = PAPER[:13]
# Of the paper's those that tell neither how fine the scanner is nor what stands around in the room.
TRANSFERABLE = ("standard_deviation", "median_deviation", "width", "radius", "mean_curvature", *OURS)


@dataclass(frozen=True)
class SourceConfig:
    """One recording; of `bag`, `csv` and `scenario` one is given."""

    scanner: str = parameter("", "what it was recorded with; transfer is tested from scanner to scanner")
    bag: str = parameter("", "ROS 1 bag, relative to the data folder")
    scans: str = parameter("", "its topic of sensor_msgs/LaserScan")
    legs: str = parameter("", "its topic of geometry_msgs/PoseArray, one message a scan; empty: nothing is a leg")
    beyond: float = parameter(
        math.inf, "what is farther than this from all labels is no leg, metres; .inf: not everybody is labelled", 0.2
    )
    csv: str = parameter("", "folder of csv files, one a scan: angle, range (0: none), 1 where it is a leg")
    scenario: str = parameter("", "name or file of a simulated scenario")
    scanner_topic: str = parameter("", "which of the scenario's scanners; empty: the first")
    seed: int = parameter(1, "of the simulation", low=0)
    duration_s: float = parameter(60.0, "of the simulation, seconds", low=1.0)
    every: int = parameter(1, "use every nth scan", low=1)
    strides: Tuple[int, ...] = parameter((1,), "also learn from every nth beam, as a coarser scanner sees it")

    def __post_init__(self) -> None:
        if sum(map(bool, (self.bag, self.csv, self.scenario))) != 1:
            raise ConfigError("a source needs one of bag, csv and scenario")
        if self.bag and not self.scans:
            raise ConfigError("a bag needs the topic of its scans")


@dataclass(frozen=True)
class SplitConfig:
    """Which sources are learned from and which are not seen before the test."""

    train: Tuple[str, ...] = parameter((), "names of sources")
    test: Tuple[str, ...] = parameter((), "names of sources")


@dataclass(frozen=True)
class RecipeConfig:
    """Everything that a model is made of."""

    sources: Dict[str, SourceConfig] = parameter({}, "recordings by name")
    split: SplitConfig = section(SplitConfig, "one experiment that is told in detail")
    environments: Dict[str, SplitConfig] = parameter(
        {}, "the paper's experiments, with and without motion: in all of their sources the scanner stands"
    )
    features: Tuple[str, ...] = parameter(TRANSFERABLE, "what may be looked at")
    rounds: int = parameter(300, "of boosting", low=1, high=10_000)
    jump: float = parameter(0.12, "segmentation, metres", low=0.001)
    jump_beams: float = parameter(2.5, "segmentation, beam spacings", low=0.0)
    prior: float = parameter(0.1, "share of legs among segments that the probability is calibrated for", 0.001, 0.999)

    def __post_init__(self) -> None:
        unknown = set(self.features) - set(NAMES)
        if unknown:
            raise ConfigError(f"features: unknown {', '.join(sorted(unknown))}; there are {', '.join(NAMES)}")
        for name, split in [("split", self.split), *self.environments.items()]:
            missing = {*split.train, *split.test} - set(self.sources)
            if missing:
                raise ConfigError(f"{name}: no source is named {', '.join(sorted(missing))}")
        for name, split in self.environments.items():
            if not split.train or not split.test:
                raise ConfigError(f"environments/{name}: needs sources to learn from and others to be tested on")


class Examples(NamedTuple):
    """N segments that somebody has judged: features (N, F), whether they are a leg (N,), and how far that of its beams
    moved that moved the most since the scan before (N,), metres, NaN where there was none."""

    values: np.ndarray
    labels: np.ndarray
    moved: np.ndarray

    def select(self, rows: np.ndarray) -> Examples:
        """Those of a mask or of row numbers."""
        return Examples(self.values[rows], self.labels[rows], self.moved[rows])


class _Labelled(NamedTuple):
    """A scan with its legs: by beam (B,), or by position (L, 2); neither: nothing is a leg."""

    scan: Scan
    beams: Optional[np.ndarray]
    positions: Optional[np.ndarray]


def load_recipe(path: Path) -> RecipeConfig:
    """A recipe from YAML.

    Raises:
        ConfigError: names the file and the parameter that is refused.
    """
    try:
        return parse(RecipeConfig, load_yaml(path))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def examples(source: SourceConfig, recipe: RecipeConfig, data: Path) -> Examples:
    """All judged segments of one source.

    Where legs are labelled by position only, segments beside them may be legs too and are left out, unless the source
    says how far from them nothing is one.

    Raises:
        RecordingError: a file is missing or damaged.
        ConfigError: there is no such scenario.
    """
    values: List[np.ndarray] = [np.zeros((0, len(NAMES)))]
    labels: List[np.ndarray] = [np.zeros(0, dtype=bool)]
    moved: List[np.ndarray] = [np.zeros(0)]
    for stride in source.strides:
        previous: Optional[Scan] = None
        for number, entry in enumerate(_labelled(source, data)):
            scan = _thinned(entry.scan, stride)
            if number % source.every == 0:
                found = segment(scan, scan.ranges, recipe.jump, recipe.jump_beams)
                judged, is_leg = _judge(found, entry, stride, source.beyond)
                judged &= found.counts >= MIN_POINTS
                values_of_all, moved_of_all = _features(found, scan, previous)
                values.append(values_of_all[judged])
                labels.append(is_leg[judged])
                moved.append(moved_of_all[judged])
            previous = scan
    return Examples(np.concatenate(values), np.concatenate(labels), np.concatenate(moved))


def _features(found: Segments, scan: Scan, previous: Optional[Scan]) -> Tuple[np.ndarray, np.ndarray]:
    """Features (S, F) and the largest motion of a beam (S,), metres."""
    unknown = np.full(len(found), np.nan)
    if previous is None or len(previous.ranges) != len(scan.ranges) or not len(found):
        return features(found), unknown
    elapsed_s = to_seconds(scan.stamp_ns - previous.stamp_ns)
    if not 0.0 < elapsed_s < PREVIOUS_S:
        return features(found), unknown
    motion = np.nan_to_num(np.abs(scan.ranges - previous.ranges)[found.beams])
    moved = np.maximum.reduceat(motion, found.starts)
    return features(found, previous.ranges, scan.ranges, elapsed_s), moved


def _judge(found: Segments, entry: _Labelled, stride: int, beyond: float) -> Tuple[np.ndarray, np.ndarray]:
    """Which segments (S,) somebody has judged, and which of them are legs."""
    everything, nothing = np.ones(len(found), dtype=bool), np.zeros(len(found), dtype=bool)
    if entry.beams is not None:
        share = np.bincount(found.labels, entry.beams[::stride][found.beams], len(found)) / np.maximum(found.counts, 1)
        return (share > 0.8) | (share < 0.2), share > 0.5
    if entry.positions is None:
        return everything, nothing
    is_leg, is_far = nothing.copy(), np.full(len(found), math.isfinite(beyond))
    if len(found) and len(entry.positions):
        apart = np.hypot(*(found.centres[:, None] - entry.positions[None]).transpose(2, 0, 1))
        nearest = np.argmin(apart, axis=0)
        is_leg[nearest[apart.min(axis=0) < SAME_LEG_M]] = True
        is_far &= apart.min(axis=1) > beyond
    return is_leg | is_far, is_leg


def _thinned(scan: Scan, stride: int) -> Scan:
    return dataclasses.replace(scan, ranges=scan.ranges[::stride], angle_increment=scan.angle_increment * stride)


def _labelled(source: SourceConfig, data: Path) -> Iterator[_Labelled]:
    if source.bag:
        return _from_bag(source, data / source.bag)
    if source.csv:
        return _from_csv(data / source.csv)
    return _from_simulation(source)


def _from_bag(source: SourceConfig, path: Path) -> Iterator[_Labelled]:
    with Recording(path) as recording:
        scans = [conversions.scan(entry.read()) for entry in recording.messages([recording.topic(source.scans)])]
        if not source.legs:
            yield from (_Labelled(_valid(scan), None, None) for scan in scans)
            return
        told = [entry.read() for entry in recording.messages([recording.topic(source.legs)])]
    if len(told) != len(scans):
        raise RecordingError(f"{path}: {len(scans)} scans on {source.scans}, but {len(told)} labels on {source.legs}")
    for scan, message in zip(scans, told):
        positions = np.array([(pose.position.x, pose.position.y) for pose in message.poses])
        yield _Labelled(_valid(scan), None, positions.reshape(-1, 2))


def _from_csv(folder: Path) -> Iterator[_Labelled]:
    paths = sorted(folder.glob("*.csv"))
    if not paths:
        raise RecordingError(f"{folder}: no csv files")
    for number, path in enumerate(paths):
        try:
            table = np.loadtxt(path, delimiter=",", ndmin=2)
            angles, ranges, is_leg = table[:, 0], table[:, 1], table[:, 2] > 0.5
        except (ValueError, IndexError, OSError) as error:
            raise RecordingError(f"{path}: not lines of angle, range, leg: {error}") from error
        increment = float(angles[-1] - angles[0]) / max(len(angles) - 1, 1)
        # Files are single scans: none has a predecessor.
        scan = Scan(from_seconds(10.0 * number), "laser", ranges, float(angles[0]), increment, 0.0, np.inf)
        yield _Labelled(_valid(scan), is_leg, None)


def _from_simulation(source: SourceConfig) -> Iterator[_Labelled]:
    scenario = dataclasses.replace(load_scenario(source.scenario), duration_s=source.duration_s)
    simulation = Simulation(scenario, source.seed)
    topics = [scanner.config.topic for scanner in simulation.scanners]
    if source.scanner_topic and source.scanner_topic not in topics:
        raise ConfigError(f"scenario {source.scenario}: no scanner {source.scanner_topic}, only {', '.join(topics)}")
    scanner = simulation.scanners[topics.index(source.scanner_topic) if source.scanner_topic else 0]
    static = len(simulation.plan.segments) + len(simulation.plan.radii)
    for time_s in np.arange(0.0, source.duration_s, 1.0 / scanner.config.rate).tolist():
        scan = scanner.scan(simulation.history, time_s, from_seconds(time_s))
        _, hits, _ = scanner.exact(simulation.history, time_s)
        yield _Labelled(_valid(scan), hits >= static, None)


def _valid(scan: Scan) -> Scan:
    """NaN where a beam has no return."""
    ranges = beams.check(scan)
    return dataclasses.replace(
        scan, ranges=np.where(beams.hits(ranges, scan.range_min, scan.range_max), ranges, np.nan)
    )


def joined(entries: Iterable[Examples]) -> Examples:
    """Examples of several sources as one."""
    several = list(entries)
    values, labels, moved = (np.concatenate(column) for column in zip(*several))
    return Examples(values, labels, moved)


def columns(names: Tuple[str, ...]) -> np.ndarray:
    """Places of features in a row of `Examples.values`."""
    return np.array([NAMES.index(name) for name in names])
