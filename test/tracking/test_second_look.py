"""Whom the lifecycle of Poschmann 2018, 7.3, takes for a person, and what is added to it."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.measurements import Measurement
from people_fusion.tracking.lifecycle import Evidence
from people_fusion.tracking.lifecycles.second_look import SecondLook, SecondLookConfig
from people_fusion.tracking.table import TrackTable
from people_fusion.tracking.tracker import TRACKERS

PERIOD_S = 0.1


def judged(looks, **parameters):
    """Whether a single track is a person after each of (x, confirming, testimony) in turn."""
    lifecycle = SecondLook(SecondLookConfig(**parameters))
    one = {name: np.zeros((1, *column.shape[1:]), column.dtype) for name, column in vars(table_of(lifecycle)).items()}
    table, confirmed = TrackTable(**one), []
    for step, (x, confirming, testimony) in enumerate(looks):
        stamp_ns = int(step * PERIOD_S * 1e9)
        means = np.array([[x, 0.0, 1.6, 0.0, 0.0]])
        table = dataclasses.replace(table, means=means, seen_ns=np.array([stamp_ns]))
        image = Measurement(stamp_ns, "head", "head", "map", *np.zeros((3, 0, 3)), period_s=PERIOD_S)
        evidence = Evidence(
            image, stamp_ns, PERIOD_S, np.array([True]), np.array([step == 0]), *np.zeros((2, 1)), np.ones(1),
            np.array([confirming]), np.array([testimony]),
        )  # fmt: skip
        verdict = lifecycle.judge(table, evidence)
        table = dataclasses.replace(table, memory=verdict.memory, confirmed=verdict.confirmed)
        confirmed.append(bool(verdict.confirmed[0]))
    return confirmed


def table_of(lifecycle):
    return TrackTable.empty(5, lifecycle.memory)


TWICE_SEEN = [(0.0, True, 1.0)] * 2


def test_the_second_detection_makes_a_person():
    assert judged([(0.0, True, 1.0), (0.0, False, 0.0), (0.0, True, 1.0)]) == [False, False, True]


@pytest.mark.parametrize("share, doubted", [(0.2, True), (0.6, False)])
def test_doubt_is_what_speaks_against_a_track_less_what_speaks_for_it(share, doubted):
    """A false find now and then does not make good what many images do not show."""
    speaks = [0.5 if (step * share) % 1.0 < share else -0.5 for step in range(100)]
    confirmed = judged(TWICE_SEEN + [(0.0, False, each) for each in speaks], doubt_after_s=1.0)
    assert confirmed[-1] is not doubted
    assert all(judged(TWICE_SEEN + [(0.0, False, each) for each in speaks])[1:])  # where nothing is doubted


def test_who_walks_is_a_person_whatever_shows_it():
    way = [(0.05 * step, False, 0.0) for step in range(30)]
    assert judged(way, way_m=0.8).index(True) == 17
    assert not any(judged(way))
    assert not any(judged([(0.1 * (step % 2), False, 0.0) for step in range(30)], way_m=0.8))


def test_who_is_doubted_has_to_walk_again():
    """A track that was lost to a chair is none any more, however far it came."""
    stands = [(1.5, False, -1.0)] * 20
    confirmed = judged([(0.05 * step, False, 0.0) for step in range(31)] + stands, way_m=0.8, doubt_after_s=1.0)
    assert confirmed[30] and confirmed[38] and not confirmed[-1]


@pytest.mark.parametrize("confirms", [True, False])
def test_legs_that_start_tracks_need_not_confirm_them(detect, confirms):
    """Particles: who walks is a person either way, what stands there only where legs confirm."""
    overrides = {
        "models": {"legs": {"type": "legs", "starts": True, "confirms": confirms}},
        "lifecycle": {"type": "second_look", "way_m": 0.8},
    }
    tracker = TRACKERS.build(parse(TRACKERS.config_of("particle", "tracker"), overrides))
    for step in range(30):
        tracker.process(detect(0.1 * step, (2.0, 0.0), (0.1 * step, 2.0)))
    tracks = tracker.tracks()
    order = np.argsort(tracks.means[:, 1])
    assert tracks.confirmed[order].tolist() == [confirms, True]
