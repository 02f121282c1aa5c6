"""cues.heads.short_term: a single target followed by how it looks."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from test_appearance import textured

from people_fusion.core.errors import DataError
from people_fusion.cues.heads.short_term import ShortTermConfig, ShortTermTracker

BACKGROUND, TARGET = textured(360, 480, 1), textured(128, 128, 2)


def picture(x, y, width, height):
    """A target of that box (edges of pixels) before a background; smooth at all sizes."""
    scale = np.array([width, height]) / 128.0
    affine = np.column_stack([np.diag(scale), np.array([x, y]) + 0.5 * scale - 0.5])
    size = BACKGROUND.shape[::-1]
    small = cv2.GaussianBlur(TARGET, (0, 0), 0.5 / scale.min())
    there = cv2.warpAffine(small, affine, size, flags=cv2.INTER_LINEAR)
    share = cv2.warpAffine(np.ones(TARGET.shape, np.float32), affine, size, flags=cv2.INTER_LINEAR)
    return (share * there + (1.0 - share) * BACKGROUND).astype(np.uint8)


def followed(boxes, config=None, seed=0):
    """Of the boxes (N, 4) the first is given."""
    images = [picture(*box[:2], *(box[2:] - box[:2])) for box in boxes]
    tracker = ShortTermTracker(config or ShortTermConfig(), images[0], boxes[0], np.random.default_rng(seed))
    found, scores = [tracker.box], [tracker.score]
    for image in images[1:]:
        tracker.update(image)
        found.append(tracker.box)
        scores.append(tracker.score)
    return np.array(found), np.array(scores)


def path(count, width, height, speed=(3.3, 1.7), growth=1.0):
    """(count, 4) boxes on their way."""
    middles = [150.0, 130.0] + np.arange(count)[:, None] * np.array(speed)
    half = 0.5 * np.array([width, height]) * growth ** np.arange(count)[:, None]
    return np.hstack([middles - half, middles + half])


@pytest.mark.parametrize("width,height", [(40.0, 40.0), (30.0, 60.0), (64.0, 32.0), (110.0, 110.0), (22.0, 22.0)])
def test_a_moving_target_is_followed_between_the_cells(width, height):
    boxes = path(25, width, height)
    found, scores = followed(boxes)
    off = 0.5 * np.abs(found[:, :2] + found[:, 2:] - boxes[:, :2] - boxes[:, 2:])
    assert off.max() < 0.06 * max(width, height)
    assert scores.min() > 0.2


@pytest.mark.parametrize("growth", [1.02, 0.98])
def test_a_target_that_comes_or_goes_keeps_its_box(growth):
    boxes = path(25, 60.0, 60.0, growth=growth)
    found, _ = followed(boxes)
    ratios = (found[:, 3] - found[:, 1]) / (boxes[:, 3] - boxes[:, 1])
    assert np.abs(np.log(ratios)).max() < 0.2
    assert np.allclose((found[:, 2] - found[:, 0]) / (found[:, 3] - found[:, 1]), 1.0)


def test_a_covered_target_scores_low():
    boxes = path(12, 48.0, 48.0)
    first = picture(*boxes[0, :2], 48.0, 48.0)
    tracker = ShortTermTracker(ShortTermConfig(), first, boxes[0], np.random.default_rng(0))
    for box in boxes[1:]:
        tracker.update(picture(*box[:2], 48.0, 48.0))
    before = tracker.score
    tracker.update(BACKGROUND)
    assert before > 0.5 and tracker.score < before - 0.5


def test_the_same_generator_follows_the_same_way():
    boxes = path(5, 40.0, 40.0)
    first, second, third = (followed(boxes, seed=seed)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, second)
    assert (first != third).any()


def test_a_target_at_the_edge_of_the_image_is_looked_at_all_the_same():
    boxes = path(8, 50.0, 50.0, speed=(-20.0, 0.0))
    found, _ = followed(boxes)
    assert np.isfinite(found).all()


@pytest.mark.parametrize("box", [[10, 10, 10, 40], [10, 10, 40, 5], [500, 10, 540, 50], [10, 10, np.nan, 50]])
def test_what_is_no_target_is_refused(box):
    with pytest.raises(DataError, match="target"):
        ShortTermTracker(ShortTermConfig(), BACKGROUND, np.array(box, dtype=float), np.random.default_rng(0))
