"""From a scenario and a seed to everything that a robot would have recorded, with ground truth."""

from __future__ import annotations

import heapq
from dataclasses import dataclass
from typing import Any, Iterable, Iterator, List, Tuple

import numpy as np

from people_fusion.core.image_topics import camera_info_of
from people_fusion.core.measurements import Measurement
from people_fusion.core.poses import Pose, UncertainPose
from people_fusion.core.stamps import NANOSECONDS, from_seconds
from people_fusion.replay.track_bag import ANNOUNCEMENTS_TOPIC, DETECTIONS_TOPIC
from people_fusion.simulation import planar
from people_fusion.simulation.camera import Calibration, Cast, SimulatedCamera
from people_fusion.simulation.depth_camera import SimulatedDepthCamera
from people_fusion.simulation.detector import Detector
from people_fusion.simulation.localisation import drift, localise
from people_fusion.simulation.plan import Plan
from people_fusion.simulation.scanner import Scanner
from people_fusion.simulation.scenario import ScenarioConfig
from people_fusion.simulation.world import History, live

START_NS = 1_500_000_000 * NANOSECONDS
MAP, ODOM, FOOTPRINT, BASE = "map", "odom", "base_footprint", "base_link"
BASE_HEIGHT = 0.021  # of base_link over the floor, metres


@dataclass(frozen=True, eq=False)
class FrameTransform:
    """parent_from_child at a stamp."""

    stamp_ns: int
    parent: str
    child: str
    pose: Pose


@dataclass(frozen=True, eq=False)
class OdometryReading:
    """Pose of base_footprint in odom and its velocity in its own axes: forwards m/s, turning rad/s."""

    stamp_ns: int
    pose: Pose
    speed: float
    turn_rate: float


@dataclass(frozen=True, eq=False)
class LocalisationFix:
    """map_from_base with its covariance."""

    stamp_ns: int
    pose: UncertainPose


@dataclass(frozen=True, eq=False)
class Annotation:
    """The truth about all people at one instant, in map.

    Attributes:
        ids: (N,) from 1.
        positions: (N, 3) heads, metres, with the annotation's error.
        variance: of that error in x and in y, m^2.
        velocities: (N, 2) m/s.
        headings: (N,) where the bodies point, radians.
        occluded: (N,) no scanner has a leg in plain view.
        age_s: since the start, seconds.
    """

    stamp_ns: int
    ids: np.ndarray
    positions: np.ndarray
    variance: float
    velocities: np.ndarray
    headings: np.ndarray
    occluded: np.ndarray
    age_s: float


# Topic, arrival, and one of the types above, Scan, OccupancyGrid, a tuple of FrameTransform, Picture, DepthPicture,
# Calibration, HeadBoxes, Told or Measurement.
Event = Tuple[str, int, Any]


def simulate(scenario: ScenarioConfig, seed: int) -> Iterator[Event]:
    """Everything that is recorded, in order of arrival: (topic, arrival in nanoseconds, object).

    The objects are Scan, OccupancyGrid (/map), FrameTransform (/tf), a tuple of them (/tf_static), OdometryReading
    (/odom), LocalisationFix (/amcl_pose), Annotation (/ground_truth), of cameras Picture or DepthPicture, Calibration
    and HeadBoxes, of emulated camera cues Told and Measurement.

    Raises:
        ConfigError: the room has no place for the robot or for the people.
    """
    return Simulation(scenario, seed).events()


