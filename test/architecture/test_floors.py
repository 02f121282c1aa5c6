"""Holds the floors of the package apart by reading every import (see docs on how it works)."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path
from typing import Iterator, Set, Tuple

import pytest

PACKAGE = "people_fusion"
SOURCE = Path(__file__).resolve().parents[2] / "src" / PACKAGE
SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"

FLOORS = {
    "core": 0,
    "cues": 1, "filtering": 1, "association": 1,
    "tracking": 2,
    "evaluation": 3, "replay": 3, "simulation": 3, "training": 3,
    "ros": 4,
}  # fmt: skip
DOWN_A_ROOM = {  # on floor 3
    ("training", "simulation"), ("training", "replay"), ("training", "evaluation"),
    ("simulation", "replay"), ("simulation", "evaluation"), ("replay", "evaluation"),
}  # fmt: skip
ROS_PACKAGES = {
    "rospy", "roslib", "rosgraph", "rosbag", "rosnode", "rostopic", "rosparam", "roslaunch", "rosservice", "genpy",
    "tf", "tf2_ros", "tf2_py", "tf2_geometry_msgs", "message_filters", "diagnostic_updater", "cv_bridge",
}  # fmt: skip
CLOCKS_AND_GENERATORS = (
    "time.time", "time.monotonic", "datetime.now", "datetime.utcnow", "datetime.today",
    "np.random.seed", "np.random.rand", "np.random.randn", "np.random.normal", "np.random.uniform", "np.random.choice",
)  # fmt: skip
MODULES = sorted(SOURCE.rglob("*.py"))


def imports(path: Path, source: str) -> Iterator[str]:
    """Absolute dotted names that a module imports, each as deep as the statement tells."""
    package = (PACKAGE, *path.relative_to(SOURCE).parts[:-1])
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) + "." if node.level else ""
            yield from (f"{base}{node.module + '.' if node.module else ''}{alias.name}" for alias in node.names)


def violations(path: Path, source: str) -> Iterator[str]:
    """What a module imports although its floor must not."""
    room = path.relative_to(SOURCE).parts[0]
    for name in imports(path, source):
        parts = name.split(".")
        is_ros = parts[0] in ROS_PACKAGES or parts[0].endswith(("_msgs", "_srvs")) or parts[:2] == [PACKAGE, "msg"]
        if is_ros and room != "ros":
            yield f"{name}: only ros/ imports ROS"
        if parts[0] == PACKAGE and not is_ros and len(parts) > 1 and parts[1] in FLOORS and room != parts[1]:
            if FLOORS[parts[1]] > FLOORS[room]:
                yield f"{name}: imports point down"
            if FLOORS[parts[1]] == FLOORS[room] and (room, parts[1]) not in DOWN_A_ROOM:
                yield f"{name}: rooms of floor {FLOORS[room]} are independent"


def calls(source: str) -> Set[str]:
    return {ast.unparse(node.func) for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Call)}


def relative(path: Path) -> str:
    return str(path.relative_to(SOURCE))


def test_every_room_has_a_floor() -> None:
    rooms = {path.relative_to(SOURCE).parts[0] for path in MODULES if path.parent != SOURCE}
    assert rooms == set(FLOORS)
    assert [path.name for path in SOURCE.glob("*.py")] == ["__init__.py"]


@pytest.mark.parametrize("path", [path for path in MODULES if path.parent != SOURCE], ids=relative)
def test_imports_point_down(path: Path) -> None:
    assert list(violations(path, path.read_text(encoding="utf-8"))) == []


@pytest.mark.parametrize("path", [path for path in MODULES if path.parent != SOURCE / "ros"], ids=relative)
def test_nothing_below_ros_reads_a_clock_or_a_global_generator(path: Path) -> None:
    assert not [call for call in calls(path.read_text(encoding="utf-8")) if call.endswith(CLOCKS_AND_GENERATORS)]


def test_reading_a_clock_is_found() -> None:
    assert [call for call in calls("import time\nstart = time.time()") if call.endswith(CLOCKS_AND_GENERATORS)]


FORBIDDEN = [
    ("core/poses.py", "import rospy"),
    ("core/poses.py", "from people_fusion.cues import cue"),
    ("core/poses.py", "from people_fusion import cues"),
    ("cues/legs/legs.py", "from people_fusion.filtering.kalman import predict"),
    ("cues/legs/legs.py", "from ...filtering import kalman"),
    ("association/gates.py", "from people_fusion.tracking.tracker import Tracker"),
    ("tracking/tracker.py", "def late():\n    from people_fusion.replay import recording"),
    ("replay/recording.py", "from people_fusion.simulation import world"),
    ("evaluation/clear.py", "from people_fusion.replay import recording"),
    ("simulation/world.py", "from people_fusion.msg import TrackedPersons"),
    ("simulation/world.py", "from sensor_msgs.msg import LaserScan"),
    ("replay/recording.py", "from people_fusion.ros.topics import TRACKS"),
]


@pytest.mark.parametrize("module, statement", FORBIDDEN)
def test_forbidden_import_is_found(module: str, statement: str) -> None:
    assert list(violations(SOURCE / module, statement))


ALLOWED = [
    ("ros/bridge.py", "import rospy"),
    ("ros/bridge.py", "from people_fusion.msg import TrackedPersons"),
    ("cues/legs/legs.py", "from people_fusion.core import scans\nfrom people_fusion.cues.cue import Cue"),
    ("tracking/tracker.py", "from people_fusion.filtering import kalman"),
    ("simulation/bags.py", "from people_fusion.replay import recording"),
]


@pytest.mark.parametrize("module, statement", ALLOWED)
def test_allowed_import_is_not_reported(module: str, statement: str) -> None:
    assert list(violations(SOURCE / module, statement)) == []


def executables() -> Iterator[Tuple[Path, str]]:
    for path in sorted(SCRIPTS.iterdir()):
        yield path, path.read_text(encoding="utf-8")


def test_scripts_only_import_and_call_main() -> None:
    found = list(executables())
    assert found
    for path, source in found:
        assert path.stat().st_mode & 0o111, f"{path.name} is not executable"
        assert source.startswith("#!/usr/bin/env python3\n"), path.name
        assert len(source.splitlines()) <= 12, f"{path.name} holds more than an import and a call"
        roots = {name.split(".")[0] for name in imports(SOURCE / path.name, source)}
        assert roots <= {PACKAGE, "sys", "__future__"}, path.name


def test_opencv_is_loaded_by_those_alone_who_see_images() -> None:
    load = "from people_fusion.tracking.fusion import load_config; load_config()"
    program = f"import sys; {load}; assert 'cv2' not in sys.modules"
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
