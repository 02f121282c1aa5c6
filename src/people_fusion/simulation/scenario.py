"""Scenarios: who is where, what they do, and what the robot senses with."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, Optional, Tuple

from people_fusion.core.config import load_yaml, merge, parameter, parse, section
from people_fusion.core.errors import ConfigError
from people_fusion.core.resources import directory
from people_fusion.core.transforms import DriftConfig
from people_fusion.simulation.camera import CameraConfig, LooksConfig
from people_fusion.simulation.depth_camera import DepthCameraConfig
from people_fusion.simulation.detector import DetectorConfig
from people_fusion.simulation.gait import GaitConfig
from people_fusion.simulation.localisation import AmclConfig
from people_fusion.simulation.people import BehaviourConfig, PersonConfig, SpotConfig
from people_fusion.simulation.plan import RoomConfig
from people_fusion.simulation.robot import RobotConfig
from people_fusion.simulation.scanner import ScannerConfig

FRONT = ScannerConfig()
REAR = ScannerConfig(
    topic="/scan_rear", frame="rear_laser_link", at=(-0.28, 0.0, 0.385), yaw=3.14159265, rate=5.0, offset_s=0.013
)


@dataclass(frozen=True)
class GroundTruthConfig:
    """The annotation: heads of people, projected onto the floor."""

    rate: float = parameter(10.0, "annotations a second", low=0.1, high=50.0)
    annotation_std: float = parameter(0.0, "of x and of y, fresh in each annotation, metres", low=0.0)
    reach: Optional[float] = parameter(None, "only people who are nearer to the robot are annotated, metres", low=0.1)


@dataclass(frozen=True)
class DelayConfig:
    """How long after its measurement a message arrives: what drivers and the machine need."""

    mean_s: float = parameter(0.005, "seconds", low=0.0)
    std_s: float = parameter(0.001, "seconds; no delay is negative, no topic's messages overtake each other", low=0.0)


@dataclass(frozen=True)
class ScenarioConfig:
    """A recording that is to be made."""

    duration_s: float = parameter(60.0, "seconds", low=0.1)
    room: RoomConfig = section(RoomConfig, "what stands still")
    spots: Tuple[SpotConfig, ...] = parameter((), "places where people who `visit` stand")
    people: Tuple[PersonConfig, ...] = parameter((), "who is there")
    behaviour: BehaviourConfig = section(BehaviourConfig, "how people move")
    gait: GaitConfig = section(GaitConfig, "how they walk")
    robot: RobotConfig = section(RobotConfig, "what the robot does")
    scanners: Tuple[ScannerConfig, ...] = parameter((FRONT, REAR), "the robot's laser scanners")
    detectors: Tuple[DetectorConfig, ...] = parameter((), "emulated camera cues; no images are made")
    cameras: Tuple[CameraConfig, ...] = parameter((), "simulated cameras, whose images are recorded")
    depth_cameras: Tuple[DepthCameraConfig, ...] = parameter((), "simulated depth cameras, likewise")
    looks: LooksConfig = section(LooksConfig, "what these see of the people beyond where they are")
    odometry_rate: float = parameter(25.0, "of odometry and of both dynamic transforms, Hz", low=1.0, high=50.0)
    drift: DriftConfig = section(DriftConfig, "of the odometry")
    amcl: AmclConfig = section(AmclConfig, "the localisation")
    ground_truth: GroundTruthConfig = section(GroundTruthConfig, "the annotation")
    delay: DelayConfig = section(DelayConfig, "of all topics that `delays` does not name")
    delays: Dict[str, DelayConfig] = parameter({}, "by topic")

    def __post_init__(self) -> None:
        count = sum(person.count for person in self.people)
        if self.robot.do == "follow" and self.robot.person >= count:
            raise ConfigError(f"robot/person: there is no person {self.robot.person}, only {count}")
        frames = [camera.frame for camera in self.cameras] + [camera.frame for camera in self.depth_cameras]
        if len(set(frames)) < len(frames) or set(frames) & {detector.frame for detector in self.detectors}:
            raise ConfigError(f"cameras: each camera needs a frame of its own, got frames {frames}")


def load_scenario(name: str) -> ScenarioConfig:
    """A scenario by its name in ``config/scenarios`` or by the path of its YAML file.

    A grid's path is relative to that file. With ``base``, the name of another scenario in the same folder, a file says
    only what is different there.

    Raises:
        ConfigError: there is no such scenario, or something in it is wrong; the message names it.
    """
    path = Path(name)
    if path.suffix not in (".yaml", ".yml"):
        folder = directory("config") / "scenarios"
        path = folder / f"{name}.yaml"
        if not path.is_file():
            known = ", ".join(sorted(file.stem for file in folder.glob("*.yaml")))
            raise ConfigError(f"no scenario {name!r}; there are {known}, or give a YAML file")
    return parse(ScenarioConfig, _mapping(path))


def _mapping(path: Path) -> Any:
    """What a scenario's file says, laid over its base."""
    mapping = load_yaml(path)
    if not isinstance(mapping, dict):
        return mapping
    room = mapping.get("room")
    if isinstance(room, dict) and isinstance(room.get("grid"), str):
        mapping = {**mapping, "room": {**room, "grid": str(path.parent / room["grid"])}}
    base = mapping.pop("base", None)
    return mapping if base is None else merge(_mapping(path.parent / f"{base}.yaml"), mapping)
