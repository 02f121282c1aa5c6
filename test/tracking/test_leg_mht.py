"""People from legs, and the tracker that both make."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.measurements import Measurement
from people_fusion.tracking.leg_hypotheses import APPROVED, BESIDE, FREE, LegTracks
from people_fusion.tracking.people_from_legs import People, PeopleConfig, Person, accompany, bodies, recognise
from people_fusion.tracking.tracker import TRACKERS

CONFIG = PeopleConfig(window=5, agreement=3.0)


def legs(*rows):
    """LegTracks of (id, x, y, vx, vy)."""
    rows = np.array(rows, dtype=float).reshape(-1, 5)
    stamps = np.zeros(len(rows), dtype=np.int64)
    spread = np.tile(np.diag([0.01, 0.01, 0.01, 0.01]), (len(rows), 1, 1))
    return LegTracks(rows[:, 0].astype(np.int64), rows[:, 1:], spread, stamps, stamps, stamps)


def walk(people, steps, *rows, config=CONFIG):
    """Scans, 0.1 s apart, in which legs move with their velocities."""
    for step in range(steps):
        moved = [(leg, x + 0.1 * step * vx, y + 0.1 * step * vy, vx, vy) for leg, x, y, vx, vy in rows]
        people = recognise(people, legs(*moved), step, config, hash)
    return people


def test_legs_that_are_near_and_move_alike_are_a_person():
    pair = [(1, 0.0, 0.0, 1.0, 0.0), (2, 0.3, 0.0, 0.9, 0.1)]
    assert not walk(People.nobody(), 6, *pair).persons
    people = walk(People.nobody(), 8, *pair)
    assert [person.legs for person in people.persons] == [(1, 2)]
    three = legs(*pair, (3, 0.5, 0.3, 0.0, 0.0), (4, 3.0, 0.0, 0.0, 0.0))
    assert people.kinds(three, 0, CONFIG).tolist() == [APPROVED, APPROVED, BESIDE, FREE]
    assert people.kinds(three, round(1e10), CONFIG).tolist() == [FREE] * 4


@pytest.mark.parametrize(
    "second",
    [(2, 0.8, 0.0, 1.0, 0.0), (2, 0.3, 0.0, -1.0, 0.0), (2, 0.3, 0.0, 0.0, 1.0), (2, 0.3, 0.0, 0.1, 0.0)],
    ids=["far", "against", "across", "standing"],
)
def test_other_legs_are_not(second):
    assert not walk(People.nobody(), 20, (1, 0.0, 0.0, 1.0, 0.0), second).persons


def test_a_leg_is_of_one_person_only():
    three = [(1, 0.0, 0.0, 1.0, 0.0), (2, 0.3, 0.0, 1.0, 0.0), (3, 0.6, 0.0, 1.0, 0.0)]
    assert len(walk(People.nobody(), 10, *three).persons) == 1


def test_a_person_outlives_a_leg_for_the_window_and_takes_a_new_one():
    people = walk(People.nobody(), 9, (1, 0.0, 0.0, 1.0, 0.0), (2, 0.3, 0.0, 1.0, 0.0))
    alone = walk(people, 3, (1, 0.0, 0.0, 1.0, 0.0))
    assert alone.persons[0].id == people.persons[0].id and alone.persons[0].legs == (1,)
    again = walk(alone, 1, (1, 0.0, 0.0, 1.0, 0.0), (7, 0.3, 0.0, 0.0, 0.0))
    assert again.persons[0].id == people.persons[0].id and again.persons[0].legs == (1, 7)
    assert not walk(people, CONFIG.window + 1, (1, 0.0, 0.0, 1.0, 0.0)).persons
    assert not walk(people, 1).persons


def test_who_began_with_other_legs_keeps_the_identity_for_himself():
    """A person goes on with new legs; those that he began with make another person."""
    people = walk(People.nobody(), 9, (1, 0.0, 0.0, 1.0, 0.0), (2, 0.3, 0.0, 1.0, 0.0))
    others = people._replace(persons=(people.persons[0]._replace(legs=(5, 6)),))
    both = [(1, 0.0, 0.0, 1.0, 0.0), (2, 0.3, 0.0, 1.0, 0.0), (5, 0.0, 5.0, 1.0, 0.0), (6, 0.3, 5.0, 1.0, 0.0)]
    names = [person.id for person in walk(others, 9, *both).persons]
    assert len(names) == len(set(names)) == 2


def test_a_leg_that_is_seen_takes_the_place_of_one_that_is_not():
    people = walk(People.nobody(), 9, (1, 0.0, 0.0, 1.0, 0.0), (2, 0.3, 0.0, 1.0, 0.0))
    three = legs((1, 1.0, 0.0, 1.0, 0.0), (2, 1.3, 0.0, 1.0, 0.0), (3, 1.1, 0.1, 1.0, 0.0))
    now = 10**10
    three = three._replace(seen_ns=np.array([now, now - 10**9, now]))
    assert recognise(people, three, now, CONFIG, hash).persons[0].legs == (1, 3)


@pytest.mark.parametrize("other_leg", [0.03, 0.1, 0.3])
def test_the_body_is_as_certain_as_its_covariance_says(other_leg):
    """One leg is known well, the other less; average NEES of 2000 draws, 2 dimensions."""
    rng, zero = np.random.default_rng(0), np.zeros(4)
    good, bad = np.diag([0.03**2] * 2 + [0.1**2] * 2), np.diag([other_leg**2] * 2 + [1.0**2] * 2)
    config = PeopleConfig(body_std=0.0)
    people = People((Person(1, (1, 2), 0, 0, 0),), {}, {})
    total = 0.0
    for _ in range(2000):
        half = rng.normal(scale=[config.half_step_std] * 2 + [config.half_swing_std] * 2)
        means = np.array([half + rng.multivariate_normal(zero, good), -half + rng.multivariate_normal(zero, bad)])
        tracks = LegTracks(np.array([1, 2]), means, np.array([good, bad]), zero, zero, zero)
        mean, covariance = bodies(people, tracks, config)
        total += mean[0, :2] @ np.linalg.solve(covariance[0, :2, :2], mean[0, :2])
    assert total / 2000 == pytest.approx(2.0, abs=0.2)


def test_a_person_on_one_leg_is_known_to_half_a_step():
    config = PeopleConfig(body_std=0.0)
    alone = People((Person(1, (1,), 3, 0, 0),), {}, {})
    mean, covariance = bodies(alone, legs((1, 1.0, 2.0, 0.0, 0.0)), config)
    np.testing.assert_array_equal(mean[0, :2], [1.0, 2.0])
    np.testing.assert_allclose(np.diag(covariance[0])[:2], 0.01 + config.half_step_std**2)


def accompanied(seen_ns, seconds, each_s=0.1, config=CONFIG):
    """Legs 1 and 2 of a person, last seen at these stamps, predicted scan by scan from 0 on."""
    people = People((Person(1, (1, 2), 0, 0, 0),), {}, {})
    tracks = legs((1, 0.0, 0.0, 1.0, 0.0), (2, 0.3, 0.0, 3.0, 0.0))._replace(seen_ns=np.array(seen_ns))
    hidden = np.array(seen_ns) < 0
    for _ in range(round(seconds / each_s)):
        anywhere = hidden[:, None, None] * np.eye(4)  # as a free particle's prediction
        ahead = tracks._replace(means=tracks.means + 9.0 * hidden[:, None], covariances=tracks.covariances + anywhere)
        tracks = accompany(tracks, ahead, (0, 1), people, 0, each_s, config)
        for column in ("means", "covariances"):
            np.testing.assert_array_equal(getattr(tracks, column)[~hidden], getattr(ahead, column)[~hidden])
    return tracks


def test_a_hidden_leg_stays_within_a_step_of_the_other_and_is_known_no_better():
    beside = 0.01 + 4.0 * CONFIG.half_step_std**2
    soon, later = accompanied([0, -1], 0.1), accompanied([0, -1], 5.0)
    assert 0.01 < soon.covariances[1, 0, 0] < beside <= later.covariances[1, 0, 0] < 4.0 * beside
    assert np.abs(later.means[1, :2]).max() < 0.3
    np.testing.assert_allclose(accompanied([0, -1], 10.0).covariances[1], later.covariances[1], rtol=1e-3)


def test_the_time_between_scans_does_not_tell_how_far_a_hidden_leg_may_be():
    coarse, fine = (accompanied([0, -1], 0.6, each_s).covariances[1, 0, 0] for each_s in (0.1, 0.05))
    assert coarse == pytest.approx(fine, rel=0.3)


def test_two_hidden_legs_go_on_together():
    tracks = accompanied([-1, -1], 2.0)
    np.testing.assert_allclose(tracks.means[0, 2:], tracks.means[1, 2:], atol=1e-6)
    assert 1.0 < tracks.means[0, 0] < 4.0 and np.abs(tracks.means[:, 0] - tracks.means[:, 0].mean()).max() < 0.3
    assert 0.3 < tracks.covariances[0, 0, 0] ** 0.5 < 2.0


def measurement(step, positions, **fields):
    positions = np.asarray(positions, dtype=float).reshape(-1, 2)
    return Measurement(
        round(step * 1e8), "scan", "legs", "odom", np.zeros((0, 3)), np.zeros((0, 3, 3)), np.zeros(0),
        sequence=fields.pop("sequence", int(step)), legs=positions, **fields,
    )  # fmt: skip


def tracker(**options):
    return TRACKERS.build(parse(TRACKERS.config_of("leg_mht", "tracker"), options))


def gait(step, y=0.0, speed=1.0):
    """Two legs that swing in turn, 20 cm apart across."""
    way, swing = speed * 0.1 * step, 0.2 * np.sin(0.5 * step)
    return [(way + swing, y + 0.1), (way - swing, y - 0.1)]


def test_a_walking_person_is_one_track_near_the_middle_of_the_legs():
    each = tracker()
    rng = np.random.default_rng(0)
    for step in range(60):
        each.process(measurement(step, np.array(gait(step)) + rng.normal(scale=0.02, size=(2, 2))))
    tracks = each.tracks()
    assert len(tracks) == 1 and tracks.confirmed[0] and tracks.matched[0] and tracks.existence[0] > 0.9
    np.testing.assert_allclose(tracks.means[0, :2], [5.9, 0.0], atol=0.15)
    np.testing.assert_allclose(tracks.means[0, 3], 1.0, atol=0.5)
    later = each.tracks(tracks.stamp_ns + 10**9)
    assert later.means[0, 0] > 6.3 and np.trace(later.covariances[0, :2, :2]) > np.trace(tracks.covariances[0, :2, :2])


def test_a_snapshot_is_the_whole_state():
    each, other = tracker(), tracker()
    for step in range(30):
        each.process(measurement(step, gait(step)))
    kept = each.snapshot()
    for step in range(30, 40):
        each.process(measurement(step, gait(step, y=0.5)))
    each.restore(kept)
    for step in range(40):
        each.process(measurement(step, gait(step))) if step >= 30 else None
        other.process(measurement(step, gait(step)))
    for name in ("ids", "means", "covariances", "existence"):
        np.testing.assert_array_equal(getattr(each.tracks(), name), getattr(other.tracks(), name))


def test_without_legs_there_is_nobody_and_reset_gives_no_identity_again():
    each = tracker()
    assert len(each.tracks()) == 0
    each.process(measurement(0, []))
    assert len(each.tracks()) == 0
    for step in range(1, 40):
        each.process(measurement(step, gait(step)))
    first = each.tracks().ids
    each.reset()
    for step in range(40):
        each.process(measurement(step, gait(step)))
    assert len(first) == 1 and not set(first) & set(each.tracks().ids)


def test_legs_that_are_not_finite_are_ignored():
    each = tracker()
    each.process(measurement(0, [(np.nan, 0.0), (1.0, np.inf), (1.0, 1.0)]))
    assert np.isfinite(each.leg_tracks.means).all() and len(each.leg_tracks.ids) <= 1


def test_a_late_scan_is_taken_with_the_noise_of_its_age():
    each = tracker()
    for step in range(30):
        each.process(measurement(step, gait(step)))
    stamp_ns = each.stamp_ns
    each.process(measurement(27.5, gait(27.5), sequence=100))
    assert each.stamp_ns == stamp_ns and len(each.tracks()) == 1
    assert each.counters()["measurements predicted forward"] == 1


@pytest.mark.parametrize("adaptive", [True, False])
def test_a_leg_that_was_hidden_for_two_seconds_is_the_same_leg_if_occlusion_is_adaptive(adaptive):
    each = tracker(adaptive=adaptive)
    for step in range(40):
        each.process(measurement(step, gait(step)))
    names = set(each.leg_tracks.ids)
    for step in range(40, 60):
        each.process(measurement(step, gait(step)[:1]))
    for step in range(60, 70):
        each.process(measurement(step, gait(step)))
    assert len(names) == 2 and (set(each.leg_tracks.ids) == names) == adaptive


def test_a_person_out_of_sight_is_remembered_and_not_told_of():
    each = tracker()
    for step in range(40):
        each.process(measurement(step, gait(step)))
    for step in range(40, 75):
        each.process(measurement(step, []))
    gone = each.tracks()
    assert len(gone) == 1 and not gone.confirmed[0] and gone.occluded[0]
    for step in range(75, 80):
        each.process(measurement(step, gait(step)))
    assert each.tracks().ids.tolist() == gone.ids.tolist() and each.tracks().confirmed[0]
    for step in range(80, 80 + 70):
        each.process(measurement(step, []))
    assert len(each.tracks()) == 0 and len(each.leg_tracks.ids) == 0


def test_who_sees_no_legs_does_not_say_that_there_are_none(detect):
    """A camera beside the laser: the legs are as they were, and nobody is unseen."""
    each = TRACKERS.build(parse(TRACKERS.config_of("leg_mht", "tracker"), {}))
    for step in range(40):
        each.process(detect(0.1 * step, (0.1 * step, 1.0), sequence=step))
    before = each.tracks()
    for step in range(20):
        head = detect(3.95 + 0.1 * step, cue="camera", sequence=step)
        each.process(dataclasses.replace(head, modality="head"))
    assert each.stamp_ns == before.stamp_ns
    np.testing.assert_array_equal(each.tracks().covariances, before.covariances)
    assert each.tracks().matched.all() and each.owners.tolist() == before.ids.tolist() * 2
