from __future__ import annotations

import dataclasses
import math
from typing import Any, Callable

import numpy as np
import pytest

pytest.importorskip("people_fusion.msg", reason="the messages are not built; tools/test builds them")

from people_fusion.core.errors import DataError
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import XY_OBSERVED, XYZ_OBSERVED, Announcement, Bodies, Measurement, Sight
from people_fusion.core.poses import Pose, UncertainPose
from people_fusion.core.scans import Scan
from people_fusion.core.tracks import Particles, Tracks
from people_fusion.core.wire import UNOBSERVED_VARIANCE
from people_fusion.ros import conversions as c

STAMP_NS = 1_500_000_000_123_456_789


def covariances(rng: np.random.Generator, count: int, size: int) -> np.ndarray:
    roots = rng.normal(size=(count, size, size))
    return roots @ roots.swapaxes(1, 2)


def assert_same(first: Any, second: Any, tolerance: float = 0.0) -> None:
    """Field by field; arrays within the tolerance."""
    for field in dataclasses.fields(first):
        a, b = getattr(first, field.name), getattr(second, field.name)
        if isinstance(a, np.ndarray):
            np.testing.assert_allclose(b, a, atol=tolerance, rtol=0, err_msg=field.name)
        elif dataclasses.is_dataclass(a):
            assert_same(a, b, tolerance)
        elif isinstance(a, float):
            assert b == pytest.approx(a, abs=tolerance), field.name
        else:
            assert b == a, field.name


@pytest.fixture
def scan() -> Scan:
    ranges = np.array([1.0, math.inf, -math.inf, 0.0, 2.5, 31.0])
    return Scan(STAMP_NS, "laser", ranges, -1.0, 0.25, 0.125, 30.0, 0.5, 0.0625)


@pytest.fixture
def measurement(rng: np.random.Generator) -> Measurement:
    spread = covariances(rng, 3, 3)
    spread[:, 2] = spread[:, :, 2] = 0.0
    sight = Sight(np.zeros(2), 0.0, -1.5, 0.25, np.array([1.0, math.nan, 30.0]), 30.0)
    return Measurement(
        STAMP_NS, "scan_front", "legs", "laser", rng.normal(size=(3, 3)), spread, np.array([0.0, 0.5, 1.0]),
        XY_OBSERVED, 0.08, 41, sight=sight, legs=np.array([[1.0, 2.0], [1.5, 2.0]]), leg_owners=np.array([2, 0]),
    )  # fmt: skip


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def tracks_of(rng: np.random.Generator, size: int, count: int = 4) -> Tracks:
    spread = covariances(rng, count, size)
    spread[:, :3, 3:] = 0.0
    spread[:, 3:, :3] = 0.0
    flags = rng.random((2, count)) < 0.5
    return Tracks(
        STAMP_NS, "map", np.arange(7, 7 + count), rng.normal(size=(count, size)), spread, rng.random(count),
        np.ones(count, dtype=bool), flags[0], flags[1], np.arange(count) + 0.25,
    )  # fmt: skip


def test_scan_returns_from_the_wire(scan: Scan) -> None:
    assert_same(scan, c.scan_from_msg(c.scan_to_msg(scan)))


def test_scan_keeps_nan(scan: Scan) -> None:
    blind = dataclasses.replace(scan, ranges=np.array([math.nan, 1.0]))
    assert np.isnan(c.scan_from_msg(c.scan_to_msg(blind)).ranges[0])


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("ranges", [], "scan without beams"),
        ("angle_min", math.nan, "scan with impossible angles"),
        ("angle_increment", 0.0, "scan with impossible angles"),
        ("range_max", math.nan, "scan with impossible reach"),
        ("range_max", 0.1, "scan with impossible reach"),
        ("scan_time", -1.0, "scan with impossible times"),
        ("time_increment", math.inf, "scan with impossible times"),
    ],
)
def test_scan_that_cannot_be_is_refused(scan: Scan, field: str, value: Any, reason: str) -> None:
    message = c.scan_to_msg(scan)
    setattr(message, field, value)
    with pytest.raises(DataError, match=reason):
        c.scan_from_msg(message)


def test_leading_slash_of_a_frame_goes(scan: Scan) -> None:
    message = c.scan_to_msg(dataclasses.replace(scan, frame_id="/laser"))
    assert c.scan_from_msg(message).frame_id == "laser"


def test_message_without_stamp_or_frame_is_refused(scan: Scan) -> None:
    for lacking, reason in (({"stamp_ns": 0}, "without a stamp"), ({"frame_id": ""}, "without a frame")):
        with pytest.raises(DataError, match=reason):
            c.scan_from_msg(c.scan_to_msg(dataclasses.replace(scan, **lacking)))


