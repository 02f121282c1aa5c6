"""Overlap of boxes in an image, and CLEAR-MOT by it."""

import numpy as np
import pytest
from scenes import scene

from people_fusion.evaluation.distances import IMAGE_THRESHOLD, in_the_image, on_the_floor
from people_fusion.evaluation.evaluate import evaluate_in_image

BOX = (10.0, 20.0, 30.0, 60.0)  # 20 by 40


def apart(person, track, period=None):
    distance = in_the_image(np.array([person], dtype=float), np.array([track], dtype=float), period)
    return float(distance(np.array([0]), np.array([0]))[0])


@pytest.mark.parametrize(
    "track, overlap",
    [
        (BOX, 1.0),
        ((20.0, 20.0, 40.0, 60.0), 1.0 / 3.0),  # half of each
        ((10.0, 40.0, 30.0, 60.0), 0.5),  # the lower half
        ((15.0, 30.0, 25.0, 50.0), 0.25),  # within it
        ((30.0, 20.0, 50.0, 60.0), 0.0),  # side by side
        ((100.0, 200.0, 110.0, 220.0), 0.0),  # apart in both directions
    ],
)
def test_distance_is_one_minus_overlap(track, overlap):
    assert apart(BOX, track) == pytest.approx(1.0 - overlap)
    assert apart(track, BOX) == pytest.approx(1.0 - overlap)


def test_boxes_overlap_across_the_seam_of_a_panorama():
    right, left = (1390.0, 20.0, 1410.0, 60.0), (-6.0, 20.0, 14.0, 60.0)  # of 1400 columns; 6 columns of 20 apart
    assert apart(right, left, 1400.0) == apart(left, right, 1400.0) == pytest.approx(1.0 - 16.0 / 24.0)
    assert apart(right, left) == 1.0


def test_rows_are_broadcast():
    boxes = np.array([BOX, (20.0, 20.0, 40.0, 60.0)])
    table = in_the_image(boxes, boxes)(np.arange(2)[:, None], np.arange(2))
    np.testing.assert_allclose(table, [[0.0, 2.0 / 3.0], [2.0 / 3.0, 0.0]])


def test_on_the_floor_it_is_metres():
    truth, estimates = scene([({1: (0, 0), 2: (3, 0)}, {11: (3, 4)})])
    np.testing.assert_allclose(on_the_floor(truth, estimates)(np.array([0, 1]), np.array([0, 0])), [5.0, 4.0])


def test_hand_worked_example_in_the_image():
    # Who is matched is told by the boxes alone; positions on the floor would match nobody.
    far = (50.0, 50.0)
    truth, estimates = scene(
        [
            ({1: (0, 0), 2: (5, 0)}, {11: far, 12: far}),
            ({1: (0, 0), 2: (5, 0)}, {11: far, 12: far}),
            ({1: (0, 0)}, {13: far}),
        ]
    )
    beside = (100.0, 20.0, 120.0, 60.0)
    people = np.array([BOX, beside, BOX, beside, BOX])
    tracks = np.array(
        [
            BOX,  # distance 0
            (100.0, 40.0, 120.0, 60.0),  # 0.5
            (15.0, 30.0, 25.0, 50.0),  # overlap of just 0.25: a match
            (114.0, 20.0, 134.0, 60.0),  # 6 of 34: a miss and a false positive
            (20.0, 20.0, 40.0, 60.0),  # 2 / 3, another track: mismatch
        ]
    )
    result = evaluate_in_image(truth, estimates, in_the_image(people, tracks))
    counts = result.scores.clear_mot
    assert (counts.matches, counts.misses, counts.false_positives, counts.mismatches) == (4, 1, 1, 1)
    assert counts.mota == pytest.approx(1 - 3 / 5)  # Volkhardt et al. 2013, eq. 8
    assert counts.motp_image == pytest.approx((0.0 + 0.5 + 0.75 + 2 / 3) / 4)
    assert counts.motp_m is None and result.threshold_m == IMAGE_THRESHOLD
    assert (counts + counts).motp_image == counts.motp_image


def test_tracks_of_who_is_not_annotated_are_left_out_of_all_scores():
    truth, estimates = scene([({1: (0, 0)}, {11: (0, 0), 12: (0, 0)})] * 2)
    people, tracks = np.array([BOX] * 2), np.array([(100.0, 0.0, 110.0, 20.0), BOX] * 2)
    result = evaluate_in_image(truth, estimates, in_the_image(people, tracks), only_annotated=True).to_dict()
    assert result["mota"] == result["idf1"] == result["hota"] == 1.0 and result["false_positives"] == 0
