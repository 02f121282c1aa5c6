import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.simulation import planar
from people_fusion.simulation.plan import Plan, RoomConfig
from people_fusion.simulation.scanner import Scanner, ScannerConfig, SectorConfig
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import Simulation
from people_fusion.simulation.world import History

PERFECT = ScannerConfig(noise_std=0.0, quantisation=0.0, mixed_probability=0.0, dropout=0.0)
ROOM = parse(RoomConfig, {"walls": [{"points": [[-4, -3], [5, -3], [5, 3], [-4, 3]], "closed": True}]})


def history(robot, legs=None, darkness=0.0):
    """Truth over 2 s; robot (T, 3), legs (T, N, 2, 2)."""
    steps = len(robot)
    legs = np.zeros((steps, 0, 2, 2)) if legs is None else np.asarray(legs, float)
    count = legs.shape[1]
    still = np.zeros((steps, count))
    heads = np.concatenate([legs.mean(axis=2), np.full((steps, count, 1), 1.6)], axis=2)
    return History(
        np.asarray(robot, float), heads, np.zeros((steps, count, 2)), still, legs, np.full(count, 0.06),
        np.full(count, darkness),
    )  # fmt: skip


def standing(pose=(0.0, 0.0, 0.0), legs=(), darkness=0.0):
    pairs = np.reshape(legs, (-1, 2, 2))
    return history(np.tile(pose, (100, 1)), np.tile(pairs, (100, 1, 1, 1)), darkness)


def scanner(config=PERFECT, room=ROOM, seed=0):
    return Scanner(config, Plan(room), np.random.default_rng(seed))


def points_of(scan, config, pose):
    good = np.isfinite(scan.ranges)
    in_scanner = scan.ranges[good, None] * planar.direction(scan.angles[good])
    return planar.apply(pose, planar.apply(config.mount, in_scanner))


def test_scan_is_that_of_an_s300():
    scan = scanner().scan(standing(), 0.0, 7)
    assert (len(scan.ranges), scan.stamp_ns, scan.frame_id) == (541, 7, "base_laser_link")
    np.testing.assert_allclose(np.degrees(scan.angles[[0, 270, 540]]), [-135.0, 0.0, 135.0], atol=1e-4)
    assert scan.scan_time == pytest.approx(1.0 / 12.0)
    assert scan.ranges[270] == pytest.approx(5.0 - 0.109)


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (1.0, -0.5, 2.0)])
def test_points_of_an_empty_room_lie_on_its_walls(pose):
    scan = scanner().scan(standing(pose), 0.0, 0)
    points = points_of(scan, PERFECT, np.array(pose))
    np.testing.assert_allclose(Plan(ROOM).gap(points), 0.0, atol=1e-9)


def test_points_of_an_empty_museum_are_occupied_in_its_map_but_for_what_is_unmapped():
    scenario = dataclasses.replace(load_scenario("museum"), people=(), duration_s=1.0)
    simulation = Simulation(scenario, 0)
    grid = simulation.plan.grid(simulation.history.robot[0, :2])
    found = unmapped = 0
    for config in scenario.scanners:
        exact = dataclasses.replace(config, noise_std=0.0, quantisation=0.0, mixed_probability=0.0)
        scan = Scanner(exact, simulation.plan, np.random.default_rng(0)).scan(simulation.history, 0.0, 0)
        points = points_of(scan, config, simulation.history.robot[0])
        centres = simulation.plan.centres[~simulation.plan.mapped_circles]
        off_map = (np.linalg.norm(points[:, None] - centres, axis=2) < 0.1).any(axis=1)
        cells = np.floor((points - grid.origin.translation[:2]) / grid.resolution).astype(int)
        neighbours = [grid.occupancy[cells[:, 1] + dy, cells[:, 0] + dx] for dx in (-1, 0, 1) for dy in (-1, 0, 1)]
        occupied = np.max(neighbours, axis=0) == 100
        assert occupied[~off_map].all()
        found += int((~off_map).sum())
        unmapped += int(off_map.sum())
    assert found > 300
    assert unmapped >= 3


def test_each_beam_is_cast_from_where_the_robot_is_at_its_time():
    times = np.arange(100) * 0.02
    driving = np.stack([1.0 * times, np.zeros(100), np.zeros(100)], axis=1)  # 1 m/s
    ranges = scanner().scan(history(driving), 0.5, 0).ranges
    beam = 270
    assert ranges[beam] == pytest.approx(5.0 - 0.109 - (0.5 + beam * PERFECT.time_increment), abs=1e-9)
    turning = np.stack([np.zeros(100), np.zeros(100), 0.8 * times], axis=1)
    scan = scanner().scan(history(turning), 0.5, 0)
    poses = np.stack([np.zeros(541), np.zeros(541), 0.8 * (0.5 + PERFECT.time_increment * np.arange(541))], axis=1)
    hits = planar.apply(poses, planar.apply(PERFECT.mount, scan.ranges[:, None] * planar.direction(scan.angles)))
    np.testing.assert_allclose(Plan(ROOM).gap(hits), 0.0, atol=1e-9)


