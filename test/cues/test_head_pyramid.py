"""Heads at all sizes: where they are found, how exactly, and what is looked at for it."""

from __future__ import annotations

import numpy as np
import pytest
from camera_scenes import Ideal
from hypothesis import given, settings
from hypothesis import strategies as st
from painted_heads import WINDOW, box_of, clutter, fitted_model, scene

from people_fusion.core.camera_models import Panorama, PanoramaConfig
from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.core.images import Image
from people_fusion.cues.heads import pyramid as module
from people_fusion.cues.heads.boxes import Boxes, best_of_overlapping, overlaps
from people_fusion.cues.heads.detector import DETECTORS, Search
from people_fusion.cues.heads.detectors.fhog_head import FhogHead, FhogHeadConfig
from people_fusion.cues.heads.pyramid import (
    Scales,
    Windows,
    best,
    candidates,
    detect,
    head_numbers,
    pyramid,
    refined,
    score_maps,
    searched_pyramid,
    window_features,
)

HEADS = [(90.0, 80.0, 40.0), (300.0, 150.0, 90.0), (500.0, 120.0, 61.0)]
THRESHOLD = 0.0


@pytest.fixture(scope="module")
def model():
    return fitted_model()


@pytest.fixture(scope="module")
def detector(model, tmp_path_factory):
    path = tmp_path_factory.mktemp("models") / "painted.npz"
    model.save(path)
    return DETECTORS.build(parse(DETECTORS.config_of("fhog_head", ""), {"model": str(path), "threshold": THRESHOLD}))


def image_of(pixels):
    return Image(1, "camera", pixels, Ideal(pixels.shape[1], pixels.shape[0]))


def shared_with(boxes, heads):
    """Intersection over union of each head's box with the best find."""
    return overlaps(np.array([box_of(*head) for head in heads]), boxes.corners).max(axis=1, initial=0.0)


@pytest.mark.parametrize("seed", range(4))
def test_heads_of_all_sizes_are_found_and_nothing_else(model, seed):
    found = detect(model, scene(320, 640, HEADS, seed), 32, 200, THRESHOLD)
    assert shared_with(found, HEADS).min() > 0.65
    assert len(found.scores) <= len(HEADS) + 1
    assert (np.diff(found.scores) <= 0).all() and (found.confidences >= 0.5).all()


def test_boxes_between_cells_are_nearer_to_the_heads(model):
    errors, coarse_errors = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        head = (*rng.uniform(100, 140, 2), rng.uniform(40, 80))
        layers = pyramid(scene(240, 240, [head], seed), WINDOW, 32, 120)
        scores = score_maps(model, layers)
        windows = candidates(WINDOW, layers, scores, THRESHOLD)
        windows = windows.take(best(windows)[:1])
        for corners, into in ((windows.corners, coarse_errors), (refined(WINDOW, layers, scores, windows), errors)):
            into.append(np.abs(corners - box_of(*head)).mean() / head[2])
    assert np.mean(errors) < 0.75 * np.mean(coarse_errors)
    assert np.mean(errors) < 0.05


def test_pyramid_scores_as_the_cells_of_each_window(model):
    layers = pyramid(scene(160, 200, HEADS[:1]), WINDOW, 32, 160)
    windows = candidates(WINDOW, layers, score_maps(model, layers), -1.0)
    cells = window_features(windows, layers, WINDOW)
    expected = (cells * model.weights).sum(axis=(1, 2, 3)) + model.bias
    assert len(cells) > 10
    np.testing.assert_allclose(windows.scores, expected, atol=1e-4)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 60), st.integers(0, 1000))
def test_best_are_those_of_greedy_suppression(count, seed):
    rng = np.random.default_rng(seed)
    low = rng.uniform(0, 100, (count, 2))
    corners, scores = np.hstack([low, low + rng.uniform(5, 60, (count, 2))]), rng.integers(0, 20, count).astype(float)
    nothing = np.zeros(count, dtype=int)
    expected = best_of_overlapping(Boxes(corners, scores, scores), 0.3)
    np.testing.assert_array_equal(best(Windows(nothing, nothing, nothing, scores, corners), 0.3), expected)


