"""Options and fixtures for all tests."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the suites that take minutes too")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    if config.getoption("--slow"):
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if item not in slow]


@pytest.fixture(scope="session")
def checkout() -> Path:
    """Root of the package's source tree."""
    return CHECKOUT


@pytest.fixture(scope="session")
def oracle_python() -> str:
    """Interpreter of the environment that holds the independent implementations."""
    python = Path(os.environ.get("PEOPLE_FUSION_ORACLE_PYTHON", CHECKOUT / ".workspace/oracles/bin/python"))
    if not python.exists():
        pytest.skip(f"{python} is not there: tools/setup --tests installs it")
    return str(python)


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Directory of the real recordings that other people made."""
    directory = Path(os.environ.get("PEOPLE_FUSION_DATA", CHECKOUT.parent / "shared/data"))
    if not directory.is_dir():
        pytest.skip(f"{directory} is not there: real recordings are not tested; PEOPLE_FUSION_DATA names their place")
    return directory
