"""People and robot of the shipped scenarios."""

import dataclasses
from functools import lru_cache

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.core.resources import directory
from people_fusion.simulation.scenario import ScenarioConfig, load_scenario
from people_fusion.simulation.simulator import Simulation
from people_fusion.simulation.world import STEP_S

SCENARIOS = sorted(file.stem for file in (directory("config") / "scenarios").glob("*.yaml"))
HALL = {"walls": [{"points": [[-6, -3], [6, -3], [6, 3], [-6, 3]], "closed": True}]}


@lru_cache(maxsize=None)
def run(name, duration_s=40.0):
    return Simulation(dataclasses.replace(load_scenario(name), duration_s=duration_s), seed=3)


def run_of(people, duration_s=10.0, **others):
    mapping = {"duration_s": duration_s, "room": HALL, "people": people, "robot": {"start": [-5, 2.4, 0]}, **others}
    return Simulation(parse(ScenarioConfig, mapping), seed=1)


def test_all_scenarios_of_the_issue_are_there():
    assert {"museum", "hallway", "follow", "sitting", "crowd"} <= set(SCENARIOS)


@pytest.mark.parametrize("name", SCENARIOS)
def test_heads_are_in_the_room_and_legs_outside_of_things(name):
    simulation = run(name)
    history, plan = simulation.history, simulation.plan
    heads = history.heads[::5, :, :2].reshape(-1, 2)
    lower, upper = plan.bounds
    assert ((heads > lower) & (heads < upper)).all()
    legs = history.legs[::5].reshape(-1, 2, 2).reshape(-1, 2)
    radii = np.broadcast_to(history.leg_radii[:, None], history.legs[::5].shape[:3]).ravel()
    assert (plan.gap(legs) - radii).min() > -0.03


@pytest.mark.parametrize("name", SCENARIOS)
def test_people_do_not_walk_through_each_other_or_the_robot(name):
    simulation = run(name)
    history, robot = simulation.history, simulation.scenario.robot
    bodies = history.legs.mean(axis=2)
    gaps = np.linalg.norm(bodies[:, :, None] - bodies[:, None], axis=3)
    count = bodies.shape[1]
    gaps[:, np.arange(count), np.arange(count)] = np.inf
    assert gaps.min() > 0.25
    assert np.linalg.norm(bodies - history.robot[:, None, :2], axis=2).min() > robot.radius


@pytest.mark.parametrize("name", SCENARIOS)
def test_robot_keeps_clear_of_things_and_within_its_limits(name):
    simulation = run(name, 110.0 if name == "follow" else 40.0)
    history, robot = simulation.history, simulation.scenario.robot
    assert simulation.plan.gap(history.robot[:, :2]).min() > robot.radius
    steps = np.diff(history.robot, axis=0) / STEP_S
    assert np.linalg.norm(steps[:, :2], axis=1).max() <= robot.speed + 1e-9
    assert np.abs(steps[:, 2]).max() <= robot.turn_rate + 1e-9


@pytest.mark.parametrize("name", SCENARIOS)
def test_people_move_like_people(name):
    history = run(name).history
    assert np.linalg.norm(np.diff(history.heads[..., :2], axis=0), axis=2).max() / STEP_S < 3.0
    assert np.linalg.norm(np.diff(history.legs, axis=0), axis=3).max() / STEP_S < 8.0
    assert np.linalg.norm(history.legs.mean(axis=2) - history.heads[..., :2], axis=2).max() < 0.75


def walker(speed=1.1):
    walk = {"do": "walk", "to": [[5, 0]]}
    return run_of([{"start": [-5, 0], "facing": [5, 0], "speed": speed, "activities": [walk]}])


def test_walking_legs_alternate_and_one_is_slow_while_the_other_swings():
    legs = walker().history.legs[100:350, 0, :, 0]  # along the way
    speeds = np.diff(legs, axis=0) / STEP_S
    assert speeds.max() > 2.0  # a swinging leg overtakes the body
    assert (speeds.min(axis=1) < 0.7).all()  # one always carries
    ahead = np.sign(legs[:, 0] - legs[:, 1])
    changes = np.flatnonzero(np.diff(ahead))
    assert 0.4 < np.diff(changes).mean() * STEP_S < 0.75  # time of a step
    assert np.abs(legs[:, 0] - legs[:, 1]).max() < 0.6


