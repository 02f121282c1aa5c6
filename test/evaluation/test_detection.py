"""Detections against annotations, DET curves and the log-average miss rate."""

import numpy as np
import pytest

from people_fusion.evaluation.detection import (
    REFERENCES,
    Matches,
    det_curve,
    log_average_miss_rate,
    match,
    miss_rates_at,
    together,
)


def box(left, top, side=10.0):
    return [left, top, left + side, top + side]


def matched(found, truth):
    """found: (box, score); truth: (box, considered)."""
    corners = np.array([entry for entry, _ in found]).reshape(-1, 4)
    boxes = np.array([entry for entry, _ in truth]).reshape(-1, 4)
    return match(
        corners, np.array([score for _, score in found]), boxes, np.array([flag for _, flag in truth], dtype=bool)
    )


def test_second_detection_of_one_head_is_false():
    result = matched([(box(0, 0), 1.0), (box(1, 0), 2.0)], [(box(0, 0), True)])
    assert sorted(zip(result.scores, result.true)) == [(1.0, False), (2.0, True)]


def test_detection_of_what_is_ignored_counts_as_nothing_however_often():
    result = matched([(box(0, 0), 1.0), (box(1, 0), 2.0), (box(50, 50), 0.5)], [(box(0, 0), False)])
    assert result.scores.tolist() == [0.5] and result.true.tolist() == [False]
    assert result.considered == 0


def test_considered_is_taken_before_ignored_that_overlaps_more():
    result = matched([(box(0, 0), 1.0)], [(box(0, 0), False), (box(2, 0), True)])
    assert result.true.tolist() == [True]


def test_overlap_of_a_half_is_enough_and_less_is_not():
    assert matched([([0, 0, 10, 5], 1.0)], [(box(0, 0), True)]).true.tolist() == [True]
    assert matched([([0, 0, 10, 4.9], 1.0)], [(box(0, 0), True)]).true.tolist() == [False]


def test_the_annotation_that_is_overlapped_most_is_taken():
    result = matched([(box(0, 0), 2.0), (box(3, 0), 1.0)], [(box(3, 0), True), (box(0, 0), True)])
    assert result.true.all()


def test_without_detections_everything_is_missed():
    empty = matched([], [(box(0, 0), True)])
    curve = det_curve(together([empty]))
    assert curve.miss_rates.tolist() == [1.0] and curve.false_positives.tolist() == [0.0]
    assert log_average_miss_rate(curve) == pytest.approx(1.0)


def test_without_annotations_there_is_no_miss_rate():
    assert np.isnan(log_average_miss_rate(det_curve(matched([(box(0, 0), 1.0)], []))))
    assert together([]).images == 0


def test_curve_of_a_case_done_by_hand():
    # Two images, three heads; by score: true, false, true, false.
    matches = Matches(np.array([4.0, 3.0, 2.0, 1.0]), np.array([True, False, True, False]), 3, 2)
    curve = det_curve(matches)
    assert curve.thresholds.tolist() == [np.inf, 4.0, 3.0, 2.0, 1.0]
    assert curve.false_positives.tolist() == [0.0, 0.0, 0.5, 0.5, 1.0]
    np.testing.assert_allclose(curve.miss_rates, [1, 2 / 3, 2 / 3, 1 / 3, 1 / 3])
    # Up to 0.3162 false positives an image two of three are missed, at 0.5623 and 1 one.
    assert log_average_miss_rate(curve) == pytest.approx((2 / 3) ** (7 / 9) * (1 / 3) ** (2 / 9))


def test_detections_of_equal_score_pass_together():
    curve = det_curve(Matches(np.array([1.0, 1.0]), np.array([True, False]), 1, 1))
    assert curve.false_positives.tolist() == [0.0, 1.0] and curve.miss_rates.tolist() == [1.0, 0.0]


def test_curve_that_ends_early_goes_on_with_its_last_miss_rate():
    curve = det_curve(Matches(np.array([1.0, 0.5]), np.array([True, True]), 4, 10))
    assert miss_rates_at(curve, REFERENCES).tolist() == [0.5] * 9


def literal(images, thresholds):
    """By the words of Poschmann 4.5.1: for each threshold all is matched anew."""
    points = []
    for threshold in thresholds:
        misses = false = heads = 0
        for found, truth in images:
            taken = set()
            for corners, _ in sorted((entry for entry in found if entry[1] >= threshold), key=lambda entry: -entry[1]):
                best, best_overlap, is_ignored = None, 0.0, False
                for number, (annotation, considered) in enumerate(truth):
                    width = min(corners[2], annotation[2]) - max(corners[0], annotation[0])
                    height = min(corners[3], annotation[3]) - max(corners[1], annotation[1])
                    shared = max(width, 0) * max(height, 0)
                    areas = [(b[2] - b[0]) * (b[3] - b[1]) for b in (corners, annotation)]
                    overlap = shared / (sum(areas) - shared)
                    if overlap < 0.5:
                        continue
                    if not considered:
                        is_ignored = True
                    elif number not in taken and overlap > best_overlap:
                        best, best_overlap = number, overlap
                if best is not None:
                    taken.add(best)
                elif not is_ignored:
                    false += 1
            considered_here = [number for number, (_, considered) in enumerate(truth) if considered]
            heads += len(considered_here)
            misses += len(considered_here) - len(taken)
        points.append((false / len(images), misses / heads))
    return points


@pytest.mark.parametrize("seed", range(5))
def test_curve_agrees_with_the_literal_definition(seed):
    rng = np.random.default_rng(seed)
    images = []
    for _ in range(8):
        truth = [(box(*rng.uniform(0, 60, 2), rng.uniform(8, 16)), bool(rng.random() < 0.7)) for _ in range(6)]
        near = [([c + rng.normal(0, 2) for c in entry], rng.normal(0.5)) for entry, _ in truth for _ in range(2)]
        far = [(box(*rng.uniform(0, 60, 2)), rng.normal()) for _ in range(5)]
        images.append((near + far, truth))
    curve = det_curve(together([matched(*entry) for entry in images]))
    expected = literal(images, curve.thresholds)
    np.testing.assert_allclose(np.column_stack([curve.false_positives, curve.miss_rates]), expected)
    rates = [min(miss for false, miss in expected if false <= point) for point in REFERENCES]
    assert log_average_miss_rate(curve) == pytest.approx(np.exp(np.mean(np.log(np.maximum(rates, 1e-10)))))