def test_grid_returns_from_the_wire() -> None:
    cells = np.array([[-1, 0, 100], [50, 1, 2]], dtype=np.int8)
    grid = OccupancyGrid("map", 0.5, Pose.from_xy_yaw(1.0, -2.0, 0.3), cells, STAMP_NS)
    assert_same(grid, c.grid_from_msg(c.grid_to_msg(grid)), 1e-12)


def test_grid_of_the_wrong_size_is_refused() -> None:
    message = c.grid_to_msg(OccupancyGrid("map", 0.5, Pose.identity(), np.zeros((2, 3), dtype=np.int8)))
    message.data = message.data[:-1]
    with pytest.raises(DataError, match="map of the wrong size"):
        c.grid_from_msg(message)


def test_localisation_returns_from_the_wire(rng: np.random.Generator) -> None:
    pose = UncertainPose(Pose.from_quaternion(rng.normal(size=3), rng.normal(size=4)), covariances(rng, 1, 6)[0])
    stamp_ns, frame_id, back = c.localisation_from_msg(c.localisation_to_msg(STAMP_NS, "map", pose))
    assert (stamp_ns, frame_id) == (STAMP_NS, "map")
    assert_same(pose, back, 1e-12)


def test_localisation_with_a_negative_variance_is_refused() -> None:
    pose = UncertainPose(Pose.identity(), np.diag([-0.1, 0.1, 0.1, 0.1, 0.1, 0.1]))
    with pytest.raises(DataError, match="negative variance"):
        c.localisation_from_msg(c.localisation_to_msg(STAMP_NS, "map", pose))


def test_measurement_returns_from_the_wire(measurement: Measurement) -> None:
    assert_same(measurement, c.measurement_from_msg(c.measurement_to_msg(measurement)), 1e-12)


def test_measurement_of_all_axes_returns_from_the_wire(measurement: Measurement, rng: np.random.Generator) -> None:
    whole = dataclasses.replace(measurement, covariances=covariances(rng, 3, 3), observed=XYZ_OBSERVED, sight=None)
    assert_same(whole, c.measurement_from_msg(c.measurement_to_msg(whole)), 1e-12)


def test_nobody_seen_returns_from_the_wire(measurement: Measurement) -> None:
    nobody = dataclasses.replace(
        measurement,
        positions=np.zeros((0, 3)),
        covariances=np.zeros((0, 3, 3)),
        confidences=np.zeros(0),
        legs=np.zeros((0, 2)),
        leg_owners=np.zeros(0, dtype=int),
    )
    assert_same(nobody, c.measurement_from_msg(c.measurement_to_msg(nobody)))


def with_bodies(measurement: Measurement) -> Measurement:
    bodies = Bodies(np.array([1.8, 1.25, 0.9]), np.array([0.02, 0.05, 0.1]), np.array([0.0, 0.75, 1.0]))
    return dataclasses.replace(measurement, bodies=bodies)


def test_heights_and_postures_return_from_the_wire(measurement: Measurement) -> None:
    sent = with_bodies(measurement)
    back = c.measurement_from_msg(c.measurement_to_msg(sent))
    assert back.bodies is not None and sent.bodies is not None
    np.testing.assert_array_equal(back.bodies, sent.bodies)


def test_who_tells_no_heights_tells_none(measurement: Measurement) -> None:
    message = c.measurement_to_msg(measurement)
    assert {person.height_std for person in message.detections} == {0.0}
    assert c.measurement_from_msg(message).bodies is None


@pytest.mark.parametrize(
    ("field", "value", "reason"),
    [
        ("height_std", 0.0, "heights of some people"),
        ("height_std", -0.1, "impossible height"),
        ("height_std", math.nan, "impossible height"),
        ("height", math.inf, "impossible height"),
        ("sitting", 1.5, "probability of sitting"),
        ("sitting", math.nan, "impossible height"),
    ],
)
def test_bodies_that_cannot_be_are_refused(measurement: Measurement, field: str, value: float, reason: str) -> None:
    message = c.measurement_to_msg(with_bodies(measurement))
    setattr(message.detections[1], field, value)
    with pytest.raises(DataError, match=reason):
        c.measurement_from_msg(message)


def test_what_a_laser_does_not_see_has_the_large_variance(measurement: Measurement) -> None:
    for person in c.measurement_to_msg(measurement).detections:
        diagonal = np.diag(np.reshape(person.pose.covariance, (6, 6)))
        assert (diagonal[2:] == UNOBSERVED_VARIANCE).all()
        assert (diagonal[:2] < 100.0).all()


def test_detection_ids_differ_between_messages(measurement: Measurement) -> None:
    second = dataclasses.replace(measurement, sequence=measurement.sequence + 1)
    persons = [*c.measurement_to_msg(measurement).detections, *c.measurement_to_msg(second).detections]
    assert len({person.detection_id for person in persons}) == 6


