from __future__ import annotations

import dataclasses
from typing import Any, Dict, List, Tuple

import numpy as np
import pytest

pytest.importorskip("people_fusion.msg", reason="the messages are not built; tools/test builds them")

from visualization_msgs.msg import Marker

from people_fusion.core.measurements import XY_OBSERVED, Measurement
from people_fusion.core.tracks import NOBODY, Legs, Particles, Tracks
from people_fusion.ros import markers as m

S = 10**9


def tracks_at(
    *people: Tuple[int, float, float], stamp_ns: int = S, confirmed: bool = True, frame: str = "map"
) -> Tracks:
    """Tracks of (id, x, y) who walk along x at 1 m/s."""
    count = len(people)
    means = np.array([(x, y, 1.7, 1.0, 0.0) for _, x, y in people]).reshape(-1, 5)
    return Tracks(
        stamp_ns, frame, np.array([name for name, _, _ in people], dtype=np.int64), means,
        np.tile(0.04 * np.eye(5), (count, 1, 1)), np.full(count, 0.8), np.full(count, confirmed),
        np.ones(count, dtype=bool), np.zeros(count, dtype=bool), np.ones(count),
    )  # fmt: skip


def by_namespace(array: Any, action: int = Marker.ADD) -> Dict[str, List[Any]]:
    found: Dict[str, List[Any]] = {}
    for marker in array.markers:
        if marker.action == action:
            found.setdefault(marker.ns, []).append(marker)
    return found


def test_ellipses_hold_95_percent() -> None:
    rng = np.random.default_rng(1)
    covariance = np.array([[0.5, 0.3], [0.3, 0.4]])
    (outline,) = m.ellipses(np.array([[2.0, -1.0]]), covariance[None])
    away = outline - [2.0, -1.0]
    squared = np.einsum("ci,ij,cj->c", away, np.linalg.inv(covariance), away)
    np.testing.assert_allclose(squared, squared[0])
    np.testing.assert_allclose(outline[0], outline[-1])
    drawn = rng.multivariate_normal([0.0, 0.0], covariance, 20_000)
    inside = np.einsum("ci,ij,cj->c", drawn, np.linalg.inv(covariance), drawn) < squared[0]
    assert inside.mean() == pytest.approx(0.95, abs=0.005)


def test_each_person_has_body_name_arrow_and_a_part_of_the_lists() -> None:
    shown = by_namespace(m.TrackMarkers().update(tracks_at((3, 1.0, 2.0), (4, 5.0, 6.0))))
    assert {name: len(shown[name]) for name in (m.BODY, m.IDENTITY, m.VELOCITY, m.HEAD, m.ELLIPSE)} == {
        m.BODY: 2, m.IDENTITY: 2, m.VELOCITY: 2, m.HEAD: 1, m.ELLIPSE: 1,
    }  # fmt: skip
    assert len(shown[m.HEAD][0].points) == 2
    assert [marker.id for marker in shown[m.BODY]] == [3, 4]
    assert (shown[m.BODY][0].pose.position.x, shown[m.BODY][0].pose.position.y) == (1.0, 2.0)
    assert shown[m.VELOCITY][0].points[1].x == pytest.approx(2.0)


def test_opacity_is_existence() -> None:
    body = by_namespace(m.TrackMarkers().update(tracks_at((3, 1.0, 2.0))))[m.BODY][0]
    assert body.color.a == pytest.approx(0.8)


def test_colours_and_points_of_lists_match() -> None:
    for marker in m.TrackMarkers().update(tracks_at((3, 1.0, 2.0), (4, 5.0, 6.0))).markers:
        if marker.colors:
            assert len(marker.colors) == len(marker.points), marker.ns
        if marker.type == Marker.LINE_LIST:
            assert len(marker.points) % 2 == 0


