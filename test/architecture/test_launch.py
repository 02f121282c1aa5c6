"""Every launch file, preset, scenario and rviz file that is shipped loads."""

from __future__ import annotations

import subprocess
from pathlib import Path
from typing import Any, Dict, List

import pytest
import yaml

from people_fusion.ros.composed_node import ComposedSettings
from people_fusion.ros.head_cue_node import HeadCueSettings
from people_fusion.ros.leg_cue_node import LegCueSettings
from people_fusion.ros.node import read_parameters
from people_fusion.ros.people_tracker_node import PeopleTrackerSettings
from people_fusion.ros.rgbd_cue_node import RgbdCueSettings
from people_fusion.simulation.scenario import load_scenario
from people_fusion.tracking.fusion import load_config

CHECKOUT = Path(__file__).resolve().parents[2]
CONFIG = CHECKOUT / "config"
PRESETS = sorted(CONFIG.glob("*.yaml"))
SCENARIOS = sorted((CONFIG / "scenarios").glob("*.yaml"))
BAG = "bag:=/recording.bag"
LAUNCHES: Dict[str, List[str]] = {
    "people_fusion.launch": ["/leg_cue_front", "/people_tracker"],
    "people_fusion.launch scan_rear:=/scan_rear": ["/leg_cue_front", "/leg_cue_rear", "/people_tracker"],
    "people_fusion.launch scan_front:=none scan_rear:=/r": ["/leg_cue_rear", "/people_tracker"],
    "people_fusion.launch preset:=leg_mht": ["/leg_cue_front", "/people_tracker"],
    "people_fusion.launch preset:=kalman_over_legs": ["/leg_cue_front", "/people_tracker"],
    "people_fusion.launch preset:=poschmann_t2 cameras:=[/panorama/image_raw] composed:=true": [
        "/head_cue",
        "/people_fusion",
    ],
    "people_fusion.launch preset:=particles cameras:=[/panorama/image_raw]": [
        "/head_cue",
        "/leg_cue_front",
        "/people_tracker",
    ],
    "people_fusion.launch composed:=true rviz:=true": ["/people_fusion", "/rviz"],
    "scitos.launch cameras:=[/head_xtion/rgb/image_rect_color]": ["/head_cue", "/people_fusion"],
    "people_fusion.launch preset:=poschmann_t1_l1_h1 cameras:=[/panorama/image_raw]": [
        "/head_cue",
        "/leg_cue_front",
        "/people_tracker",
    ],
    "people_fusion.launch preset:=volkhardt_cameras composed:=true cameras:=[/camera/image_raw]": [
        "/head_cue",
        "/people_fusion",
    ],
    "people_fusion.launch depths:=[/kinect/depth_registered/image_raw] colours:=[/kinect/rgb/image_raw]": [
        "/leg_cue_front",
        "/people_tracker",
        "/rgbd_cue",
    ],
    "people_fusion.launch clouds:=[/kinect/points] composed:=true": ["/people_fusion", "/rgbd_cue"],
    "scitos.launch depths:=[/head_xtion/depth/image_rect]": ["/people_fusion", "/rgbd_cue"],
    "scitos.launch": ["/people_fusion"],
    "scitos.launch preset:=volkhardt compatible:=strands composed:=false": ["/leg_cue_front", "/people_tracker"],
    f"replay.launch {BAG}": ["/leg_cue_front", "/leg_cue_rear", "/people_tracker", "/player", "/rviz"],
    f"replay.launch {BAG} rviz:=false loop:=true composed:=true": ["/people_fusion", "/player"],
    f"replay.launch {BAG} rviz:=false composed:=true depths:=[/kinect/depth_registered/image_raw/compressedDepth]": [
        "/people_fusion",
        "/player",
        "/rgbd_cue",
    ],
}

SETTINGS = {
    "/head_cue": HeadCueSettings,
    "/rgbd_cue": RgbdCueSettings,
    "/leg_cue_front": LegCueSettings,
    "/leg_cue_rear": LegCueSettings,
    "/people_tracker": PeopleTrackerSettings,
    "/people_fusion": ComposedSettings,
}


