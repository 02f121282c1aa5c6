"""The package builds and installs with catkin alone, and runs from the install space on the system's Python."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import time
from pathlib import Path
from typing import Dict, Iterator, List

import pytest
import rosgraph
import rosmaster.master

CHECKOUT = Path(__file__).resolve().parents[2]
SYSTEM = "/usr/bin:/bin"
START_TIMEOUT_S = 60.0


@pytest.fixture(scope="module")
def install_space(tmp_path_factory: pytest.TempPathFactory) -> Path:
    workspace = tmp_path_factory.mktemp("catkin")
    (workspace / "src").mkdir()
    (workspace / "src/people_fusion").symlink_to(CHECKOUT)
    command = ["catkin_make", "-C", str(workspace), "-DPYTHON_EXECUTABLE=/usr/bin/python3", "install"]
    done = subprocess.run(command, env=environment(workspace), capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return workspace / "install"


def environment(directory: Path, path: str = SYSTEM) -> Dict[str, str]:
    """Nothing of this process's own but the ROS master."""
    kept = {name: os.environ[name] for name in ("ROS_MASTER_URI", "ROS_HOSTNAME") if name in os.environ}
    return {"PATH": path, "HOME": str(directory), "LC_ALL": "C.UTF-8", **kept}


def command(install_space: Path, arguments: List[str]) -> List[str]:
    return ["bash", "-c", f". {install_space}/setup.bash && exec {shlex.join(arguments)}"]


def run(install_space: Path, *arguments: str, path: str = SYSTEM) -> str:
    done = subprocess.run(
        command(install_space, list(arguments)),
        env=environment(install_space, path),
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_presets_are_found_beside_the_installed_package(install_space: Path) -> None:
    code = (
        "import people_fusion.msg; from people_fusion.core.resources import directory;"
        "from people_fusion.tracking.fusion import load_config; load_config('volkhardt');"
        "print(people_fusion.__file__); print(directory('config'))"
    )
    for place in run(install_space, "python3", "-c", code).split():
        assert place.startswith(str(install_space))


@pytest.mark.parametrize("name", ["people_fusion.launch", "scitos.launch", "replay.launch bag:=/recording.bag"])
def test_installed_launch_file_loads(install_space: Path, name: str) -> None:
    assert run(install_space, "roslaunch", "--nodes", "people_fusion", *name.split())


def test_rviz_file_is_installed(install_space: Path) -> None:
    assert (install_space / "share/people_fusion/config/people_fusion.rviz").is_file()


@pytest.mark.parametrize("name", ["simulate", "replay_bag", "evaluate_tracks"])
def test_offline_command_runs_where_its_libraries_are(install_space: Path, name: str) -> None:
    with_rosbags = f"{Path(sys.executable).parent}:{SYSTEM}"
    assert f"usage: {name}" in run(install_space, "rosrun", "people_fusion", name, "--help", path=with_rosbags)


@pytest.mark.parametrize("node", ["leg_cue", "people_tracker", "people_fusion"])
def test_node_starts_on_the_systems_python(install_space: Path, master: str, node: str) -> None:
    started = subprocess.Popen(
        command(install_space, ["rosrun", "people_fusion", node]),
        env={**environment(install_space), "ROS_MASTER_URI": master},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        deadline = time.monotonic() + START_TIMEOUT_S
        while f"/{node}" not in listeners(master, "/tf_static"):  # what a node does last when it starts
            assert started.poll() is None and time.monotonic() < deadline, started.communicate(timeout=5)[0]
            time.sleep(0.1)
    finally:
        started.terminate()
        output = started.communicate(timeout=20)[0]
    assert "Traceback" not in output


def listeners(master: str, topic: str) -> List[str]:
    subscribers = rosgraph.Master("/test", master_uri=master).getSystemState()[1]
    return [node for name, nodes in subscribers if name == topic for node in nodes]


@pytest.fixture(scope="module")
def master() -> Iterator[str]:
    running = rosmaster.master.Master(port=0)
    running.start()
    yield running.uri
    running.stop()
