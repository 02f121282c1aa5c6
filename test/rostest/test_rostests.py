"""Runs every rostest of this directory, each with a master of its own."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

HERE = Path(__file__).parent
TIMEOUT_S = 180


LAUNCH_FILES = sorted(HERE.glob("*.test"))


def test_there_are_rostests() -> None:
    assert LAUNCH_FILES


@pytest.mark.parametrize("launch", LAUNCH_FILES, ids=[path.stem for path in LAUNCH_FILES])
def test_rostest_passes(launch: Path) -> None:
    command = ["rostest", "--text", str(launch)]
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=TIMEOUT_S, check=False
    )
    assert done.returncode == 0, done.stdout[-6000:]
    # With --text the exit status is 0 whatever the result.
    assert " * RESULT: SUCCESS" in done.stdout and " * RESULT: FAIL" not in done.stdout, done.stdout[-6000:]
    assert " * TESTS: 0" not in done.stdout, done.stdout[-6000:]
