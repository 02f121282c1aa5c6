"""What Poschmann 2018, 7.5, compares: configurations, and tables of them with his own figures, from a YAML file."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Dict, FrozenSet, List, NamedTuple, Optional, Sequence, Tuple

from people_fusion.core.config import load_yaml, parameter, parse
from people_fusion.core.errors import ConfigError
from people_fusion.core.resources import directory
from people_fusion.replay.replay_bag import overrides
from people_fusion.tracking.fusion import FusionConfig, load_config

LEGS = "legs"  # the leg cue's modality
VARIANT = " "  # in a configuration's name: what stands before it is what this one is a variant of


class Column(NamedTuple):
    """One figure of a table.

    Attributes:
        title: of the column.
        figure: name in the results of a run.
        scale, unit, decimals: how it is shown.
    """

    title: str
    figure: str
    scale: float
    unit: str
    decimals: int


COLUMNS: Dict[str, Dict[str, Column]] = {
    "accuracy": {
        "motp": Column("MOTP", "motp_m", 1000.0, "mm", 0),
        "mota": Column("MOTA", "mota", 100.0, "%", 1),
        "misses": Column("misses", "miss_rate", 100.0, "%", 1),
        "false_positives": Column("false pos.", "false_positive_rate", 100.0, "%", 1),
        "mismatches": Column("mismatches", "mismatch_rate", 100.0, "%", 1),
    },
    "speed": {
        "laser": Column("laser", "laser_s", 1000.0, "ms", 1),
        "image": Column("image", "image_s", 1000.0, "ms", 0),
        "tracker": Column("tracker", "tracker_s", 1000.0, "ms", 1),
        "rate": Column("rate", "rate_hz", 1.0, "Hz", 1),
        "delay": Column("delay", "delay_s", 1000.0, "ms", 0),
        "cpu": Column("CPU", "cpu_share", 100.0, "%", 1),
        "mota": Column("MOTA", "mota", 100.0, "%", 1),
    },
}
FIGURES = tuple(column.figure for columns in COLUMNS.values() for column in columns.values())


@dataclass(frozen=True)
class ConfigurationConfig:
    """A preset and what is different from it."""

    preset: str = parameter("default", "name of one in config/, or a YAML file")
    overrides: Tuple[str, ...] = parameter((), "key/path=value over the preset, the values in YAML")
    processing: Dict[str, float] = parameter(
        {}, "how long cues work on a message, seconds: `legs` on a scan, a head cue of the preset on an image", 0.0
    )

    def build(self) -> FusionConfig:
        """The preset with the overrides laid over it.

        Raises:
            ConfigError: the preset or an override is not usable, or `processing` names no cue.
        """
        config = load_config(self.preset, overrides(list(self.overrides)))
        for name in self.processing:
            if name != LEGS and name not in config.head_cues:
                known = ", ".join([LEGS, *config.head_cues])
                raise ConfigError(f"processing/{name}: there is no such cue; there are {known}")
        return config


@dataclass(frozen=True)
class RowConfig:
    """A row of a table."""

    configuration: str = parameter("", "its name")
    thesis: Dict[str, float] = parameter({}, "what Poschmann measured, by column, in the column's unit")


@dataclass(frozen=True)
class TableConfig:
    """A table of the thesis."""

    title: str = parameter("", "what it compares")
    columns: str = parameter("accuracy", "which figures it tells", choices=tuple(COLUMNS))
    rows: Tuple[RowConfig, ...] = parameter((), "configurations")

    def __post_init__(self) -> None:
        for row in self.rows:
            for name in row.thesis:
                if name not in COLUMNS[self.columns]:
                    known = ", ".join(COLUMNS[self.columns])
                    raise ConfigError(f"rows: {row.configuration}: thesis/{name}: no such column; there are {known}")

    @property
    def published(self) -> FrozenSet[str]:
        """Columns in which the thesis has any figure."""
        return frozenset(name for row in self.rows for name in row.thesis)


@dataclass(frozen=True)
class ExperimentsConfig:
    """Configurations and the tables that compare them."""

    configurations: Dict[str, ConfigurationConfig] = parameter({}, "by name")
    tables: Dict[str, TableConfig] = parameter({}, "by number")

    def __post_init__(self) -> None:
        for number, table in self.tables.items():
            for row in table.rows:
                if row.configuration not in self.configurations:
                    raise ConfigError(f"tables/{number}: there is no configuration {row.configuration!r}")

    def select(self, patterns: Sequence[str]) -> ExperimentsConfig:
        """The rows that any of the patterns TABLE or TABLE/ROW names, in which `*` stands for anything; none: all.

        Raises:
            ConfigError: a pattern names no row.
        """
        if not patterns:
            return self
        chosen: Dict[str, List[RowConfig]] = {}
        named = set()
        for number, table in self.tables.items():
            for row in table.rows:
                hits = {each for each in patterns if _names(each, number, row.configuration)}
                named |= hits
                if hits:
                    chosen.setdefault(number, []).append(row)
        for pattern in patterns:
            if pattern not in named:
                raise ConfigError(f"--only {pattern}: names no row; tables are {', '.join(self.tables)}")
        tables = {
            number: TableConfig(self.tables[number].title, self.tables[number].columns, tuple(rows))
            for number, rows in chosen.items()
        }
        used = {row.configuration for rows in chosen.values() for row in rows}
        return ExperimentsConfig({name: each for name, each in self.configurations.items() if name in used}, tables)


def load_experiments(path: Optional[Path] = None) -> ExperimentsConfig:
    """From a YAML file; None is config/experiments/poschmann.yaml.

    Raises:
        ConfigError: names the file and what of it is refused.
    """
    path = path or directory("config") / "experiments" / "poschmann.yaml"
    try:
        return parse(ExperimentsConfig, load_yaml(path))
    except ConfigError as error:
        raise ConfigError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from error


def _names(pattern: str, number: str, configuration: str) -> bool:
    table, slash, row = pattern.partition("/")
    return fnmatchcase(number, table) and (not slash or fnmatchcase(configuration, row))