def test_legs_are_seen_where_they_are():
    legs = [[[2.0, 0.1], [2.0, -0.1]]]
    scan = scanner().scan(standing(legs=legs), 0.0, 0)
    points = points_of(scan, PERFECT, np.zeros(3))
    near = points[np.linalg.norm(points - [2.0, 0.0], axis=1) < 0.3]
    distance = np.linalg.norm(near[:, None] - np.array(legs[0]), axis=2).min(axis=1)
    assert len(near) >= 10
    np.testing.assert_allclose(distance, 0.06, atol=1e-9)


def test_noise_and_quantisation_are_as_configured():
    config = dataclasses.replace(PERFECT, noise_std=0.02)
    eyes, still = scanner(config), standing()
    exact = scanner().scan(still, 0.0, 0).ranges
    errors = np.array([eyes.scan(still, 0.0, 0).ranges - exact for _ in range(50)])
    assert errors.std() == pytest.approx(0.02, rel=0.03)
    assert abs(errors.mean()) < 0.001
    coarse = scanner(dataclasses.replace(PERFECT, quantisation=0.01)).scan(still, 0.0, 0).ranges
    np.testing.assert_allclose(coarse * 100.0, np.round(coarse * 100.0), atol=1e-9)


def test_mixed_pixels_lie_between_leg_and_wall_behind_it():
    config = dataclasses.replace(PERFECT, mixed_probability=1.0, mixed_reach=1.0)
    still = standing(legs=[[[4.5, 0.15], [4.5, -0.15]]])
    exact, mixed = (scanner(c).scan(still, 0.0, 0).ranges for c in (PERFECT, config))
    changed = np.flatnonzero(np.abs(mixed - exact) > 1e-9)
    changed = changed[np.abs(changed - 270) < 20]  # not the room's corners
    assert len(changed) == 4
    low, high = np.minimum(exact, np.roll(exact, -1)), np.maximum(exact, np.roll(exact, -1))
    assert ((mixed >= low - 1e-9) & (mixed <= high + 1e-9))[changed].all()


def share_lost(darkness, distance, count=300):
    still = standing(legs=[[[distance + 0.109, 0.0], [-3.9, 0.0]]], darkness=darkness)
    eyes = scanner()
    _, hits, cosines = eyes.exact(still, 0.0)
    on_leg = (hits == 4) & (cosines > 0.97)  # four walls, then the legs
    assert on_leg.any()
    return np.mean([np.isinf(eyes.scan(still, 0.0, 0).ranges[on_leg]) for _ in range(count)])


def test_dark_trousers_swallow_beams_the_more_the_farther_they_are():
    assert share_lost(0.0, 2.06) == 0.0
    assert share_lost(0.6, 2.06) == pytest.approx(0.6, abs=0.05)
    assert share_lost(0.6, 1.0) < 0.5 < 0.65 < share_lost(0.6, 4.0)


@pytest.mark.parametrize(("word", "value"), [("inf", np.inf), ("zero", 0.0), ("nan", np.nan)])
def test_lost_beams_are_reported_as_configured(word, value):
    config = dataclasses.replace(PERFECT, dropout=1.0, lost_as=word)
    np.testing.assert_array_equal(scanner(config).scan(standing(), 0.0, 0).ranges, value)


def test_ranges_out_of_reach_follow_rep_117():
    config = dataclasses.replace(PERFECT, range_min=4.0, range_max=4.5)
    ranges = scanner(config).scan(standing(), 0.0, 0).ranges
    finite = ranges[np.isfinite(ranges)]
    assert ((finite >= 4.0) & (finite <= 4.5)).all()
    assert np.isneginf(ranges).any()
    assert np.isposinf(ranges).any()


def test_parts_of_the_robot_mask_or_shorten_their_sector():
    sectors = (SectorConfig(-2.4, -2.0), SectorConfig(2.0, 2.2, 0.3))
    scan = scanner(dataclasses.replace(PERFECT, sectors=sectors)).scan(standing(), 0.0, 0)
    assert np.isnan(scan.ranges[scan.angles <= -2.0]).all()
    np.testing.assert_array_equal(scan.ranges[(scan.angles >= 2.0) & (scan.angles <= 2.2)], 0.3)
    assert np.isfinite(scan.ranges[np.abs(scan.angles) < 1.9]).all()


def test_person_behind_another_or_a_sector_is_not_in_view():
    front = [[2.0, 0.055], [2.0, -0.055]]
    hidden, aside, behind = [[3.0, 0.06], [3.0, -0.06]], [[3.0, 1.0], [3.0, 1.2]], [[-2.0, 0.1], [-2.0, -0.1]]
    still = standing(legs=[front, hidden, aside, behind])
    assert scanner().sees(still, 0.5).tolist() == [True, False, True, False]
    blind = dataclasses.replace(PERFECT, sectors=(SectorConfig(0.2, 0.6),))
    assert scanner(blind).sees(still, 0.5).tolist() == [True, False, False, False]


def test_sweep_that_takes_longer_than_the_period_is_refused():
    with pytest.raises(ConfigError, match="longer than 1 / rate"):
        dataclasses.replace(PERFECT, time_increment=1e-3)
