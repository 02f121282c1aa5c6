"""cues.heads.appearance: how single people's heads look."""

from __future__ import annotations

import json
import subprocess

import numpy as np
import pytest
from camera_scenes import Ideal
from score_scenes import scored

from people_fusion.core.head_scores import ScoreLayer, ScoreWindow
from people_fusion.cues.heads.appearance import AppearanceConfig, is_learnt, learn, length, scores_of, train
from people_fusion.cues.heads.fhog import FhogConfig, fhog
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow
from people_fusion.cues.heads.places import Places, Seen, corners_of, interpolated, places_of
from people_fusion.cues.heads.pyramid import Scales

FEATURES = FhogConfig()
WINDOW = ScoreWindow(8, 8, 4, (0.0, 0.0, 8.0, 8.0))
K = length(WINDOW, FEATURES.dimensions)
ALONE = AppearanceConfig(rate=0.1)


def textured(rows=240, cols=320, seed=0):
    """Patches of all sizes, no two places alike."""
    rng = np.random.default_rng(seed)
    pixels = np.zeros((rows, cols))
    for edge in (4, 8, 16, 32):
        coarse = rng.normal(0.0, 1.0, (rows // edge + 1, cols // edge + 1))
        pixels += edge**0.5 * np.kron(coarse, np.ones((edge, edge)))[:rows, :cols]
    return np.clip(128 + 12 * pixels, 0, 255).astype(np.uint8)


def looked_at(pixels, count=6):
    """Cells of an image in several scales."""
    scales, layers = Scales(pixels), []
    for number in range(count):
        smaller, scale = scales.at(0.5 ** (number / 5))
        cells = fhog(smaller, FEATURES)
        shape = cells.shape[0] - 7, cells.shape[1] - 7
        layers.append(ScoreLayer(scale, 0, 0, np.zeros(shape, np.float32), cells))
    return scored(Ideal(pixels.shape[1], pixels.shape[0]), layers, window=WINDOW)


def box(x, y, height):
    return Seen(np.array([[x, y]], dtype=float), np.array([height], dtype=float))


def of_one(places):
    """(1, N) of (N,)."""
    return Places(*(column[None] for column in places))


def examples(people, negatives, dimensions, seed, apart=1.0):
    rng = np.random.default_rng(seed)
    common = rng.uniform(0.0, 0.4, (people, dimensions))
    positives = common + apart * rng.uniform(0.0, 0.4, (people, dimensions))
    beside = common[:, None] + rng.uniform(0.0, 0.4, (people, negatives, dimensions))
    return positives.astype(np.float32), beside.astype(np.float32), rng.random((people, negatives)) < 0.8


CASES = [
    (dimensions, negatives, penalty, apart)
    for dimensions in (1, 2, 5, 40, 300)
    for negatives in (1, 10)
    for penalty in (0.01, 0.3, 10.0)
    for apart in (0.0, 1.0)
]
ORACLE = """
import json, sys
import numpy as np
from sklearn.svm import LinearSVC
found = []
for case in json.load(sys.stdin):
    model = LinearSVC(C=case["penalty"], loss="hinge", tol=1e-8, max_iter=1_000_000)
    model.fit(np.array(case["values"]), [1] + [-1] * (len(case["values"]) - 1))
    found.append([*model.coef_[0].tolist(), float(model.intercept_[0])])
print(json.dumps(found))
"""


def test_models_are_those_of_liblinear(oracle_python):
    cases, ours = [], []
    for seed, (dimensions, negatives, penalty, apart) in enumerate(CASES):
        positives, beside, valid = examples(3, negatives, dimensions, seed, apart)
        valid[:, 0] = True
        ours.extend(train(positives, beside, valid, penalty).astype(float))
        for positive, several, there in zip(positives, beside, valid):
            cases.append({"values": np.vstack([positive[None], several[there]]).tolist(), "penalty": penalty})
    command = [oracle_python, "-W", "ignore", "-c", ORACLE]
    done = subprocess.run(command, input=json.dumps(cases), check=True, stdout=subprocess.PIPE, text=True)
    for case, model, theirs in zip(cases, ours, map(np.array, json.loads(done.stdout))):
        values = np.column_stack([case["values"], np.ones(len(case["values"]))])
        signs = np.where(np.arange(len(values)) > 0, -1.0, 1.0)
        losses = [
            0.5 * weights @ weights + case["penalty"] * np.maximum(0.0, 1.0 - signs * (values @ weights)).sum()
            for weights in (model, theirs)
        ]
        assert losses[0] <= losses[1] + 2e-3 * case["penalty"] * len(values)
        np.testing.assert_allclose(values @ model, values @ theirs, atol=5e-3)


def test_a_separable_example_is_on_the_margin():
    positives, beside, valid = examples(5, 10, 1408, 1)
    valid[:] = True
    models = train(positives, beside, valid, 10.0)
    np.testing.assert_allclose((positives * models[:, :-1]).sum(axis=1) + models[:, -1], 1.0, atol=2e-3)
    assert (np.einsum("tmd,td->tm", beside, models[:, :-1]) + models[:, -1:] <= -1.0 + 2e-3).all()


def test_people_do_not_influence_each_other():
    positives, beside, valid = examples(4, 9, 60, 5)
    together = train(positives, beside, valid, 10.0)
    alone = np.vstack([train(positives[n, None], beside[n, None], valid[n, None], 10.0) for n in range(4)])
    np.testing.assert_allclose(together, alone, atol=2e-3)
    assert train(positives[:0], beside[:0], valid[:0], 10.0).shape == (0, 61)


def test_a_model_knows_its_head_again_and_nothing_around_it():
    scores = looked_at(textured())
    head = places_of(scores, box(160.0, 120.0, 40.0))
    models = learn(np.zeros((1, K), np.float32), scores, head, ALONE, np.random.default_rng(0))
    assert is_learnt(models).tolist() == [True]
    corners = corners_of(scores, Places(*(np.round(column).astype(int) for column in head)))[0]
    middle = 0.5 * (corners[:2] + corners[2:])
    there = places_of(scores, Seen(middle[None], corners[3:] - corners[1:2]))
    assert scores_of(models, scores, of_one(there))[0, 0] == pytest.approx(1.0, abs=0.01)
    angles = np.linspace(0.0, 2.0 * np.pi, 24)
    around = np.column_stack([160.0 + 35.0 * np.cos(angles), 120.0 + 35.0 * np.sin(angles)])
    beside = scores_of(models, scores, of_one(places_of(scores, Seen(around, np.full(24, 40.0)))))
    assert beside.max() < -0.4
    far = scores_of(models, scores, of_one(places_of(scores, box(60.0, 60.0, 36.0))))
    assert far[0, 0] < 0.0


def test_negatives_of_the_second_model_are_harder_than_those_by_chance():
    scores = looked_at(textured(seed=2))
    head = places_of(scores, box(160.0, 120.0, 40.0))
    angles, distances = np.meshgrid(np.linspace(0.0, 6.2, 40), np.linspace(26.0, 55.0, 8))
    around = np.stack([160.0 + distances * np.cos(angles), 120.0 + distances * np.sin(angles)], axis=-1).reshape(-1, 2)
    places = of_one(places_of(scores, Seen(around, np.full(len(around), 40.0))))
    worst = {}
    for pool in (10, 200):
        config = AppearanceConfig(pool=pool)
        maxima = [
            scores_of(
                learn(np.zeros((1, K), np.float32), scores, head, config, np.random.default_rng(seed)), scores, places
            ).max()
            for seed in range(5)
        ]
        worst[pool] = np.mean(maxima)
    assert worst[200] < worst[10] - 0.05


def test_a_model_is_blended_with_what_it_was():
    scores = looked_at(textured())
    head = places_of(scores, box(160.0, 120.0, 40.0))
    before = np.random.default_rng(1).normal(0.0, 0.01, (1, K)).astype(np.float32)
    whole, half, none = (
        learn(before, scores, head, AppearanceConfig(rate=rate), np.random.default_rng(0)) for rate in (1.0, 0.5, 0.0)
    )
    np.testing.assert_array_equal(none, before)
    np.testing.assert_allclose(half, 0.5 * (whole + before), atol=1e-6)
    assert np.abs(whole - before).max() > 1e-3


def test_who_is_not_in_the_image_stays_as_he_is():
    scores = looked_at(textured())
    models = np.random.default_rng(1).normal(0.0, 0.01, (3, K)).astype(np.float32)
    models[2] = 0.0
    boxes = Seen(np.array([[160.0, 120.0], [-50.0, 120.0], [np.nan, np.nan]]), np.array([40.0, 40.0, np.nan]))
    after = learn(models, scores, places_of(scores, boxes), AppearanceConfig(), np.random.default_rng(0))
    assert (after[0] != models[0]).any()
    np.testing.assert_array_equal(after[1:], models[1:])
    nobody = learn(models, scored(Ideal()), places_of(scored(Ideal()), boxes), ALONE, np.random.default_rng(0))
    np.testing.assert_array_equal(nobody, models)


def test_the_same_generator_gives_the_same_models():
    scores = looked_at(textured())
    head = places_of(scores, box(160.0, 120.0, 40.0))
    first, second, third = (
        learn(np.zeros((1, K), np.float32), scores, head, ALONE, np.random.default_rng(seed)) for seed in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, second)
    assert (first != third).any()


def test_scores_of_many_models_between_cells_are_those_of_each_ones_map():
    scores = looked_at(textured(), count=3)
    rng = np.random.default_rng(3)
    models = rng.normal(0.0, 0.05, (4, K)).astype(np.float32)
    middles, heights = rng.uniform([5, 5], [315, 235], (4, 50, 2)), rng.uniform(28.0, 45.0, (4, 50))
    flat = places_of(scores, Seen(middles.reshape(-1, 2), heights.ravel()))
    places = Places(*(column.reshape(4, 50) for column in flat))
    found = scores_of(models, scores, places)
    window = HeadWindow(FEATURES, 8, 8, WINDOW.box)
    for person in range(4):
        weights = models[person, :-1].reshape(8, 8, FEATURES.dimensions)
        model = HeadModel(window, weights, float(models[person, -1]), -1.0, {})
        maps = [model.responses(layer.features) for layer in scores.layers]
        expected = interpolated(maps, Places(*(column[person] for column in places)))
        np.testing.assert_allclose(found[person], expected, atol=1e-4)
    assert np.isnan(found).any() and np.isfinite(found).any()
    assert scores_of(models[:0], scores, Places(*(column[:0] for column in places))).shape == (0, 50)
