"""Simulated depth cameras: depths are true without errors, and err as such sensors do."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.replay.recording import Recording
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.depth_camera import DepthCameraConfig, DepthSensing, in_shadow
from people_fusion.simulation.scenario import ScenarioConfig
from people_fusion.simulation.simulator import BASE_HEIGHT, Simulation

HALL = {"walls": [{"points": [[-6, -6], [6, -6], [6, 6], [-6, 6]], "closed": True}]}
EXACT = {"disparity_std": 0.0, "disparity_step": 0.0, "depth_std": 0.0, "edge_std": 0.0, "least_signal": 0.0}
SMALL = {"pinhole": {"width": 320, "height": 240}}


def scene(camera, places=(), room=HALL, seed=1):
    people = [{"start": list(map(float, place)), "facing": [0.0, 0.0]} for place in places]
    mapping = {"duration_s": 0.5, "room": room, "people": people, "depth_cameras": [camera], "scanners": []}
    mapping["robot"] = {"start": [0.0, 0.0, 0.0]}
    return Simulation(parse(ScenarioConfig, {**mapping, "looks": {"glance_std": 0.0}}), seed)


def taken(simulation, time_s=0.1):
    return simulation.depth_cameras[0].picture(simulation.history, time_s, 5)


def levels(picture):
    """(H, W, 3) of the base's axes over the floor, metres; the camera is level or looks down."""
    config = picture.config
    camera = config.beside.camera()
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float))
    points = (rays / rays[:, 2:]) * picture.depths.reshape(-1, 1)
    return config.beside.base_from_camera.apply(points).reshape(*picture.depths.shape, 3) + [0.0, 0.0, BASE_HEIGHT]


def test_without_errors_floor_walls_and_heads_are_where_they_are():
    picture = taken(scene({**EXACT, **SMALL, "pitch": 0.15, "baseline": 0.0}, [(2.5, 0.3)]))
    points = levels(picture)
    walls = np.abs(points[..., 0] - 6.0) < 0.02
    floor = np.abs(points[..., 2]) < 0.005
    assert walls.mean() > 0.3 and floor.mean() > 0.1
    heads = picture.heads
    ((column, row),) = picture.colour.config.camera().project(heads.positions).round().astype(int)
    before = heads.positions[0, 2] - picture.depths[row, column]
    assert 0.05 < before < 0.13  # half a head


@pytest.mark.parametrize("distance", [2.0, 5.0])
def test_errors_grow_with_the_square_of_the_distance(distance):
    config = parse(DepthCameraConfig, {"disparity_step": 0.0, "edge_std": 0.0, "depth_std": 0.0, "likeness": 0.0})
    rays = rays_of(config)
    sensing = DepthSensing(config, rays, np.random.default_rng(3))
    found = sensing.measured(np.full(rays.shape[:2], distance), np.full(rays.shape[:2], 0.6))
    expected = config.disparity_std * distance**2 / (config.baseline * config.pinhole.matrix[0, 0])
    assert np.nanstd(found) == pytest.approx(expected, rel=0.05)
    assert np.nanmean(found) == pytest.approx(distance, abs=0.1 * expected)
    assert np.isfinite(found).mean() > 0.9


def rays_of(config):
    camera = config.beside.camera()
    columns, rows = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return camera.rays(np.column_stack([columns.ravel(), rows.ravel()]).astype(float)).reshape(*columns.shape, 3)


def test_depths_come_in_steps_of_the_disparity():
    config = parse(DepthCameraConfig, {"depth_std": 0.0, "edge_std": 0.0, **SMALL})
    rays = rays_of(config)
    ramp = np.linspace(3.0, 4.0, 320)[None].repeat(240, axis=0)
    found = DepthSensing(config, rays, np.random.default_rng(0)).measured(ramp, np.ones(ramp.shape))
    strength = config.baseline * config.pinhole.matrix[0, 0]
    steps = strength / found[np.isfinite(found)] / config.disparity_step
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert len(np.unique(np.round(steps))) > 10


@given(st.integers(0, 60), st.integers(1, 60), st.floats(5.0, 30.0), st.floats(1.0, 4.9))
def test_shadow_lies_left_of_what_is_near_as_wide_as_the_disparities_differ(start, width, near, far):
    disparities = np.full((1, 160), far)
    disparities[0, 30 + start : 30 + start + width] = near
    dark = np.flatnonzero(in_shadow(disparities)[0])
    first = 30 + start - (near - far)  # where the light that passes the edge arrives
    assert set(range(int(np.ceil(first + 1e-6)), 30 + start)) <= set(dark.tolist())
    assert (dark >= first - 1e-6).all() and (dark < 30 + start).all()


