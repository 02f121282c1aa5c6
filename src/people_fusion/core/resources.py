"""Where the package's own files are: messages, presets and launch files, in a source tree or a catkin space."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Iterator

from people_fusion.core.errors import ConfigError

PACKAGE = "people_fusion"


def directory(name: str) -> Path:
    """A directory of the package: ``msg``, ``config`` or ``launch``.

    Looked for beside this file's source tree or under its installation prefix, then in the catkin spaces of
    CMAKE_PREFIX_PATH and the packages of ROS_PACKAGE_PATH.

    Raises:
        ConfigError: if there is none; the message lists where it was looked for.
    """
    candidates = [root / name for root in _roots()]
    for candidate in candidates:
        if candidate.is_dir():
            return candidate
    places = ", ".join(map(str, candidates)) or "no place"
    raise ConfigError(f"the directory `{name}` of {PACKAGE} is not there; looked at {places}")


def _roots() -> Iterator[Path]:
    here = Path(__file__).resolve()
    source_tree = here.parents[3]  # <tree>/src/people_fusion/core/resources.py
    if (source_tree / "package.xml").is_file():
        yield source_tree
    for parent in here.parents[3:]:  # <prefix>/lib/python3/dist-packages/people_fusion/core/resources.py
        if (parent / "share" / PACKAGE / "package.xml").is_file():
            yield parent / "share" / PACKAGE
    for entry in _paths("CMAKE_PREFIX_PATH"):
        yield entry / "share" / PACKAGE
    for entry in _paths("ROS_PACKAGE_PATH"):
        yield entry if entry.name == PACKAGE else entry / PACKAGE


def _paths(variable: str) -> Iterator[Path]:
    return (Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry)
