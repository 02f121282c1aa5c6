"""cues.heads.places: where heads in space belong in a scored image."""

from __future__ import annotations

import numpy as np
import pytest
from camera_scenes import OPTICAL, Ideal, tilted
from hypothesis import given
from hypothesis import strategies as st
from score_scenes import BOX, WINDOW, flat_layer, pyramid_of, scored

from people_fusion.core.camera_models import Panorama, PanoramaConfig
from people_fusion.core.poses import Pose
from people_fusion.cues.heads.people import heads_of_boxes
from people_fusion.cues.heads.places import Places, Seen, corners_of, places_of, scores_at, seen

SCALES = 2.0 ** (-np.arange(12) / 5.0)


def corners(boxes):
    half = 0.5 * boxes.heights[:, None] * [1.0, 1.0]
    return np.hstack([boxes.middles - half, boxes.middles + half])


def panorama(roll=0.0):
    turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(roll), -np.sin(roll)], [0.0, np.sin(roll), np.cos(roll)]])
    return Panorama(PanoramaConfig(width=3200, height=800, field=2.0 * np.pi)), turn


@given(
    tilt=st.floats(-25.0, 25.0),
    yaw=st.floats(-3.0, 3.0),
    distance=st.floats(1.2, 8.0),
    aside=st.floats(-0.4, 0.4),
    slope=st.floats(-0.25, 0.25),
)
def test_a_head_is_where_its_box_says(tilt, yaw, distance, aside, slope):
    camera, rotation = Ideal(), tilted(tilt, yaw)
    height = distance * (slope - np.tan(np.radians(tilt)))
    head = Pose.from_xy_yaw(0.0, 0.0, yaw).apply(np.array([[distance, aside * distance, height]]))
    origin = np.array([3.0, -2.0, 1.1])
    boxes = seen(scored(camera, pose=Pose(rotation, origin)), head + origin)
    if not np.isfinite(boxes.heights).all():
        assert abs(slope) > 0.1 or abs(aside) > 0.3
        return
    again = heads_of_boxes(corners(boxes), camera, rotation, BOX).positions
    assert np.linalg.norm(again - head) < (0.001 + 0.0009 * abs(tilt)) * distance


def test_before_a_level_camera_a_head_is_exactly_where_its_box_says():
    head = np.array([[3.0, -1.0, 0.2], [1.0, 0.3, -0.2]])
    boxes = seen(scored(Ideal(), pose=Pose(OPTICAL, np.zeros(3))), head)
    np.testing.assert_allclose(heads_of_boxes(corners(boxes), Ideal(), OPTICAL, BOX).positions, head, atol=1e-9)


@given(azimuth=st.floats(-np.pi, np.pi), distance=st.floats(1.0, 8.0), height=st.floats(-0.3, 0.6))
def test_all_around_a_panorama_a_head_is_where_its_box_says(azimuth, distance, height):
    camera, rotation = panorama()
    head = np.array([[distance * np.cos(azimuth), distance * np.sin(azimuth), height]])
    boxes = seen(scored(camera, pose=Pose(rotation, np.zeros(3))), head)
    assert 0.0 <= boxes.middles[0, 0] <= camera.width
    np.testing.assert_allclose(heads_of_boxes(corners(boxes), camera, rotation, BOX).positions, head, atol=1e-6)


def test_a_rolled_panorama_shows_a_head_at_its_seam_in_one_box():
    camera, rotation = panorama(0.1)
    azimuths = np.pi + np.linspace(-0.02, 0.02, 41)
    heads = 2.0 * np.column_stack([np.cos(azimuths), np.sin(azimuths), 0.1 + 0.0 * azimuths])
    boxes = seen(scored(camera, pose=Pose(rotation, np.zeros(3))), heads)
    distance = np.minimum(boxes.middles[:, 0], camera.width - boxes.middles[:, 0])
    assert (distance < 0.03 * camera.width).all() and np.isfinite(boxes.heights).all()


def test_heads_behind_and_beside_the_camera_are_not_seen():
    heads = np.array([[2.0, 0.0, 0.0], [-2.0, 0.0, 0.0], [2.0, 2.0, 0.0], [2.0, 0.0, 1.5], [np.nan, 0.0, 0.0]])
    boxes = seen(scored(Ideal(), pose=Pose(OPTICAL, np.zeros(3))), heads)
    assert np.isfinite(boxes.heights).tolist() == [True, False, False, False, False]
    assert np.isfinite(boxes.middles).all(axis=1).tolist() == [True, False, False, False, False]
    assert boxes.heights[0] == pytest.approx(525.0 * 0.24 / 2.0, rel=1e-3)