def test_nothing_comes_back_from_afar_from_dark_things_and_at_grazing_incidence():
    camera = {**EXACT, **SMALL, "least_signal": 0.003, "baseline": 0.0}
    picture = taken(scene({**camera, "pitch": 0.15}))
    points = levels(scene_without_loss := taken(scene({**EXACT, **SMALL, "baseline": 0.0, "pitch": 0.15})))
    floor = np.abs(points[..., 2]) < 0.005
    lost = np.isnan(picture.depths) & ~np.isnan(scene_without_loss.depths)
    far = points[..., 0] > 4.0
    assert lost[floor & far].mean() > lost[floor & ~far].mean() + 0.1
    rays = rays_of(parse(DepthCameraConfig, camera))
    sensing = DepthSensing(parse(DepthCameraConfig, camera), rays, np.random.default_rng(0))
    wall = np.full(rays.shape[:2], 4.0)
    assert np.isnan(sensing.measured(wall, np.full(wall.shape, 0.02))).mean() > 0.9
    assert np.isnan(sensing.measured(wall, np.full(wall.shape, 0.5))).mean() < 0.01
    assert np.isnan(sensing.measured(np.full(wall.shape, 8.5), np.ones(wall.shape))).all()
    assert np.isnan(sensing.measured(np.full(wall.shape, 0.4), np.ones(wall.shape))).all()


def test_furniture_has_boards_that_cameras_see_and_scanners_do_not():
    chair = {"at": [2.0, 0.0], "yaw": 3.14159, "size": [0.5, 0.5], "board": 0.45, "back": 0.9}
    camera = {**EXACT, **SMALL, "baseline": 0.0, "pitch": 0.3}
    points = levels(taken(scene(camera, room={**HALL, "furniture": [chair]})))
    on_seat = (np.abs(points[..., 2] - 0.45) < 0.01) & (np.abs(points[..., 0] - 2.0) < 0.26)
    on_back = (points[..., 2] > 0.61) & (points[..., 2] < 0.895) & (np.abs(points[..., 0] - 2.25) < 0.03)
    assert on_seat.sum() > 300 and on_back.sum() > 300
    bare = Simulation(parse(ScenarioConfig, {"room": {**HALL, "furniture": [{**chair, "board": 0.0, "back": 0.0}]}}), 1)
    same = Simulation(parse(ScenarioConfig, {"room": {**HALL, "furniture": [chair]}}), 1)
    for one, other in zip(bare.scanners, same.scanners):
        np.testing.assert_array_equal(one.scan(bare.history, 0.1, 1).ranges, other.scan(same.history, 0.1, 1).ranges)


def test_the_same_seed_gives_the_same_image():
    one, other = (taken(scene(SMALL, [(2.5, 0.3)], seed=4)) for _ in range(2))
    assert one.depths.tobytes() == other.depths.tobytes()
    assert one.depths.tobytes() != taken(scene(SMALL, [(2.5, 0.3)], seed=5)).depths.tobytes()


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1", "compressedDepth"])
def test_recorded_as_drivers_send_it(encoding, tmp_path):
    camera = {**SMALL, "encoding": encoding, "colour": "/kinect/rgb/image_raw"}
    simulation = scene(camera, [(2.5, 0.3)])
    events = list(simulation.events())
    write_bag(tmp_path / "a.bag", events)
    topic = simulation.depth_cameras[0].config.image_topic
    depths = next(item for name, _, item in events if name == topic).depths
    with Recording(tmp_path / "a.bag") as recording:
        names = {each.name for each in recording.topics}
        assert {topic, "/kinect/depth_registered/camera_info"} <= names
        assert {"/kinect/rgb/image_raw/compressed", "/kinect/rgb/camera_info"} <= names
        message = next(iter(recording.messages([recording.topic(topic)]))).read()
    if encoding == "compressedDepth":
        pixels = cv2.imdecode(message.data[12:], cv2.IMREAD_UNCHANGED) / 1000.0
    elif encoding == "16UC1":
        pixels = message.data.view(np.uint16).reshape(240, 320) / 1000.0
    else:
        pixels = np.nan_to_num(message.data.view(np.float32).reshape(240, 320))
    np.testing.assert_allclose(pixels, np.nan_to_num(depths), atol=6e-4)


@pytest.mark.parametrize(
    "wrong", [{"pinhole": {"distortion": [0.1, 0.0, 0.0, 0.0]}}, {"min_range": 3.0, "max_range": 2.0}, {"colours": "x"}]
)
def test_impossible_cameras_are_refused(wrong):
    with pytest.raises(ConfigError):
        parse(DepthCameraConfig, wrong)
    with pytest.raises(ConfigError, match="frame of its own"):
        parse(ScenarioConfig, {"room": HALL, "depth_cameras": [{}, {}]})