def set_variance(message: Any, axis: int, value: float, person: int = 1) -> None:
    covariance = list(message.detections[person].pose.covariance)
    covariance[7 * axis] = value
    message.detections[person].pose.covariance = covariance


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda m: set_variance(m, 0, -1.0), "negative variance"),
        (lambda m: set_variance(m, 1, math.nan), "covariance is not finite"),
        (lambda m: set_variance(m, 1, 1e6), "different axes"),
        (lambda m: setattr(m.detections[0].pose.pose.position, "x", math.inf), "detection is not finite"),
        (lambda m: setattr(m.detections[0], "confidence", 1.5), "not within"),
        (lambda m: setattr(m, "period", math.nan), "impossible period"),
        (lambda m: setattr(m, "cue", ""), "without a cue"),
        (lambda m: setattr(m, "leg_owners", [0]), "legs do not fit"),
        (lambda m: setattr(m, "leg_owners", [0, 3]), "legs do not fit"),
        (lambda m: setattr(m, "sight_angle_min", math.nan), "sight is not finite"),
        (lambda m: setattr(m, "sight_angle_increment", 0.0), "beams in one direction"),
        (lambda m: [set_variance(m, 0, 1e6, person) for person in range(3)], "without a place in the plane"),
    ],
)
def test_spoilt_detections_are_refused(measurement: Measurement, change: Callable[[Any], None], reason: str) -> None:
    message = c.measurement_to_msg(measurement)
    change(message)
    with pytest.raises(DataError, match=reason):
        c.measurement_from_msg(message)


@pytest.mark.parametrize("size", [5, 6])
def test_tracks_return_from_the_wire(rng: np.random.Generator, size: int) -> None:
    tracks = tracks_of(rng, size)
    assert_same(tracks, c.tracks_from_msg(c.tracks_to_msg(tracks)), 1e-9)


def test_the_pose_points_in_the_direction_of_motion_with_its_spread(rng: np.random.Generator) -> None:
    tracks = tracks_of(rng, 5, count=2)
    tracks.means[:, 3:] = [[1.0, 1.0], [0.0, 0.0]]
    tracks.covariances[:, 3:, 3:] = 0.02 * np.eye(2)
    walks, stands = (person.pose for person in c.tracks_to_msg(tracks).tracks)
    assert 2.0 * math.atan2(walks.pose.orientation.z, walks.pose.orientation.w) == pytest.approx(math.pi / 4)
    assert walks.covariance[35] == pytest.approx(0.01)
    assert (stands.pose.orientation.w, stands.covariance[35]) == (1.0, UNOBSERVED_VARIANCE)


def test_pose_array_holds_every_track(rng: np.random.Generator) -> None:
    tracks = tracks_of(rng, 6)
    message = c.poses_to_msg(tracks)
    assert message.header.frame_id == "map"
    np.testing.assert_allclose([[p.position.x, p.position.y, p.position.z] for p in message.poses], tracks.means[:, :3])


@pytest.mark.parametrize("withdrawn", [False, True])
def test_announcements_survive_the_wire(withdrawn: bool) -> None:
    announcement = Announcement(STAMP_NS, "scan_front", 41, withdrawn)
    assert c.announcement_from_msg(c.announcement_to_msg(announcement, "laser")) == announcement


@pytest.mark.parametrize("announcement", [Announcement(0, "scan_front", 1), Announcement(STAMP_NS, "", 1)])
def test_announcement_without_stamp_or_cue_is_refused(announcement: Announcement) -> None:
    with pytest.raises(DataError, match="announcement without"):
        c.announcement_from_msg(c.announcement_to_msg(announcement, "laser"))


def some_particles(rng: np.random.Generator, tracks: int, count: int) -> Particles:
    """Of numbers that float32 holds."""
    numbers = rng.normal(size=(tracks, count, 6)).astype(np.float32).astype(float)
    ids, confirmed = np.arange(7, 7 + tracks), rng.random(tracks) < 0.5
    return Particles(STAMP_NS, "map", ids, confirmed, numbers[..., :3], numbers[..., 3:5], numbers[..., 5])


@pytest.mark.parametrize("tracks, count", [(0, 500), (1, 2), (3, 50)])
def test_particles_come_back_as_they_went(rng: np.random.Generator, tracks: int, count: int) -> None:
    particles = some_particles(rng, tracks, count)
    assert_same(particles, c.particles_from_msg(c.particles_to_msg(particles)))


@pytest.mark.parametrize(
    "spoil",
    [lambda m: m.x.pop(), lambda m: m.weights.append(0.1), lambda m: m.confirmed.pop(),
     lambda m: setattr(m, "particles", 4000000000), lambda m: m.vy.__setitem__(2, math.nan)],
)  # fmt: skip
def test_particles_that_cannot_be_are_refused(rng: np.random.Generator, spoil: Callable[[Any], Any]) -> None:
    message = c.particles_to_msg(some_particles(rng, 2, 5))
    spoil(message)
    with pytest.raises(DataError, match="particles"):
        c.particles_from_msg(message)