def test_who_has_gone_is_removed_once() -> None:
    shown = m.TrackMarkers()
    shown.update(tracks_at((3, 1.0, 2.0), (4, 5.0, 6.0)))
    removed = by_namespace(shown.update(tracks_at((4, 5.0, 6.0))), Marker.DELETE)
    assert {name: [marker.id for marker in entries] for name, entries in removed.items()} == {
        m.BODY: [3], m.IDENTITY: [3], m.VELOCITY: [3],
    }  # fmt: skip
    assert not by_namespace(shown.update(tracks_at((4, 5.0, 6.0))), Marker.DELETE)


def test_last_one_gone_leaves_nothing() -> None:
    shown = m.TrackMarkers()
    added = {(marker.ns, marker.id) for marker in shown.update(tracks_at((3, 1.0, 2.0))).markers}
    array = shown.update(tracks_at())
    assert {(marker.ns, marker.id) for marker in array.markers} == added
    assert all(marker.action == Marker.DELETE for marker in array.markers)


def test_trail_follows_and_ends_after_a_while() -> None:
    shown = m.TrackMarkers()
    for step in range(200):
        array = shown.update(tracks_at((3, 0.1 * step, 0.0), stamp_ns=S + step * S // 10))
    points = by_namespace(array)[m.TRAIL][0].points
    xs = [point.x for point in points]
    assert max(xs) == pytest.approx(19.9, abs=0.2)
    assert min(xs) == pytest.approx(19.9 - m.TRAIL_S, abs=0.2)


def test_trail_begins_anew_in_another_frame() -> None:
    shown = m.TrackMarkers()
    for step in range(20):
        shown.update(tracks_at((3, float(step), 0.0), stamp_ns=S + step))
    assert m.TRAIL not in by_namespace(shown.update(tracks_at((3, 0.0, 0.0), frame="odom", stamp_ns=2 * S)))


def test_candidates_are_outlines_alone() -> None:
    shown = by_namespace(m.TrackMarkers().update(tracks_at((3, 1.0, 2.0), confirmed=False)))
    assert set(shown) == {m.CANDIDATE}


def test_clear_removes_everything() -> None:
    (marker,) = m.TrackMarkers().clear().markers
    assert marker.action == Marker.DELETEALL


def test_child_and_giant_have_bodies() -> None:
    tracks = tracks_at((3, 1.0, 2.0), (4, 1.0, 2.0))
    tracks.means[:, 2] = [-1.0, 9.0]
    for body in by_namespace(m.TrackMarkers().update(tracks))[m.BODY]:
        assert 0.0 < body.scale.z < 3.0


def measurement_of(count: int) -> Measurement:
    return Measurement(
        S, "scan", "legs", "laser", np.zeros((count, 3)), np.tile(0.01 * np.eye(3), (count, 1, 1)), np.ones(count),
        XY_OBSERVED, legs=np.ones((2 * count, 2)), leg_owners=np.repeat(np.arange(count), 2),
    )  # fmt: skip


def test_detections_and_legs_are_shown_in_the_sensor_frame() -> None:
    rings, legs = m.detection_markers(measurement_of(2)).markers
    assert rings.header.frame_id == "laser"
    assert len(legs.points) == 4
    assert len(rings.points) == 2 * 2 * m.ELLIPSE_CORNERS


def test_nobody_seen_removes_the_detections() -> None:
    assert [marker.action for marker in m.detection_markers(measurement_of(0)).markers] == [Marker.DELETE] * 2


def test_two_cues_do_not_overwrite_each_other() -> None:
    front = m.detection_markers(measurement_of(1)).markers
    rear = m.detection_markers(dataclasses.replace(measurement_of(1), cue="rear")).markers
    assert not {(a.ns, a.id) for a in front} & {(b.ns, b.id) for b in rear}


def legs_of(*owners_and_seen: Tuple[int, bool]) -> Legs:
    """Legs 11, 12, ... along x, half a metre apart."""
    count = len(owners_and_seen)
    owners = np.array([owner for owner, _ in owners_and_seen], dtype=np.int64)
    seen = np.array([is_seen for _, is_seen in owners_and_seen], dtype=bool)
    positions = np.column_stack([0.5 * np.arange(count), np.ones(count)])
    return Legs(S, "map", np.arange(11, 11 + count), positions, np.tile(0.01 * np.eye(2), (count, 1, 1)), owners, seen)


def rgb(colour: Any) -> Tuple[float, float, float]:
    return colour.r, colour.g, colour.b


def test_legs_have_the_colour_of_their_person_and_are_pale_where_hidden() -> None:
    shown = by_namespace(m.leg_markers(legs_of((3, True), (3, False), (NOBODY, True), (4, True))))
    shins = shown[m.SHIN]
    body = by_namespace(m.TrackMarkers().update(tracks_at((3, 1.0, 2.0))))[m.BODY][0]
    assert [marker.id for marker in shins] == [11, 12, 13, 14]
    assert rgb(shins[0].color) == rgb(shins[1].color) == rgb(body.color)
    assert len({rgb(marker.color) for marker in shins}) == 3
    assert [marker.color.a for marker in shins] == [1.0, m.HIDDEN, 1.0, 1.0]
    assert (shins[1].pose.position.x, shins[1].pose.position.y) == (0.5, 1.0)
    (outlines,) = shown[m.SHIN_ELLIPSE]
    assert len(outlines.points) == len(outlines.colors) == 4 * 2 * m.ELLIPSE_CORNERS
    assert {rgb(colour) for colour in outlines.colors} == {rgb(marker.color) for marker in shins}


def test_bodies_end_where_legs_are_shown() -> None:
    for on_legs, low in ((False, 0.0), (True, m.SHIN_HEIGHT)):
        (body,) = by_namespace(m.TrackMarkers(on_legs).update(tracks_at((3, 1.0, 2.0))))[m.BODY]
        assert body.pose.position.z - body.scale.z / 2 == pytest.approx(low)
        assert body.pose.position.z + body.scale.z / 2 == pytest.approx(1.7 - m.HEAD_RADIUS)


def test_legs_that_have_gone_are_removed() -> None:
    for legs in (legs_of(), legs_of((3, True))):
        array = m.leg_markers(legs)
        assert array.markers[0].action == Marker.DELETEALL
        assert by_namespace(array).keys() == ({m.SHIN, m.SHIN_ELLIPSE} if len(legs) else set())


def particles_of(*tracks: Tuple[int, bool]) -> Particles:
    """Three particles of each (id, confirmed), the first weighs most."""
    count = len(tracks)
    positions = np.arange(9.0 * count).reshape(count, 3, 3)
    weights = np.tile([0.6, 0.3, 0.1], (count, 1))
    ids, confirmed = (np.array(column) for column in zip(*tracks)) if tracks else (np.zeros(0, int), np.zeros(0, bool))
    return Particles(S, "map", ids, confirmed, positions, np.zeros((count, 3, 2)), weights)


def test_particles_have_the_colour_of_their_track_and_are_as_opaque_as_they_weigh() -> None:
    shown = by_namespace(m.particle_markers(particles_of((3, True), (4, False))))[m.PARTICLE]
    body = by_namespace(m.TrackMarkers().update(tracks_at((3, 1.0, 2.0))))[m.BODY][0]
    assert [marker.id for marker in shown] == [3, 4]
    assert {rgb(colour) for colour in shown[0].colors} == {rgb(body.color)}
    assert {rgb(colour) for colour in shown[1].colors} == {rgb(m.GREY)}
    assert [colour.a for colour in shown[0].colors] == pytest.approx([1.0, 0.5, 1.0 / 6.0])
    assert [(p.x, p.y, p.z) for p in shown[1].points] == [(9.0, 10.0, 11.0), (12.0, 13.0, 14.0), (15.0, 16.0, 17.0)]


def test_particles_that_have_gone_are_removed() -> None:
    for particles in (particles_of(), particles_of((3, True))):
        array = m.particle_markers(particles)
        assert array.markers[0].action == Marker.DELETEALL
        assert len(array.markers) == 1 + len(particles)