class Simulation:
    """One run of a scenario.

    Attributes:
        plan: what stands still.
        history: the truth.
    """

    def __init__(self, scenario: ScenarioConfig, seed: int) -> None:
        self.scenario, self._seed = scenario, seed
        self.plan = Plan(scenario.room)
        self.history: History = live(
            scenario.duration_s,
            self.plan,
            scenario.people,
            scenario.spots,
            scenario.behaviour,
            scenario.gait,
            scenario.robot,
            self._generator("people"),
        )
        self.scanners = [Scanner(config, self.plan, self._generator(config.topic)) for config in scenario.scanners]
        self.detectors = [
            Detector(config, self.plan, self._generator(f"detector {config.name}")) for config in scenario.detectors
        ]
        self._cast = cast = Cast(self.history, scenario.looks, self._generator("looks"))
        seen_by = (self.plan, cast, BASE_HEIGHT, scenario.gait.laser_height)
        self.cameras = [
            SimulatedCamera(each, *seen_by, self._generator("room"), self._generator(f"camera {each.topic}"))
            for each in scenario.cameras
        ]
        self.depth_cameras = [
            SimulatedDepthCamera(each, *seen_by, self._generator("room"), self._generator(f"camera {each.topic}"))
            for each in scenario.depth_cameras
        ]

    def events(self) -> Iterator[Event]:
        """See `simulate`. May be called once."""
        streams = [self._static()]
        streams += self._poses()
        streams += [self._arrive(s.config.topic, self._scans(s), s.config.sweep_s) for s in self.scanners]
        streams.append(self._arrive("/ground_truth", self._annotations()))
        streams += [self._pictures(camera) for camera in self.cameras]
        streams += [self._depth_pictures(camera) for camera in self.depth_cameras]
        streams += [self._detections(detector) for detector in self.detectors]
        return heapq.merge(*streams, key=lambda event: event[1])

    def _generator(self, purpose: str) -> np.random.Generator:
        """A generator of its own for each purpose, so that a change to one leaves the others' draws alone."""
        return np.random.default_rng([self._seed, *purpose.encode()])

    def _arrive(self, topic: str, items: Iterable[Any], after_s: float = 0.0, purpose: str = "") -> Iterator[Event]:
        """Items with their arrival: stamp, duration of the measurement, delay."""
        config = self.scenario.delays.get(topic, self.scenario.delay)
        rng = self._generator(f"delay {topic} {purpose}")
        arrival_ns = START_NS
        for item in items:
            delay_s = max(0.0, config.mean_s + config.std_s * float(rng.standard_normal()))
            arrival_ns = max(arrival_ns, item.stamp_ns + from_seconds(after_s + delay_s))
            yield topic, arrival_ns, item

    def _times(self, rate: float, offset_s: float = 0.0) -> np.ndarray:
        """(K,) seconds within the scenario."""
        return np.arange(offset_s, self.scenario.duration_s, 1.0 / rate)

    def _static(self) -> Iterator[Event]:
        links = [FrameTransform(START_NS, FOOTPRINT, BASE, _pose(np.zeros(3), BASE_HEIGHT))]
        for scanner in self.scenario.scanners:
            links.append(FrameTransform(START_NS, BASE, scanner.frame, _pose(scanner.mount, scanner.at[2])))
        cameras = {detector.config.frame: detector for detector in self.detectors}
        for frame, detector in cameras.items():
            links.append(FrameTransform(START_NS, BASE, frame, _pose(detector.mount, detector.config.at[2])))
        for config in [each.config for each in self.cameras] + [each.beside.config for each in self.depth_cameras]:
            links.append(FrameTransform(START_NS, BASE, config.frame, config.base_from_camera))
        yield "/tf_static", START_NS, tuple(links)
        yield "/map", START_NS, self.plan.grid(self.history.robot[0, :2])

    def _poses(self) -> List[Iterator[Event]]:
        """Streams of odometry, localisation and the transforms that they publish."""
        scenario, period_s = self.scenario, 1.0 / self.scenario.odometry_rate
        times = self._times(scenario.odometry_rate)
        truth = self.history.at("robot", times)
        odometry = drift(truth, scenario.drift, self._generator("odometry"))
        fixes, map_from_odom = localise(truth, odometry, period_s, scenario.amcl, self._generator("amcl"))
        increments = planar.compose(planar.inverse(odometry[:-1]), odometry[1:]) / period_s
        increments = np.concatenate([np.zeros((1, 3)), increments])
        stamps = [_stamp(time) for time in times]
        tolerance_ns = from_seconds(scenario.amcl.transform_tolerance_s)
        readings = (
            OdometryReading(s, _pose(p), float(v[0]), float(v[2])) for s, p, v in zip(stamps, odometry, increments)
        )
        from_odometry = (FrameTransform(s, ODOM, FOOTPRINT, _pose(p)) for s, p in zip(stamps, odometry))
        from_amcl = (FrameTransform(s + tolerance_ns, MAP, ODOM, _pose(p)) for s, p in zip(stamps, map_from_odom))
        estimates = planar.compose(map_from_odom, odometry)
        found = (
            LocalisationFix(stamps[tick], UncertainPose(_pose(estimates[tick]), scenario.amcl.covariance))
            for tick in np.flatnonzero(fixes)
        )
        return [
            self._arrive("/odom", readings),
            self._arrive("/tf", from_odometry, purpose="odometry"),
            self._arrive("/amcl_pose", found),
            self._arrive("/tf", from_amcl, -scenario.amcl.transform_tolerance_s, purpose="amcl"),
        ]

    def _scans(self, scanner: Scanner) -> Iterator[Any]:
        for time in self._times(scanner.config.rate, scanner.config.offset_s):
            yield scanner.scan(self.history, float(time), _stamp(time))

    def _pictures(self, camera: SimulatedCamera) -> Iterator[Event]:
        """Images, what is said of their camera and the truth about them."""
        config = camera.config
        times = self._times(config.rate, config.offset_s)
        pictures = (camera.picture(self.history, float(time), _stamp(time)) for time in times)
        for topic, arrival_ns, picture in self._arrive(config.image_topic, pictures):
            if config.model == "pinhole":
                yield camera_info_of(topic), arrival_ns, Calibration(picture.stamp_ns, config)
            yield topic, arrival_ns, picture
            yield config.truth_topic, arrival_ns, picture.heads

    def _depth_pictures(self, camera: SimulatedDepthCamera) -> Iterator[Event]:
        """Depth images, colour images where they are wanted, what is said of their camera and the truth about them."""
        config, beside = camera.config, camera.beside.config
        times = self._times(config.rate, config.offset_s)
        pictures = (camera.picture(self.history, float(time), _stamp(time)) for time in times)
        for topic, arrival_ns, picture in self._arrive(config.image_topic, pictures):
            calibration = Calibration(picture.stamp_ns, beside)
            yield camera_info_of(config.topic), arrival_ns, calibration
            yield topic, arrival_ns, picture
            if config.colour:
                yield camera_info_of(config.colour), arrival_ns, calibration
                yield beside.image_topic, arrival_ns, picture.colour
            yield beside.truth_topic, arrival_ns, picture.heads

    def _detections(self, detector: Detector) -> Iterator[Event]:
        config = detector.config
        images = self._times(config.rate, config.offset_s)
        # Cues of one camera share its images and their read-out.
        draws = self._generator(f"camera {config.frame}").standard_normal(len(images))
        taken = slice(config.first, None, config.every)
        delays_s = np.maximum(config.readout_s + config.readout_std_s * draws, 0.0)[taken]
        times = images[taken]
        stamps_ns = [_stamp(time) for time in times]
        for arrival_ns, item in detector.events(self.history, BASE_HEIGHT, times, stamps_ns, delays_s):
            topic = DETECTIONS_TOPIC if isinstance(item, Measurement) else ANNOUNCEMENTS_TOPIC
            yield topic, arrival_ns, item

    def _annotations(self) -> Iterator[Annotation]:
        config, history = self.scenario.ground_truth, self.history
        rng = self._generator("annotation")
        for time in self._times(config.rate):
            at = np.array([time])
            heads = history.at("heads", at)[0]
            robot = history.at("robot", at)[0]
            noise = config.annotation_std * rng.standard_normal((len(heads), 2))
            near = np.ones(len(heads), dtype=bool)
            if config.reach is not None:
                near = np.linalg.norm(heads[:, :2] - robot[:2], axis=1) <= config.reach
            visible = np.zeros(len(heads), dtype=bool)
            for scanner in self.scanners:
                visible |= scanner.sees(history, float(time))
            heads[:, :2] += noise
            yield Annotation(
                _stamp(time),
                np.flatnonzero(near) + 1,
                heads[near],
                config.annotation_std**2,
                history.at("velocities", at)[0][near],
                history.at("headings", at)[0][near],
                ~visible[near],
                float(time),
            )


def _stamp(time_s: float) -> int:
    return START_NS + from_seconds(float(time_s))


def _pose(planar_pose: np.ndarray, z: float = 0.0) -> Pose:
    """Pose in SE(3) of one in the plane."""
    x, y, yaw = map(float, planar_pose)
    return Pose.from_xy_yaw(x, y, yaw, z)