def roslaunch(*arguments: str) -> str:
    done = subprocess.run(["roslaunch", *arguments], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert not done.stderr, done.stderr
    return done.stdout


def parameters(launch: str) -> Dict[str, object]:
    return yaml.safe_load(roslaunch("--dump-params", "people_fusion", *launch.split())) or {}


def test_every_launch_file_is_tested() -> None:
    assert {path.name for path in (CHECKOUT / "launch").iterdir()} == {launch.split()[0] for launch in LAUNCHES}


@pytest.mark.parametrize("launch", LAUNCHES)
def test_launch_file_starts_its_nodes(launch: str) -> None:
    assert sorted(roslaunch("--nodes", "people_fusion", *launch.split()).split()) == LAUNCHES[launch]


def test_arguments_reach_every_node() -> None:
    found = parameters("people_fusion.launch world_frame:=world odom_frame:=none base_frame:=base scan_rear:=/r")
    for node in ("leg_cue_front", "leg_cue_rear", "people_tracker"):
        assert found[f"/{node}/frames/world"] == "world"
        assert found[f"/{node}/frames/odom"] == ""
        assert found[f"/{node}/frames/base"] == "base"
    assert found["/leg_cue_front/scans"] == ["/scan"]
    assert found["/leg_cue_rear/scans"] == ["/r"]
    found = parameters("people_fusion.launch scan_rear:=/r cameras:=[/camera/image_raw]")
    assert found["/head_cue/scans"] == ["/scan", "/r"]


def nested(parameters: Dict[str, object], node: str) -> Dict[str, Any]:
    """A node's private parameters as rospy.get_param("~") gives them."""
    tree: Dict[str, Any] = {}
    for name, value in parameters.items():
        if name.startswith(node + "/"):
            *path, key = name[len(node) + 1 :].split("/")
            branch = tree
            for part in path:
                branch = branch.setdefault(part, {})
            branch[key] = value
    return tree


@pytest.mark.parametrize("launch", LAUNCHES)
def test_every_node_accepts_its_parameters(launch: str) -> None:
    found = parameters(launch)
    for node in LAUNCHES[launch]:
        settings = SETTINGS.get(node)
        if settings is not None:
            read_parameters(settings, nested(found, node), node)


def test_composed_node_gets_both_scanners() -> None:
    assert parameters("people_fusion.launch composed:=true scan_rear:=/r")["/people_fusion/scans"] == ["/scan", "/r"]
    assert parameters("people_fusion.launch composed:=true")["/people_fusion/scans"] == ["/scan"]


def test_looping_replay_keeps_simulated_time() -> None:
    launch = f"replay.launch {BAG} rviz:=false loop:=true"
    assert parameters(launch)["/use_sim_time"] is True
    player = roslaunch("--args", "/player", "people_fusion", *launch.split())
    assert "--clock" in player and "--loop" in player


@pytest.mark.parametrize("path", PRESETS, ids=[path.stem for path in PRESETS])
def test_preset_loads(path: Path) -> None:
    load_config(path)


@pytest.mark.parametrize("path", SCENARIOS, ids=[path.stem for path in SCENARIOS])
def test_scenario_loads(path: Path) -> None:
    load_scenario(path)


def displays(entry: object) -> List[dict]:
    """All displays of an rviz file, those in groups too."""
    if isinstance(entry, dict):
        return ([entry] if {"Topic", "Marker Topic", "Image Topic"} & set(entry) else []) + displays(
            list(entry.values())
        )
    if isinstance(entry, list):
        return [display for item in entry for display in displays(item)]
    return []


def test_rviz_file_shows_what_the_nodes_publish() -> None:
    shown = displays(yaml.safe_load((CONFIG / "people_fusion.rviz").read_text(encoding="utf-8")))
    topics = {display.get("Topic") or display.get("Marker Topic") for display in shown}
    assert {"/map", "/scan_front", "/scan_rear"} <= topics
    markers = ("markers", "detection_markers", "leg_markers", "particle_markers")
    assert {f"/people_fusion/{name}" for name in markers} <= topics
    cue = "/people_fusion/debug/kinect/depth_registered/image_raw/people"
    assert {display.get("Image Topic") for display in shown} >= {cue} and f"{cue}/points" in topics
