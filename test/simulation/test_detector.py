"""Emulated camera cues: where they see people, how well, and how late."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.measurements import Measurement
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.simulation.detector import Detector, DetectorConfig, Job, work
from people_fusion.simulation.plan import Plan, RoomConfig
from people_fusion.simulation.scenario import ScenarioConfig, load_scenario
from people_fusion.simulation.simulator import BASE_HEIGHT, simulate
from people_fusion.simulation.world import STEP_S, History

HALL = {"walls": [{"points": [[-8, -6], [8, -6], [8, 6], [-8, 6]], "closed": True}]}
EXACT = {"detection_probability": 1.0, "clutter": 0.0}


def standing(places, headings, robot=(0.0, 0.0, 0.0), seconds=400.0):
    """People who stand still, 1.6 m tall."""
    steps, count = int(seconds / STEP_S), len(places)
    heads = np.column_stack([np.array(places, dtype=float), np.full(count, 1.6)])

    def still(values):
        return np.broadcast_to(np.asarray(values, dtype=float), (steps, *np.shape(values)))

    return History(
        still(robot),
        still(heads),
        still(np.zeros((count, 2))),
        still(headings),
        still(np.zeros((count, 2, 2))),
        np.full(count, 0.06),
        np.zeros(count),
    )


def detector(room=HALL, **config):
    plan = Plan(parse(RoomConfig, room))
    return Detector(parse(DetectorConfig, {**EXACT, **config}), plan, np.random.default_rng(7))


def measurements(history, count=400, **config):
    emulated = detector(**config)
    times = np.arange(count) * 0.5
    stamps = [from_seconds(float(time)) for time in times]
    events = emulated.events(history, BASE_HEIGHT, times, stamps, np.zeros(count))
    return [item for _, item in events if isinstance(item, Measurement)]


def seen(places, headings=None, robot=(0.0, 0.0, 0.0), **config):
    headings = np.full(len(places), np.pi) if headings is None else headings
    return detector(**config).sees(standing(places, headings, robot, 1.0), 0.5).tolist()


def test_field_of_view_and_reach_bound_what_is_seen():
    assert seen([(2, 0), (0, 2), (-2, 0), (6, 0.5)], field_of_view=1.5) == [True, False, False, False]
    assert seen([(2, 0), (0, 2)], robot=(0, 0, np.pi / 2), field_of_view=1.5) == [False, True]


def test_heads_walls_and_pillars_hide_heads():
    assert seen([(2, 0), (4, 0.05), (3, 2)]) == [True, False, True]
    assert seen([(2, 0)], room={"pillars": [{"at": [1, 0], "radius": 0.2}]}) == [False]
    assert seen([(2, 0)], room={"walls": [{"points": [[1, -1], [1, 1]]}]}) == [False]


def test_who_looks_away_shows_no_face():
    assert seen([(2, 0), (2, 2), (2, -2)], [np.pi, 0.0, np.pi / 2], facing=1.0) == [True, False, True]


def test_errors_are_as_large_as_the_covariance_says_and_wide_along_the_ray():
    found = measurements(standing([(3, 0)], [0.0]), at=[0.0, 0.0, 1.35], along_share=0.1, across_rad=0.02)
    exact = np.array([3.0, 0.0, 1.6 - BASE_HEIGHT - 1.35])
    errors = np.array([entry.positions[0] - exact for entry in found])
    covariances = np.array([entry.covariances[0] for entry in found])
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors).mean()
    stds = np.sqrt(np.diagonal(covariances.mean(axis=0)))
    assert nees == pytest.approx(3.0, abs=0.5)
    assert stds[0] == pytest.approx(0.3, rel=0.05)
    assert stds[1] == pytest.approx(0.06, rel=0.1)


def test_detections_and_clutter_are_as_frequent_as_they_should_be():
    history = standing([(3, 0), (0, 3)], [0.0, 0.0])
    missing = measurements(history, detection_probability=0.6)
    assert np.mean([len(entry) for entry in missing]) == pytest.approx(1.2, abs=0.12)
    cluttered = measurements(history, detection_probability=0.0, clutter=0.5)
    assert np.mean([len(entry) for entry in cluttered]) == pytest.approx(0.5, abs=0.12)
    assert max(np.linalg.norm(entry.positions[:, :2], axis=1).max(initial=0.0) for entry in cluttered) <= 5.0


def test_the_farther_and_the_more_turned_away_the_oftener_people_are_missed():
    places, headings = [(2, 0), (0, 4), (-2, 0)], [np.pi, -np.pi / 2, np.pi / 2]

    def found(**config):
        entries = measurements(standing(places, headings), count=600, detection_probability=0.8, **config)
        spots = np.concatenate([entry.positions[:, :2] for entry in entries])
        return [np.mean(np.linalg.norm(spots - place, axis=1) < 1.0) * len(spots) / 600 for place in places]

    assert found() == pytest.approx([0.8, 0.8, 0.8], abs=0.06)
    assert found(lost_by_distance=0.5, reach=4.0) == pytest.approx([0.7, 0.4, 0.7], abs=0.06)
    assert found(lost_by_yaw=1.0, facing=np.pi) == pytest.approx([0.8, 0.8, 0.6], abs=0.06)


def test_nobody_seen_is_no_evidence_that_nobody_is_there():
    (entry, *_) = measurements(standing([(30, 0)], [0.0]), count=2)
    assert len(entry) == 0
    assert entry.sight.visible(np.array([[2.0, 0.0], [0.0, 0.0]]), 0.2).tolist() == [0.0, 0.0]


def test_a_busy_cue_takes_the_newest_message_next_and_skips_the_others():
    jobs = list(work([0, 10, 20, 30, 100], [25, 5, 5, 5, 5]))
    assert jobs == [Job(0, 25), Job(None, 20), Job(25, 30), Job(30, 35), Job(100, 105)]


def test_messages_are_announced_on_arrival_and_skipped_ones_withdrawn():
    emulated = detector(name="slow", processing_s=0.25, processing_std_s=0.0)
    stamps = [from_seconds(0.1 * step) for step in range(30)]
    times = 0.1 * np.arange(30)
    events = list(emulated.events(standing([(3, 0)], [0.0]), BASE_HEIGHT, times, stamps, np.full(30, 0.02)))
    arrivals = [arrival for arrival, _ in events]
    assert arrivals == sorted(arrivals)
    told = [(arrival, item.announcement) for arrival, item in events if not isinstance(item, Measurement)]
    first = {item.order: arrival for arrival, item in told if not item.withdrawn}
    assert sorted(first) == [(stamp, "slow", 1 + row) for row, stamp in enumerate(stamps)]
    assert all(arrival == order[0] + from_seconds(0.02) for order, arrival in first.items())
    delivered = {item.order: arrival for arrival, item in events if isinstance(item, Measurement)}
    withdrawn = {item.order for _, item in told if item.withdrawn}
    assert withdrawn and not withdrawn & set(delivered) and withdrawn | set(delivered) == set(first)
    ends = sorted(delivered.values())
    assert min(np.diff(ends)) >= from_seconds(0.25)


def test_cues_of_one_camera_work_on_the_same_images():
    scenario = dataclasses.replace(load_scenario("museum_cues"), duration_s=2.0)
    told = [
        (item.announcement.cue, arrival_ns, item.announcement.stamp_ns)
        for topic, arrival_ns, item in simulate(scenario, 1)
        if topic == "/people_fusion/announcements" and not item.announcement.withdrawn
    ]
    arrivals = {cue: [entry[1:] for entry in told if entry[0] == cue] for cue, _, _ in told}
    heads = arrivals["emulated_heads"]
    assert len(heads) == 18
    assert arrivals["emulated_faces"] == heads[::2] and arrivals["emulated_upper_bodies"] == heads[1::2]


def test_cues_change_nothing_else():
    def others(name):
        scenario = dataclasses.replace(load_scenario(name), duration_s=2.0)
        events = list(simulate(scenario, 1))
        return [(topic, arrival_ns) for topic, arrival_ns, _ in events if "people_fusion" not in topic], [
            item.ranges.tobytes() for topic, _, item in events if topic.startswith("/scan")
        ]

    assert others("museum") == others("museum_cues")


def test_the_museum_with_cues_works_as_long_as_table_7_5_says():
    scenario = dataclasses.replace(load_scenario("museum_cues"), duration_s=60.0)
    delays = {}
    for topic, arrival_ns, item in simulate(scenario, 1):
        if topic == "/people_fusion/detections":
            delays.setdefault(item.cue, []).append(to_seconds(arrival_ns - item.stamp_ns))
    means = {cue: float(np.mean(values)) for cue, values in delays.items()}
    expected = {"emulated_faces": 0.110, "emulated_upper_bodies": 0.110, "emulated_heads": 0.078}
    assert means == pytest.approx(expected, abs=0.003)


def test_a_scenario_takes_from_its_base_what_it_does_not_say(tmp_path):
    (tmp_path / "hall.yaml").write_text("duration_s: 5.0\nodometry_rate: 20.0\n")
    (tmp_path / "long.yaml").write_text("base: hall\nduration_s: 50.0\n")
    loaded = load_scenario(str(tmp_path / "long.yaml"))
    assert loaded == dataclasses.replace(ScenarioConfig(), duration_s=50.0, odometry_rate=20.0)