@given(
    layer=st.integers(0, len(SCALES) - 1), down=st.floats(0.0, 1.0), across=st.floats(0.0, 1.0), wraps=st.booleans()
)
def test_a_window_is_the_place_of_its_own_box(layer, down, across, wraps):
    camera, beyond = (panorama()[0], 700) if wraps else (Ideal(), 0)
    scores = scored(camera, pyramid_of(camera, SCALES, beyond), beyond=beyond)
    rows, cols = np.array(scores.layers[layer].scores.shape) - 1
    place = Places(np.array([layer]), np.array([down * rows]), np.array([across * cols]))
    (box,) = corners_of(scores, place)
    found = places_of(scores, Seen(0.5 * (box[None, :2] + box[2:]), np.array([box[3] - box[1]])))
    assert found.layers[0] == layer
    assert found.rows[0] == pytest.approx(place.rows[0], abs=1e-6)
    turn = camera.width * scores.layers[layer].scale[0] / WINDOW.cell if wraps else 1e9
    offset = (found.cols[0] - place.cols[0] + 0.5 * turn) % turn - 0.5 * turn
    assert offset == pytest.approx(0.0, abs=1e-6)


@given(
    azimuth=st.floats(-np.pi, np.pi), distance=st.floats(1.5, 4.2), height=st.floats(-0.2, 0.3), wraps=st.booleans()
)
def test_one_peak_is_hit_by_the_head_that_belongs_there(azimuth, distance, height, wraps):
    camera, rotation, beyond = (*panorama(), 700) if wraps else (Ideal(), OPTICAL, 0)
    azimuth = azimuth if wraps else 0.1 * azimuth
    head = distance * np.array([[np.cos(azimuth), np.sin(azimuth), height]])
    pose = Pose(rotation, np.zeros(3))
    layers = pyramid_of(camera, SCALES, beyond)
    scores = scored(camera, layers, pose, beyond)
    place = places_of(scores, seen(scores, head))
    if place.layers[0] < 0:
        assert distance > 4.0 or abs(height) > 0.15
        return
    rows, cols = np.round(place.rows[0]).astype(int), np.round(place.cols[0]).astype(int)
    peak = layers[place.layers[0]].scores
    peak[rows, cols] = 1.0
    share = (1.0 - abs(place.rows[0] - rows)) * (1.0 - abs(place.cols[0] - cols))
    assert scores_at(scores, *seen(scores, head))[0] == pytest.approx(share, abs=1e-5)
    others = head * [[1.5, 1.5, 1.5]]
    turned = np.column_stack([head[:, 0] - 0.6 * head[:, 1], head[:, 1] + 0.6 * head[:, 0], head[:, 2]])
    assert (np.nan_to_num(scores_at(scores, *seen(scores, np.vstack([others, turned])))) == 0.0).all()


def test_of_layers_that_cover_a_place_the_nearest_in_size_is_taken():
    camera = Ideal()
    layers = [flat_layer(1.0, 0, 0, (113, 153), 1.0), flat_layer(0.8, 0, 0, (10, 10), 2.0)]
    layers += [flat_layer(0.8, 40, 60, (30, 20), 3.0), flat_layer(0.5, 0, 0, (53, 73), 4.0)]
    scores = scored(camera, layers)
    height = WINDOW.head_height
    middles = np.array([[30.0, 30.0], [330.0, 230.0], [600.0, 30.0], [320.0, 240.0], [320.0, 240.0]])
    heights = height / np.array([0.8, 0.8, 0.9, 0.5, 0.65])
    np.testing.assert_array_equal(scores_at(scores, middles, heights), [2.0, 3.0, 1.0, 4.0, np.nan])


def test_what_was_not_scored_is_unknown():
    camera = Ideal()
    middles, heights = np.array([[320.0, 240.0], [np.nan, 240.0], [2.0, 240.0]]), np.array([30.0, 30.0, 30.0])
    assert np.isnan(scores_at(scored(camera), middles, heights)).all()
    scores = scored(camera, pyramid_of(camera, [1.0]))
    np.testing.assert_array_equal(scores_at(scores, middles, heights), [0.0, np.nan, np.nan])
    np.testing.assert_array_equal(scores_at(scores, middles, np.array([60.0, 10.0, 300.0])), [np.nan] * 3)
    assert scores_at(scores, np.zeros((0, 2)), np.zeros(0)).shape == (0,)


def test_between_cells_scores_are_bilinear():
    camera = Ideal()
    scores = scored(camera, pyramid_of(camera, [1.0]))
    rows, cols = np.mgrid[: scores.layers[0].scores.shape[0], : scores.layers[0].scores.shape[1]]
    scores.layers[0].scores[:] = 3.0 * rows - 2.0 * cols + 0.5 * rows * cols
    places = Places(np.zeros(3, int), np.array([10.25, 0.0, 50.5]), np.array([20.5, 7.75, 0.0]))
    boxes = corners_of(scores, places)
    expected = 3.0 * places.rows - 2.0 * places.cols + 0.5 * places.rows * places.cols
    found = scores_at(scores, 0.5 * (boxes[:, :2] + boxes[:, 2:]), boxes[:, 3] - boxes[:, 1])
    np.testing.assert_allclose(found, expected, rtol=1e-5)
