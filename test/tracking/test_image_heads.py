"""tracking.image_heads: heads followed in the image alone."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.head_scores import FEATURES, SCORES, HeadScores, ScoreLayer, ScoreWindow
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.fhog import FhogConfig
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow
from people_fusion.cues.heads.pyramid import pyramid, score_maps
from people_fusion.tracking.image_heads import ImageHeads, ImageHeadsConfig

WINDOW = HeadWindow(FhogConfig(), 8, 8, (0.0, 0.0, 8.0, 8.0))
CONFIG = ImageHeadsConfig()


def disc(face):
    """128x128: a head on a darker ground, with a pattern of its own."""
    rng = np.random.default_rng(face)
    pattern = np.kron(rng.normal(0.0, 25.0, (8, 8)), np.ones((16, 16)))
    inside = np.hypot(*(np.mgrid[:128, :128] - 63.5)) < 56
    return cv2.GaussianBlur(np.where(inside, 180 + pattern, 70), (0, 0), 3)


def background():
    rng = np.random.default_rng(9)
    return cv2.resize(rng.normal(70.0, 12.0, (24, 32)), (320, 240), interpolation=cv2.INTER_CUBIC)


BACKGROUND, FACES = background(), [disc(face) for face in range(3)]


def picture(*heads):
    """Heads (face, x, y, size) before a background, later ones nearer."""
    canvas = BACKGROUND.copy()
    for face, x, y, size in heads:
        scale = size / 128.0
        affine = np.array([[scale, 0.0, x - 63.5 * scale], [0.0, scale, y - 63.5 * scale]])
        share = cv2.warpAffine(np.ones((128, 128)), affine, (320, 240))
        canvas = share * cv2.warpAffine(FACES[face], affine, (320, 240)) + (1.0 - share) * canvas
    return np.clip(canvas, 0, 255).astype(np.uint8)


def model():
    """Likes discs: the mean of what is seen of the three, against the background."""
    shape = (8, 8, FhogConfig().dimensions)
    cells = [pyramid(cv2.resize(face, (32, 32)).astype(np.uint8), WINDOW, 32.0, 32.0)[0].features for face in FACES]
    weights = np.mean(cells, axis=0).reshape(shape)
    weights = weights - weights.mean(axis=(0, 1))
    weights *= 4.0 / (weights**2).sum()
    return HeadModel(WINDOW, weights.astype(np.float32), -2.5, -2.0, {})


MODEL = model()


def scores(pixels, detections=(), wanted=FEATURES):
    """HeadScores of a picture in which (x, y, size) are detected."""
    layers = pyramid(pixels, WINDOW, 32.0, 100.0)
    nothing = np.zeros((0, 0, WINDOW.features.dimensions), dtype=np.float32)
    found = tuple(
        ScoreLayer(layer.scale, layer.row, layer.col, here, layer.features if wanted == FEATURES else nothing)
        for layer, here in zip(layers, score_maps(MODEL, layers))
    )
    boxes = np.array([corners(*each) for each in detections]).reshape(-1, 4)
    window = ScoreWindow(8, 8, 4, WINDOW.box)
    camera = Pinhole(320, 240, np.eye(3))
    return HeadScores(camera, window, -2.0, 0.24, 0.0, 0, found, boxes, np.ones(len(boxes)))


def corners(x, y, size):
    return np.array([x - 0.5 * size, y - 0.5 * size, x + 0.5 * size, y + 0.5 * size])


def shared(head, *box):
    return float(overlaps(head.box[None], corners(*box)[None])[0, 0])


def started(config=CONFIG, seed=0, face=0, x=100.0, y=120.0, size=48.0):
    tracker = ImageHeads(config, np.random.default_rng(seed))
    for _ in range(3):
        tracker.update(scores(picture((face, x, y, size)), [(x, y, size)]))
    return tracker


def test_two_detections_make_a_head_and_one_none():
    tracker = ImageHeads(CONFIG, np.random.default_rng(0))
    here, seen = picture((0, 100.0, 120.0, 48.0)), [(100.0, 120.0, 48.0)]
    tracker.update(scores(here, seen))
    assert tracker.heads == []
    tracker.update(scores(here, seen))
    (head,) = tracker.heads
    assert head.track == 1 and head.detected and shared(head, 100.0, 120.0, 48.0) > 0.7
    once = ImageHeads(CONFIG, np.random.default_rng(0))
    for detections in (seen, [], seen):
        once.update(scores(here, detections))
        assert once.heads == []


@pytest.mark.parametrize("adaptive", [True, False])
def test_a_head_is_followed_that_no_detection_reports(adaptive):
    tracker = started(dataclasses.replace(CONFIG, adaptive=adaptive))
    for step in range(1, 25):
        x, y = 100.0 + 4.0 * step, 120.0 - step
        tracker.update(scores(picture((0, x, y, 48.0))))
        (head,) = tracker.heads
        assert not head.detected and shared(head, x, y, 48.0) > 0.5


@pytest.mark.parametrize("growth", [1.02, 0.985])
def test_a_head_that_comes_or_goes_is_followed(growth):
    size = 40.0 if growth > 1.0 else 80.0
    tracker = started(size=size)
    for _ in range(30):
        size *= growth
        tracker.update(scores(picture((0, 100.0, 120.0, size))))
    (head,) = tracker.heads
    assert shared(head, 100.0, 120.0, size) > 0.55


def test_a_head_that_is_partly_covered_is_still_followed():
    tracker = started()
    for step in range(1, 20):
        x = 100.0 + 3.0 * step
        pixels = picture((0, x, 120.0, 48.0))
        if 6 <= step <= 12:  # its lower third, by what has no pattern
            pixels[130:, int(x) - 40 : int(x) + 40] = 70
        tracker.update(scores(pixels))
        (head,) = tracker.heads
    assert shared(head, x, 120.0, 48.0) > 0.5


@pytest.mark.parametrize("adaptive", [True, False])
def test_who_has_gone_is_lost_at_once(adaptive):
    tracker = started(dataclasses.replace(CONFIG, adaptive=adaptive))
    tracker.update(scores(picture()))
    assert tracker.heads == []


def test_who_leaves_the_image_is_lost():
    tracker, x = started(x=60.0), 60.0
    while x > -30.0:
        x -= 4.0
        tracker.update(scores(picture((0, x, 120.0, 48.0))))
    assert tracker.heads == []


def test_a_detection_keeps_a_head_that_scores_low():
    tracker = started()
    tracker.update(scores(picture(), [(100.0, 120.0, 48.0)]))
    assert len(tracker.heads) == 1


def test_of_two_tracks_of_one_head_one_stays():
    tracker, here = started(), picture((0, 100.0, 120.0, 48.0))
    tracker.add(scores(here), corners(104.0, 120.0, 46.0))
    assert len(tracker.heads) == 2
    tracker.update(scores(here))
    assert len(tracker.heads) == 1


def test_a_given_box_is_followed_without_detections():
    tracker, here = ImageHeads(CONFIG, np.random.default_rng(0)), picture((0, 100.0, 120.0, 48.0))
    tracker.update(scores(here, [(250.0, 60.0, 40.0)]), starts=False)
    tracker.add(scores(here), corners(100.0, 120.0, 48.0))
    for _ in range(5):
        tracker.update(scores(here, [(250.0, 60.0, 40.0)]), starts=False)
    (head,) = tracker.heads
    assert head.track == 1 and shared(head, 100.0, 120.0, 48.0) > 0.6


def test_two_who_pass_keep_their_numbers():
    tracker = ImageHeads(CONFIG, np.random.default_rng(0))
    for step in range(40):
        left, right = (0, 60.0 + 5.0 * step, 80.0, 44.0), (1, 260.0 - 5.0 * step, 170.0, 44.0)
        tracker.update(scores(picture(left, right), [left[1:], right[1:]] if step < 2 else []))
    first, second = sorted(tracker.heads, key=lambda head: head.track)
    assert shared(first, *left[1:]) > 0.5 and shared(second, *right[1:]) > 0.5


def test_the_same_generator_follows_the_same_way():
    first, second, third = (started(seed=seed).heads[0].box for seed in (3, 3, 4))
    np.testing.assert_array_equal(first, second)
    assert (first != third).any()


def test_without_features_it_follows_by_the_class():
    tracker = ImageHeads(CONFIG, np.random.default_rng(0))
    for step in range(10):
        here = picture((0, 100.0 + 3.0 * step, 120.0, 48.0))
        tracker.update(scores(here, [(100.0 + 3.0 * step, 120.0, 48.0)] if step < 2 else [], SCORES))
    assert shared(tracker.heads[0], 127.0, 120.0, 48.0) > 0.5


def test_particles_weigh_as_much_as_their_score_says():
    """Equation 6.5, where nothing has been learnt: 6.6."""
    tracker = ImageHeads(dataclasses.replace(CONFIG, adaptive=False), np.random.default_rng(0))
    here = scores(picture((0, 100.0, 120.0, 48.0)), [(100.0, 120.0, 48.0)])
    tracker.update(here)
    tracker.update(here)
    (states,), (weights,) = tracker.particles()
    assert weights.sum() == pytest.approx(1.0) and states.shape == (500, 3)
    far = np.hypot(*(states[:, :2] - [100.0, 120.0]).T)
    assert weights[far < 4.0].mean() > 2.0 * weights[far > 10.0].mean()


def test_a_picture_too_small_for_the_window_loses_everybody():
    tracker = started()
    tracker.update(scores(np.zeros((20, 20), dtype=np.uint8)))
    assert tracker.heads == []
