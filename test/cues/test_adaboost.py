"""Boosted stumps and the model that they are kept in."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.core.errors import ConfigError, DataError
from people_fusion.core.scans import Scan
from people_fusion.cues.legs.adaboost import Stumps, adaboost
from people_fusion.cues.legs.classifier import LegModel, load_leg_model
from people_fusion.cues.legs.features import NAMES
from people_fusion.cues.legs.segments import segment


def clouds(seed, count=200, features=4):
    rng = np.random.default_rng(seed)
    labels = rng.random(count) < 0.3
    labels[:2] = True, False
    examples = rng.normal(size=(count, features)) + labels[:, None] * rng.normal(scale=1.5, size=features)
    return examples, labels


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000))
def test_every_round_is_that_of_table_1_read_literally(seed):
    """No other stump has a larger r; alpha and the weights are as printed."""
    examples, labels = clouds(seed, 60, 3)
    stumps = adaboost(examples, labels, 6, np.arange(3))
    signs = np.where(labels, 1.0, -1.0)
    weights = np.where(labels, 0.5 / labels.sum(), 0.5 / (~labels).sum())
    for feature, threshold, parity, alpha in zip(*(getattr(stumps, n) for n in Stumps.__dataclass_fields__)):
        weights = weights / weights.sum()
        best = 0.0
        for column in examples.T:
            values = np.unique(column)
            for cut in 0.5 * (values[1:] + values[:-1]):
                r = (weights * signs * np.where(column < cut, 1.0, -1.0)).sum()
                best = max(best, abs(r))
        says = np.where(parity * examples[:, feature] < parity * threshold, 1.0, -1.0)
        r = (weights * signs * says).sum()
        assert r == pytest.approx(best, abs=1e-9)
        if r < 1 - 1e-9:
            assert alpha == pytest.approx(0.5 * np.log((1 + r) / (1 - r)))
        weights = weights * np.exp(-alpha * signs * says)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), rounds=st.integers(1, 40))
def test_scores_are_the_weighted_vote_of_all_stumps(seed, rounds):
    examples, labels = clouds(seed)
    stumps = adaboost(examples, labels, rounds, np.arange(4))
    fresh, _ = clouds(seed + 1)
    vote = np.zeros(len(fresh))
    for feature, threshold, parity, weight in zip(*(getattr(stumps, n) for n in Stumps.__dataclass_fields__)):
        vote += weight * np.where(parity * fresh[:, feature] < parity * threshold, 1.0, -1.0)
    np.testing.assert_allclose(stumps.scores(fresh), vote / stumps.weights.sum(), atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_boosting_equals_scikit_learns(oracle_python, seed):
    """Its AdaBoost, given the same weak learner and the weights of table 1 to begin with."""
    examples, labels = clouds(seed, 150, 3)
    question = json.dumps({"examples": examples.tolist(), "labels": labels.tolist(), "rounds": 15})
    answer = subprocess.run(
        [oracle_python, str(Path(__file__).parent / "oracle_adaboost.py")],
        input=question, capture_output=True, text=True, check=True,
    )  # fmt: skip
    stumps = adaboost(examples, labels, 15, np.arange(3))
    np.testing.assert_allclose(stumps.scores(examples), json.loads(answer.stdout), atol=1e-9)


def test_what_can_be_told_by_one_threshold_is_told_at_once():
    examples = np.arange(10.0)[:, None]
    stumps = adaboost(examples, examples[:, 0] > 6, 1, np.array([0]))
    assert stumps.thresholds[0] == 6.5 and stumps.parities[0] == -1
    np.testing.assert_array_equal(stumps.scores(examples) > 0, examples[:, 0] > 6)


def test_columns_that_are_not_allowed_are_not_used():
    examples, labels = clouds(1)
    examples[:, 2] = labels
    assert set(adaboost(examples, labels, 20, np.array([0, 1])).features.tolist()) <= {0, 1}


@pytest.mark.parametrize("labels", [np.ones(5, bool), np.zeros(5, bool)])
def test_one_class_alone_cannot_be_learned(labels):
    with pytest.raises(DataError):
        adaboost(np.random.default_rng(0).normal(size=(5, 2)), labels, 3, np.array([0]))


def test_a_feature_that_is_not_finite_is_refused():
    with pytest.raises(DataError, match="finite"):
        adaboost(np.array([[np.nan], [1.0]]), np.array([True, False]), 3, np.array([0]))


def test_what_nothing_tells_apart_ends_boosting():
    with pytest.raises(DataError, match="tells"):
        adaboost(np.ones((6, 1)), np.arange(6) < 3, 3, np.array([0]))


@pytest.fixture
def model():
    rng = np.random.default_rng(0)
    labels = np.arange(80) < 40
    examples = rng.normal(size=(80, len(NAMES))) + labels[:, None]
    stumps = adaboost(examples, labels, 12, np.arange(len(NAMES)))
    return LegModel(stumps, 4.0, -1.0, 0.1, 0.12, 2.5, {"command": "none"})


def segments():
    ranges = np.repeat([1.0, 2.0, 4.0, 1.5, 3.0], [2, 8, 30, 6, 5])
    return segment(Scan(0, "laser", ranges, -0.3, 0.01, 0.1, 10.0), ranges, 0.12)


def test_a_saved_model_is_the_same_model(tmp_path, model):
    model.save(tmp_path / "a.json")
    again = load_leg_model(tmp_path / "a.json")
    np.testing.assert_array_equal(again.scores(segments()), model.scores(segments()))
    np.testing.assert_array_equal(again.probabilities(segments()), model.probabilities(segments()))
    again.save(tmp_path / "b.json")
    assert (tmp_path / "a.json").read_bytes() == (tmp_path / "b.json").read_bytes()


def test_segments_of_two_points_are_not_judged(model):
    found = segments()
    assert found.counts[0] == 2
    assert model.scores(found)[0] == -1.0 and model.probabilities(found)[0] == model.prior


def test_a_scan_without_segments_has_no_probabilities(model):
    ranges = np.full(5, np.nan)
    nothing = segment(Scan(0, "laser", ranges, 0.0, 0.1, 0.1, 10.0), ranges, 0.1)
    assert model.probabilities(nothing).shape == (0,)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (lambda c: c.update(format=2), "format"),
        (lambda c: c.pop("stumps"), "stumps"),
        (lambda c: c.update(stumps=[]), "no stumps"),
        (lambda c: c["stumps"][0].update(feature="colour"), "damaged"),
        (lambda c: c["stumps"][0].update(threshold=float("nan")), "finite"),
        (lambda c: c["calibration"].update(slope="steep"), "damaged"),
    ],
)
def test_a_damaged_model_is_refused_by_name(tmp_path, model, damage, message):
    path = tmp_path / "model.json"
    model.save(path)
    content = json.loads(path.read_text())
    damage(content)
    path.write_text(json.dumps(content))
    with pytest.raises(ConfigError, match=message) as error:
        load_leg_model(path)
    assert "model.json" in str(error.value)


def test_a_missing_model_is_refused_by_name(tmp_path):
    with pytest.raises(ConfigError, match="nowhere"):
        load_leg_model(tmp_path / "nowhere.json")
