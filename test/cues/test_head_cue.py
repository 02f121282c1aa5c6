"""The head cue: boxes in an image become heads in space with a covariance that is right."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from camera_scenes import SECOND, Ideal, Told, ToldConfig, boxes_of, image, tilted
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from people_fusion.core.errors import NotLooked, TransformUnavailable
from people_fusion.core.poses import Pose
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.heads.boxes import BoxConfig, Boxes, best_of_overlapping, overlaps
from people_fusion.cues.heads.detector import Search, crops, without_repeats
from people_fusion.cues.heads.heads import HeadCue, HeadCueConfig
from people_fusion.cues.heads.people import ground_search, heads_of_boxes, search_around

CAMERA, HEIGHT = Ideal(), 1.67
HEIGHTS, RANGES = (0.9, 2.1), (0.6, 8.0)
FACE, UPPER = BoxConfig(height=0.19), BoxConfig(height=0.55, height_std=0.08, head_above=0.08, across_std=0.06)
places = st.tuples(st.floats(*RANGES), st.floats(-0.45, 0.45), st.floats(*HEIGHTS))


def level(place):
    """Head at a distance, a bearing and a height over the floor, from the camera."""
    distance, bearing, height = place
    return np.array([[distance * np.cos(bearing), distance * np.sin(bearing), height - HEIGHT]])


class Mast(TransformSource):
    """A camera on a robot that stands."""

    def __init__(self, tilt=5.0):
        self.pose = Pose(tilted(tilt), np.array([0.0, 0.0, HEIGHT]))
        self.moved = {}

    def lookup(self, target_frame, source_frame, stamp_ns):
        assert (target_frame, source_frame) in (("odom", "camera"), ("map", "camera"))
        x, yaw = self.moved.get(stamp_ns, (0.0, 0.0))
        return Pose.from_xy_yaw(x, 0.0, yaw) @ self.pose


def cue(boxes=None, **parameters):
    built = HeadCue(HeadCueConfig(ToldConfig(parameters.pop("box", FACE), parameters.pop("rest", False)), **parameters),
                    name="camera/told", frames=FramesConfig())  # fmt: skip
    if boxes is not None:
        built._detector.boxes = boxes
    return built


def sure(corners):
    return Boxes(corners, np.ones(len(corners)), np.full(len(corners), 0.9))


@settings(max_examples=60, deadline=None)
@given(places, st.floats(-15.0, 30.0), st.floats(-3.0, 3.0), st.sampled_from([FACE, UPPER]))
def test_box_of_a_head_of_average_size_gives_its_place(place, tilt, yaw, box):
    rotation = tilted(tilt, yaw)
    head = level(place) @ Pose.from_xy_yaw(0.0, 0.0, yaw).rotation.T
    corners = boxes_of(head, CAMERA, rotation, box)
    assume((corners[0, :2] > 0.0).all() and (corners[0, 2:] < [CAMERA.width, CAMERA.height]).all())
    found = heads_of_boxes(corners, CAMERA, rotation, box)
    atol = 0.03 if tilt < 15.0 else 0.12  # upright in space is not upright in the image, least of all in its corners
    assert np.allclose(found.positions, head, atol=atol * place[0])


@pytest.mark.parametrize("box", [FACE, UPPER])
def test_covariance_is_that_of_people_and_boxes_as_they_vary(box):
    rng, count = np.random.default_rng(3), 4000
    rotation = tilted(8.0)
    heads = np.repeat([[3.0, 0.8, -0.2]], count, axis=0)
    aside = np.array([-0.8, 3.0, 0.0]) / np.hypot(0.8, 3.0)
    seen = heads + rng.normal(0.0, box.across_std, count)[:, None] * aside
    seen[:, 2] -= rng.normal(0.0, box.head_above_std, count)
    size = rng.normal(box.height, box.height_std, count)
    found = heads_of_boxes(boxes_of(seen, CAMERA, rotation, box, size), CAMERA, rotation, box)
    errors = found.positions - heads
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(found.covariances), errors)
    assert 2.7 < nees.mean() < 3.4
    assert 0.92 < (nees < chi2.ppf(0.95, 3)).mean() < 0.97


def test_finds_in_doubt_are_as_much_wider_as_the_box_says():
    box, corners = dataclasses.replace(FACE, doubt=3.0), np.array([[300.0, 200.0, 340.0, 240.0]] * 2)
    found = heads_of_boxes(corners, CAMERA, tilted(0.0, 0.0), box, np.array([1.0, 0.5]))
    np.testing.assert_allclose(found.positions[0], found.positions[1])
    np.testing.assert_allclose(found.covariances[1], 2.5**2 * found.covariances[0])
    sure = heads_of_boxes(corners, CAMERA, tilted(0.0, 0.0), box)
    np.testing.assert_allclose(sure.covariances, found.covariances[[0, 0]])


def test_box_that_cannot_be_is_no_head():
    rotation = tilted(0.0)
    upside_down, of_no_height = [100.0, 200.0, 150.0, 150.0], [100.0, 150.0, 150.0, 150.0]
    not_a_number = [np.nan] * 4
    found = heads_of_boxes(np.array([upside_down, of_no_height, not_a_number]), CAMERA, rotation, FACE)
    assert np.isnan(found.positions).any(axis=1).all()
    measured = cue(sure(np.array([not_a_number])), by_ground=False).measure(image(), Mast())
    assert len(measured) == 0


@settings(max_examples=60, deadline=None)
@given(places, st.floats(-10.0, 25.0), st.sampled_from([FACE, UPPER]))
def test_people_on_the_floor_are_searched_where_they_are_seen(place, tilt, box):
    rotation = tilted(tilt)
    corners = boxes_of(level(place), CAMERA, rotation, box)
    middle = 0.5 * (corners[0, :2] + corners[0, 2:])
    search = ground_search(CAMERA, rotation, HEIGHT, box, HEIGHTS, RANGES)
    in_image = 0 < middle[0] < CAMERA.width and 0 < middle[1] < CAMERA.height
    assert not in_image or search.wanted(corners).all()


def test_what_is_far_is_searched_in_a_band_only():
    search = ground_search(CAMERA, tilted(5.0), HEIGHT, FACE, HEIGHTS, RANGES)
    rows = search.corners[:, 3] - search.corners[:, 1]
    smallest = np.argmin(search.heights[:, 0])
    assert rows[smallest] < 0.3 * CAMERA.height
    # A small face at the bottom of the image would be a dwarf's.
    assert not search.wanted(np.array([[300.0, 440.0, 313.0, 453.0]])).any()


def test_camera_that_looks_at_the_ceiling_searches_nothing():
    assert len(ground_search(CAMERA, tilted(-80.0), 2.5, FACE, HEIGHTS, RANGES).corners) == 0


@settings(max_examples=60, deadline=None)
@given(places, st.floats(0.01, 0.3))
def test_tracked_people_are_searched_where_they_are_seen(place, std):
    rotation, head = tilted(5.0), level(place)
    corners = boxes_of(head, CAMERA, rotation, FACE)
    search = search_around(head, std**2 * np.eye(3)[None], CAMERA, rotation, FACE)
    middle = 0.5 * (corners[0, :2] + corners[0, 2:])
    in_image = (np.array([0.0, 0.0]) < middle).all() and (middle < [CAMERA.width, CAMERA.height]).all()
    assert not in_image or search.wanted(corners).all()


def test_nobody_is_searched_behind_the_camera():
    search = search_around(np.array([[-3.0, 0.0, 0.0]]), 0.01 * np.eye(3)[None], CAMERA, tilted(0.0), FACE)
    assert len(search.corners) == 0


def test_measurement_is_in_the_cameras_frame():
    head, mast = level((3.0, 0.2, 1.6)), Mast()
    corners = boxes_of(head, CAMERA, mast.pose.rotation, FACE)
    found = cue(sure(corners)).measure(image(), mast)
    assert (found.frame_id, found.modality, found.cue) == ("camera", "head", "camera/told")
    assert found.observed == (True, True, True) and found.confidences.tolist() == [0.9]
    assert np.allclose(mast.pose.apply(found.positions) - mast.pose.translation, head, atol=0.02)
    along = found.positions[0] / np.linalg.norm(found.positions[0])
    assert along @ found.covariances[0] @ along == pytest.approx((3.0 * FACE.height_std / FACE.height) ** 2, rel=0.1)


@pytest.mark.parametrize("height, is_person", [(1.6, True), (0.3, False), (2.9, False)])
def test_head_where_nobody_has_one_is_not_told(height, is_person):
    mast = Mast()
    corners = boxes_of(level((3.0, 0.0, height)), CAMERA, mast.pose.rotation, FACE)
    cues = [cue(sure(corners), by_ground=by_ground) for by_ground in (True, False)]
    assert [len(each.measure(image(), mast)) for each in cues] == [is_person] * 2


def test_unsure_find_is_not_told_but_seen_in_the_look():
    mast = Mast()
    corners = boxes_of(level((3.0, 0.0, 1.6)), CAMERA, mast.pose.rotation, FACE)
    unsure = cue(Boxes(corners, np.zeros(1), np.array([0.05])))
    assert len(unsure.measure(image(), mast)) == 0 and unsure.look.kept.tolist() == [False]


def test_camera_without_transforms_is_refused_for_good():
    with pytest.raises(TransformUnavailable) as raised:
        cue().measure(image(), None)
    assert not raised.value.may_arrive


def test_detector_that_compares_images_begins_anew_and_says_nothing_when_the_camera_moves():
    mast = Mast()
    stamps = [SECOND * k // 10 for k in range(50, 56)]
    mast.moved = {stamps[3]: (0.05, 0.0), stamps[4]: (0.05, 0.02), stamps[5]: (0.05, 0.02)}
    resting = cue(rest=True)
    resets, silent = [], []
    for stamp in stamps:
        try:
            resting.measure(image(stamp), mast)
            silent.append(False)
        except NotLooked:
            assert resting.look is None
            silent.append(True)
        resets.append(resting._detector.resets)
    assert resets == [1, 1, 1, 2, 3, 3]
    assert silent == [True, False, False, True, True, False]


def tracks(stamp_ns, mean, frame="map"):
    count = len(mean)
    flags = np.ones(count, dtype=bool)
    covariances = np.tile(0.01 * np.eye(5), (count, 1, 1))
    ones = np.ones(count)
    return Tracks(stamp_ns, frame, np.arange(count), mean, covariances, ones, flags, flags, ~flags, ones)


def test_of_so_many_images_one_is_searched_whole_the_others_where_tracks_have_gone():
    mast = Mast()
    walker = np.array([[3.0, -0.5, 1.6, 0.0, 1.0]])
    sparing = cue(full_every=3)
    areas = []
    for step in range(6):
        now = 5 * SECOND + step * SECOND // 10
        sparing.set_tracks(tracks(now - SECOND // 10, walker + [0.0, 0.1 * (step - 1), 0.0, 0.0, 0.0]))
        sparing.measure(image(now), mast)
        search = sparing._detector.searches[-1]
        areas.append((search.corners[:, 2:] - search.corners[:, :2]).prod(axis=1).sum())
        there = walker[:, :3] + [0.0, 0.1 * step, -HEIGHT]
        assert search.wanted(boxes_of(there, CAMERA, mast.pose.rotation, FACE)).all()
    full = [area > 0.5 * CAMERA.width * CAMERA.height for area in areas]
    assert full == [False, False, True, False, False, True]


def test_a_cue_that_never_searches_whole_images_looks_nowhere_where_nobody_is_tracked():
    sparing = cue(full_every=0)
    for step in range(3):
        now = 5 * SECOND + step * SECOND // 10
        sparing.set_tracks(tracks(now, np.zeros((0, 5))))
        sparing.measure(image(now), Mast())
        assert len(sparing._detector.searches[-1].corners) == 0


def test_so_many_images_a_second_are_wanted_and_no_more():
    stamps = [5 * SECOND + step * SECOND // 9 for step in range(18)]
    assert all(cue().wants(stamp) for stamp in stamps)
    sparing = cue(max_rate=3.0)
    assert [sparing.wants(stamp) for stamp in stamps] == 6 * [True, False, False]
    assert sparing.wants(SECOND)  # a recording that begins again


def test_without_tracks_every_image_is_searched_whole():
    sparing = cue(full_every=5)
    sparing.measure(image(), Mast())
    assert sparing._detector.searches[-1].corners[0, 2] == CAMERA.width


def test_pieces_of_the_image_hold_what_is_searched():
    search = Search(np.array([[100.0, 50.0, 200.0, 90.0]]), np.array([[10.0, 40.0]]))
    (piece,) = crops(image(), search)
    assert (piece.left, piece.top, piece.grey.shape) == (80, 30, (80, 140))


def test_overlaps_are_those_of_areas():
    one = np.array([[0.0, 0.0, 2.0, 2.0]])
    others = np.array([[0.0, 0.0, 2.0, 2.0], [1.0, 0.0, 3.0, 2.0], [5.0, 5.0, 6.0, 6.0], [0.0, 0.0, 0.0, 0.0]])
    assert np.allclose(overlaps(one, others), [[1.0, 1.0 / 3.0, 0.0, 0.0]])


def test_of_overlapping_boxes_the_best_is_left_even_across_a_panoramas_seam():
    lefts = np.array([0.0, 2.0, 99.0, 50.0])
    corners = np.column_stack([lefts, np.zeros(4), lefts + 10.0, np.full(4, 10.0)])
    boxes = Boxes(corners, np.array([1.0, 2.0, 3.0, 0.5]), np.ones(4))
    assert best_of_overlapping(boxes, 0.3).tolist() == [2, 1, 3]
    assert best_of_overlapping(boxes, 0.3, 100.0).tolist() == [2, 3]


def test_what_lies_within_a_better_larger_box_is_part_of_it_even_across_a_panoramas_seam():
    head, face, beside = [0.0, 0.0, 40.0, 40.0], [5.0, 15.0, 25.0, 35.0], [28.0, 0.0, 48.0, 20.0]
    beyond = [99.0, 10.0, 109.0, 20.0]
    boxes = Boxes(np.array([head, face, beside, beyond]), np.array([3.0, 2.0, 1.0, 0.5]), np.ones(4))
    assert best_of_overlapping(boxes, 0.3).tolist() == [0, 1, 2, 3]
    assert best_of_overlapping(boxes, 0.3, inside=0.5).tolist() == [0, 3]
    assert best_of_overlapping(boxes, 0.3, 100.0, inside=0.5).tolist() == [0]
    assert best_of_overlapping(boxes, 0.3, inside=0.7).tolist() == [0, 2, 3]


def test_a_large_box_around_better_small_ones_stays():
    corners = np.array([[2.0, 2.0, 12.0, 12.0], [20.0, 2.0, 30.0, 12.0], [0.0, 0.0, 40.0, 40.0]])
    boxes = Boxes(corners, np.array([3.0, 2.0, 1.0]), np.ones(3))
    assert best_of_overlapping(boxes, 0.3, inside=0.5).tolist() == [0, 1, 2]


def test_told_detector_is_a_detector():
    assert Told(ToldConfig()).part == "head"


def test_what_regions_share_is_searched_once_and_nothing_is_left_out():
    search = ground_search(CAMERA, tilted(5.0), HEIGHT, FACE, HEIGHTS, RANGES)
    once = without_repeats(search)
    rng = np.random.default_rng(2)
    middles, heights = rng.uniform(0.0, [CAMERA.width, CAMERA.height], (5000, 2)), np.exp(rng.uniform(2.0, 5.0, 5000))
    boxes = np.column_stack([middles - 0.5 * heights[:, None], middles + 0.5 * heights[:, None]])
    wanted, looked_at = search.wanted(boxes), once.wanted(boxes)
    assert looked_at[wanted].all()
    assert (once.heights[1:, 0] >= once.heights[:-1, 1] - 1e-9).all()  # each size in one region


def test_regions_apart_are_searched_as_they_are():
    corners = np.array([[10.0, 10.0, 30.0, 30.0], [300.0, 10.0, 320.0, 30.0], [10.0, 10.0, 30.0, 30.0]])
    search = Search(corners, np.array([[10.0, 40.0], [10.0, 40.0], [100.0, 120.0]]))
    once = without_repeats(search)
    assert np.array_equal(once.corners, search.corners) and np.array_equal(once.heights, search.heights)
