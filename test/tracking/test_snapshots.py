"""Reprocessing rests on snapshots that nothing alters afterwards, and on covariances that stay covariances."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Sight
from people_fusion.core.poses import Pose
from people_fusion.tracking.fusion import load_config
from people_fusion.tracking.tracker import TRACKERS

FURNITURE_SOON = {"type": "bayes", "furniture_unmoved_after_s": 2.0, "furniture_after_s": 3.0}
TRACKERS_OF = {
    "default": lambda: load_config("default").tracker,
    "poschmann_t1": lambda: load_config("poschmann_t1").tracker,
    "volkhardt": lambda: load_config("volkhardt").tracker,
    "consider": lambda: kalman(shared_error="consider", lifecycle=FURNITURE_SOON),
    "kalman_over_legs": lambda: load_config("kalman_over_legs").tracker,
    "leg_mht": lambda: load_config("leg_mht").tracker,
    "particle": lambda: particle(models={"legs": {"type": "legs", "starts": True}}, walking={"stop_rate": 0.2}),
    "add": lambda: kalman(offset_stds={"legs": 0.1}, gait_s=0.1, merge_distance=0.3, lifecycle=FURNITURE_SOON),
}


def kalman(**options):
    return parse(TRACKERS.config_of("kalman", "tracker"), options)


def particle(**options):
    return parse(TRACKERS.config_of("particle", "tracker"), options)


@pytest.fixture(params=sorted(TRACKERS_OF))
def tracker(request):
    return TRACKERS.build(TRACKERS_OF[request.param]())


def busy_day(detect, count, seed=0):
    """Walkers, a chair, duplicates, false alarms, empty and late measurements, all with a shared error."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(6, 6)) * [[0.1], [0.1], [0.01], [0.01], [0.01], [0.02]]
    for step in range(count):
        time_s = 0.1 * step - (0.25 if step % 11 == 10 else 0.0)
        places = [(2.0, 0.0), (0.03 * step % 9.0 - 4.0, 0.4), (0.02, 0.05 * step % 7.0), *rng.uniform(-5, 5, (2, 2))]
        places = np.array(places)[rng.random(5) < 0.8] + rng.normal(0.0, 0.05, 2)
        turned = rng.normal(size=(len(places), 3, 3))
        measurement = detect(
            time_s,
            *places,
            sequence=step,
            shared_jacobians=np.concatenate([np.broadcast_to(np.eye(3), turned.shape), turned], axis=2),
            shared_covariance=(1.0 + 0.5 * np.sin(step / 20.0)) * axes @ axes.T,
            sight=Sight(np.zeros(2), 0.0, -np.pi, np.pi / 90, rng.uniform(1.0, 20.0, 180), 20.0),
        )
        if step % 7 == 3:
            measurement = dataclasses.replace(measurement, shared_jacobians=None, shared_covariance=None)
        yield measurement


def arrays_of(state):
    """All arrays that a state is made of."""
    if isinstance(state, np.ndarray):
        return [state]
    parts = state if isinstance(state, tuple) else vars(state).values() if dataclasses.is_dataclass(state) else ()
    return [array for part in parts for array in arrays_of(part)]


def test_nothing_alters_a_snapshot(tracker, detect):
    occupancy = np.zeros((20, 20), dtype=np.int8)
    occupancy[10, 14] = 100
    tracker.set_map(OccupancyGrid("odom", 0.5, Pose.from_xy_yaw(-5.0, -5.0, 0.0), occupancy))
    kept = []
    for measurement in busy_day(detect, 150):
        tracker.process(measurement)
        arrays = arrays_of(tracker.snapshot())
        kept.append((arrays, [array.copy() for array in arrays]))
        for array in arrays:
            array.setflags(write=False)  # whoever writes is told at once
        tracker.tracks(tracker.stamp_ns + 10**8)
    for arrays, copies in kept:
        for array, copy in zip(arrays, copies):
            np.testing.assert_array_equal(array, copy)


def test_who_alters_the_tracks_that_were_given_alters_no_state(tracker, detect):
    for measurement in busy_day(detect, 30):
        tracker.process(measurement)
    before = [array.copy() for array in arrays_of(tracker.snapshot())]
    tracks = tracker.tracks()
    for name in ("ids", "means", "covariances", "existence", "confirmed", "matched", "occluded", "ages_s"):
        getattr(tracks, name)[...] = 0
    for array, copy in zip(arrays_of(tracker.snapshot()), before):
        np.testing.assert_array_equal(array, copy)


@pytest.mark.parametrize("name", sorted(set(TRACKERS_OF) - {"leg_mht", "kalman_over_legs", "particle"}))
def test_joint_covariances_of_states_and_shared_error_stay_covariances(name, detect):
    tracker, worst = TRACKERS.build(TRACKERS_OF[name]()), 0.0
    for measurement in busy_day(detect, 600):
        tracker.process(measurement)
        state = tracker.snapshot()
        table, shared = state.table, state.shared_covariance
        for P, C in zip(table.covariances, table.shared_cross):
            np.testing.assert_allclose(P, P.T, atol=1e-12)
            joint = np.block([[P, C], [C.T, shared]])
            worst = min(worst, np.linalg.eigvalsh(joint)[0] / np.trace(joint))
    assert worst > -1e-9
