"""What rests for long is furniture: it keeps its place and is not reported, until it moves."""

from __future__ import annotations

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.tracking.tracker import TRACKERS

CHAIR = np.array([2.0, 0.0])
STD = 0.05


@pytest.fixture(params=["near_constant_velocity", "damped_velocity", "constant_velocity_3d"])
def tracker(request):
    lifecycle = {"type": "bayes", "furniture_unmoved_after_s": 5.0, "furniture_after_s": 8.0}
    options = {"lifecycle": lifecycle, "motion": {"type": request.param}, "gate": 13.8}
    return TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), options))


def stand(tracker, detect, rng, steps, place=CHAIR, begin=0):
    for step in range(begin, begin + steps):
        tracker.process(detect(0.1 * step, place + rng.normal(0.0, STD, 2), sequence=step))
    return begin + steps


def place_of(tracks, identity):
    return tracks.means[tracks.ids == identity][0]


@pytest.mark.parametrize("hidden", [False, True])
@pytest.mark.parametrize("beside", [0.15, 0.3, 0.5])
def test_furniture_keeps_its_place_while_a_walker_passes_close_by(tracker, detect, beside, hidden):
    rng = np.random.default_rng(0)
    step = stand(tracker, detect, rng, 100)
    (chair,) = tracker.tracks().ids
    assert not tracker.tracks().confirmed.any()
    walker = None
    for k in range(60):
        walk = np.array([2.0 + beside, -3.0 + 0.1 * k])
        seen = [walk + rng.normal(0.0, STD, 2)]
        if not (hidden and abs(walk[1]) < 0.45):  # two legs' breadth: the scanner sees one of them
            seen.append(CHAIR + rng.normal(0.0, STD, 2))
        tracker.process(detect(0.1 * (step + k), *seen, sequence=step + k))
        tracks = tracker.tracks()
        assert np.hypot(*(place_of(tracks, chair)[:2] - CHAIR)) < 0.1
        assert not place_of(tracks, chair)[3:].any() and chair not in tracks.ids[tracks.confirmed]
        if k == 20:
            (walker,) = tracks.ids[tracks.confirmed]
    tracks = tracker.tracks()
    assert tracks.ids[tracks.confirmed].tolist() == [walker]
    assert np.hypot(*(place_of(tracks, walker)[:2] - walk)) < 0.2


def test_furniture_that_nobody_sees_stays_uncertain_of_its_place_alone(tracker, detect):
    step = stand(tracker, detect, np.random.default_rng(1), 100)
    before = tracker.tracks()
    ahead = tracker.tracks(before.stamp_ns + 10 * 10**9)
    np.testing.assert_array_equal(ahead.means, before.means)
    assert ahead.covariances[0, 0, 0] - before.covariances[0, 0, 0] == pytest.approx(10 * 0.02**2)
    assert not ahead.covariances[0, 3:].any()
    tracker.process(detect(0.1 * step + 10.0, CHAIR, sequence=step))
    assert tracker.tracks().ids.tolist() == before.ids.tolist()


def test_who_was_taken_for_furniture_and_walks_off_is_reported(tracker, detect):
    rng = np.random.default_rng(2)
    step = stand(tracker, detect, rng, 100)
    for k in range(30):
        tracker.process(detect(0.1 * (step + k), CHAIR + [0.08 * k, 0.0] + rng.normal(0.0, STD, 2), sequence=step + k))
    tracks = tracker.tracks()
    who = np.flatnonzero(tracks.confirmed)
    assert len(who) == 1
    assert np.hypot(*(tracks.means[who[0], :2] - CHAIR - [0.08 * 29, 0.0])) < 0.15
    assert tracks.means[who[0], 3] == pytest.approx(0.8, abs=0.25)