def test_body_is_carried_between_its_feet():
    walk = {"do": "walk", "to": [[5, 0]]}
    history = run_of([{"start": [-5, 0], "facing": [5, 0], "lean": 0.0, "activities": [walk]}]).history
    ahead = history.heads[100:300, 0, 0] - history.legs[100:300, 0, :, 0].mean(axis=1)
    assert abs(ahead.mean()) < 0.05


def test_steps_grow_with_the_speed():
    slow, fast = (np.ptp(walker(s).history.legs[100:300, 0, :, 0] @ [1.0, -1.0]) for s in (0.6, 1.2))
    assert fast > 1.2 * slow


def test_walker_reaches_the_goal_and_stays():
    history = walker().history
    np.testing.assert_allclose(history.heads[-1, 0, :2], [5.0, 0.0], atol=0.3)
    assert np.linalg.norm(history.velocities[-50:, 0], axis=1).max() < 0.2


def test_two_who_meet_head_on_pass_each_other():
    history = run_of(
        [
            {"start": [-4, 0], "facing": [4, 0], "activities": [{"do": "walk", "to": [[4, 0]]}]},
            {"start": [4, 0], "facing": [-4, 0], "activities": [{"do": "walk", "to": [[-4, 0]]}]},
        ],
        duration_s=12.0,
    ).history
    np.testing.assert_allclose(history.heads[-1, :, 0], [4.0, -4.0], atol=0.4)


def test_standing_person_sways_about_the_place_and_turns_on_the_spot():
    activities = [{"do": "stand", "for_s": 20.0}, {"do": "stand", "for_s": 60.0, "facing": [0.0, 0.0]}]
    history = run_of([{"start": [3, 0], "facing": [6, 0], "activities": activities}], duration_s=60.0).history
    middle = history.heads[:, 0, :2] - history.heads[:, 0, :2].mean(axis=0)
    assert 0.01 < middle.std(axis=0).mean() < 0.06
    assert abs(history.headings[900, 0]) < 0.3
    assert abs(abs(history.headings[-1, 0]) - np.pi) < 0.3
    np.testing.assert_allclose(history.legs[-1, 0].mean(axis=0), [3.0, 0.0], atol=0.2)


def test_sitting_person_has_legs_in_front_and_a_lower_head():
    activities = [{"do": "sit", "for_s": 5.0}, {"do": "stand"}]
    history = run_of([{"start": [3, 0], "facing": [0, 0], "activities": activities}]).history
    ahead = history.heads[:, 0, 0] - history.legs[:, 0, :, 0].mean(axis=1)
    assert 0.25 < ahead[100] < 0.5
    assert history.heads[100, 0, 2] < 0.8 * history.heads[-1, 0, 2]
    assert abs(ahead[-1]) < 0.2


def test_following_robot_keeps_near_its_person():
    history = run("follow", 110.0).history
    distance = np.linalg.norm(history.heads[250:, 0, :2] - history.robot[250:, :2], axis=1)
    assert distance.min() > 0.7
    assert distance.max() < 3.5


def test_following_robot_is_crossed_by_another_person():
    history = run("follow", 110.0).history
    robot, leader, other = history.robot[:, :2], history.heads[:, 0, :2], history.heads[:, 1, :2]
    way = leader - robot
    share = np.einsum("ti,ti->t", other - robot, way) / np.einsum("ti,ti->t", way, way)
    off = np.linalg.norm(other - robot - share[:, None] * way, axis=1)
    assert ((share > 0.2) & (share < 0.8) & (off < 0.1)).any()


def test_scenario_refuses_what_cannot_be():
    with pytest.raises(ConfigError, match="no person 1"):
        run_of([{}], robot={"do": "follow", "person": 1})
    with pytest.raises(ConfigError, match="robot/way"):
        run_of([{}], robot={"do": "drive"})
    with pytest.raises(ConfigError, match="needs `spots`"):
        run_of([{"activities": [{"do": "visit"}]}])
    with pytest.raises(ConfigError, match="no room for 200"):
        run_of([{"count": 200}])
    with pytest.raises(ConfigError, match=r"people\[0\]/activities\[0\]/do.*fly"):
        run_of([{"activities": [{"do": "fly"}]}])
    with pytest.raises(ConfigError, match=r"no scenario 'mars'.*museum"):
        load_scenario("mars")