@pytest.mark.parametrize("layers", [1, 3, 5, 8])
def test_each_height_has_a_scale_within_half_a_step(layers):
    for least, largest in ((32, 400), (40, 50), (57, 58), (100, 333)):
        heights = WINDOW.head_height * 2.0 ** (head_numbers(WINDOW, least, largest, layers) / layers)
        wanted = np.geomspace(least, largest, 50)
        away = np.abs(np.log2(wanted[:, None] / heights)).min(axis=1)
        assert away.max() <= 0.5 / layers + 1e-9
        assert heights.min() >= least * 0.5 ** (0.5 / layers) - 1e-9


def test_nothing_is_searched_for_without_sizes():
    assert len(head_numbers(WINDOW, 100, 50)) == 0
    assert len(head_numbers(WINDOW, 1, 20)) == 0


def test_scales_say_exactly_how_much_smaller_they_are():
    scales = Scales(clutter(101, 203, np.random.default_rng(0)))
    for wanted in (1.0, 0.9, 0.5, 0.37, 0.25, 0.11):
        smaller, scale = scales.at(wanted)
        np.testing.assert_allclose(scale, wanted, rtol=0.05)
        down, across = np.mgrid[:101, :203].astype(np.uint8)
        for axis, ramp in ((0, across), (1, down)):
            made = Scales(ramp).at(wanted)[0].astype(float)
            line = made[made.shape[0] // 2] if axis == 0 else made[:, made.shape[1] // 2]
            places = (np.arange(len(line)) + 0.5) / scale[axis] - 0.5
            assert np.abs(line - places)[2:-2].max() < 1.0
        assert smaller.shape == made.shape


def test_pieces_score_as_the_whole_image(model):
    pixels = scene(320, 640, HEADS)
    whole = {layer.number: layer for layer in pyramid(pixels, WINDOW, 32, 300)}
    search = Search(
        np.array([[60.0, 50.0, 130.0, 110.0], [280.0, 10.0, 640.0, 200.0]]), np.array([[32.0, 60], [70, 150]])
    )
    pieces = searched_pyramid(pixels, WINDOW, search)
    middle = 0.5 * (np.array(WINDOW.box[:2]) + WINDOW.box[2:])
    seen = 0
    for piece, scores in zip(pieces, score_maps(model, pieces)):
        layer = whole[piece.number]
        rows, cols = np.mgrid[: scores.shape[0], : scores.shape[1]]
        there = model.responses(layer.features)[rows + piece.row, cols + piece.col]
        x = (cols + piece.col + middle[0]) * 4 / layer.scale[0]
        y = (rows + piece.row + middle[1]) * 4 / layer.scale[1]
        for region in search.corners:
            inside = (x >= region[0]) & (x <= region[2]) & (y >= region[1]) & (y <= region[3])
            seen += inside.sum()
            np.testing.assert_allclose(scores[inside], there[inside], atol=1e-4)
    assert seen > 100


def test_overlapping_regions_are_looked_at_once(monkeypatch):
    looked_at = []
    monkeypatch.setattr(module, "fhog", lambda pixels, _: looked_at.append(pixels.size) or np.zeros((0, 0, 22)))
    pixels = clutter(480, 640, np.random.default_rng(0))

    def cost(regions, heights):
        looked_at.clear()
        searched_pyramid(pixels, WINDOW, Search(np.array(regions, dtype=float), np.array(heights, dtype=float)))
        return sum(looked_at)

    whole = cost([[0, 0, 640, 480]], [[32, 200]])
    bands = [[0, top, 640, top + 200] for top in range(0, 300, 20)]
    assert cost(bands, [[32, 200]] * len(bands)) <= whole
    assert cost([[100, 100, 140, 140]], [[32, 60]]) < 0.1 * whole
    small_low, large_high = [[0, 300, 640, 340], [0, 50, 640, 90]], [[32, 45], [120, 200]]
    apart = sum(cost([region], [heights]) for region, heights in zip(small_low, large_high))
    assert cost(small_low, large_high) == apart < 0.45 * whole
    assert cost([], np.zeros((0, 2))) == 0


def test_detector_finds_what_the_pyramid_finds(model, detector):
    pixels = scene(320, 640, HEADS)
    found = detector.detect(image_of(pixels), Search.everywhere(image_of(pixels), 32, 200))
    expected = detect(model, pixels, 32, 200, THRESHOLD)
    np.testing.assert_allclose(found.corners, expected.corners, atol=1e-3)
    np.testing.assert_allclose(found.scores, expected.scores, atol=1e-4)
    assert detector.part == "head" and detector.box.height == pytest.approx(0.245)


def test_detector_tells_only_what_is_searched_for(detector):
    image = image_of(scene(320, 640, HEADS))
    for head in HEADS:
        near = Search(
            np.array([[head[0] - 15, head[1] - 15, head[0] + 15, head[1] + 15]]),
            np.array([[head[2] * 0.8, head[2] * 1.25]]),
        )
        found = detector.detect(image, near)
        assert len(found.scores) == 1 and shared_with(found, [head]) > 0.65


@pytest.mark.parametrize("shift", [0, 61, 90, 120, 333])
def test_head_on_the_seam_of_a_panorama_is_found_once(detector, shift):
    pixels = np.roll(scene(320, 640, HEADS), -shift, axis=1)
    image = Image(1, "camera", pixels, Panorama(PanoramaConfig(width=640, height=320)))
    found = detector.detect(image, Search.everywhere(image, 32, 200))
    assert len(found.scores) <= len(HEADS) + 1
    middles = 0.5 * (found.corners[:, 0] + found.corners[:, 2])
    assert ((middles >= 0) & (middles < 640)).all()
    for x, _, height in HEADS:
        expected = (x - shift) % 640
        near = np.abs((middles - expected + 320) % 640 - 320) < 0.15 * height
        assert near.sum() == 1


@pytest.mark.parametrize("size", [(1, 1), (1, 700), (39, 41), (40, 40), (41, 300), (2000, 37)], ids=str)
def test_small_and_long_images_are_looked_at(model, detector, size):
    image = image_of(clutter(*size, np.random.default_rng(0)))
    found = detector.detect(image, Search.everywhere(image, 1.0, 5000.0))
    assert found.corners.shape == (len(found.scores), 4)
    assert detect(model, image.pixels, 1.0, 5000.0, -5.0).corners.shape[1] == 4


def test_heads_smaller_than_the_model_are_found_in_enlarged_images(model, tmp_path):
    small = [(70.0, 60.0, 20.0), (200.0, 90.0, 21.0), (120.0, 90.0, 44.0)]
    path = tmp_path / "painted.npz"
    model.save(path)
    image = image_of(scene(140, 260, small))
    shares = {}
    for enlarge in (1.0, 2.0):
        detector = FhogHead(FhogHeadConfig(model=str(path), threshold=THRESHOLD, enlarge=enlarge))
        shares[enlarge] = shared_with(detector.detect(image, Search.everywhere(image, 16, 100)), small)
    assert (shares[1.0] > 0.4).tolist() == [False, False, True]
    assert shares[2.0].min() > 0.6


def test_images_are_enlarged_as_far_as_is_allowed_and_by_the_same_scales():
    for enlarge in (1.0, 1.5, 2.0, 4.0):
        numbers = head_numbers(WINDOW, 1.0, 100.0, 5, enlarge)
        assert numbers[0] == -int(5 * np.log2(enlarge))
        np.testing.assert_array_equal(numbers[numbers >= 0], head_numbers(WINDOW, 1.0, 100.0, 5))


def test_no_image_is_enlarged_unless_asked_for(detector):
    image = image_of(clutter(200, 200, np.random.default_rng(0)))
    layers = searched_pyramid(image.pixels, WINDOW, Search.everywhere(image, 0.01, 1e9))
    assert max(layer.features.shape[0] for layer in layers) == 50
    assert detector.detect(image, Search(np.zeros((0, 4)), np.zeros((0, 2)))).corners.shape == (0, 4)


def test_detector_without_a_model_says_so(tmp_path):
    with pytest.raises(ConfigError, match=r"nothing\.npz"):
        FhogHead(FhogHeadConfig(model=str(tmp_path / "nothing.npz")))
