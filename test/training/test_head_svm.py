"""The linear SVM."""

import json
import subprocess

import numpy as np
import pytest

from people_fusion.core.errors import DataError
from people_fusion.training.head_svm import Svm, train_svm

ORACLE = """
import json, sys
import numpy as np
from sklearn.svm import LinearSVC
given = json.load(sys.stdin)
values, labels = np.array(given["values"]), np.array(given["labels"])
model = LinearSVC(C=given["C"], loss="squared_hinge", dual=False, tol=1e-10, max_iter=100000, intercept_scaling=1e3)
model.fit(values, labels, sample_weight=np.array(given["weights"]))
print(json.dumps([model.coef_[0].tolist(), float(model.intercept_[0])]))
"""


def clouds(rng, size=6, positives=40, negatives=200, apart=0.8):
    return rng.normal(apart, 1.0, (positives, size)), rng.normal(-apart, 1.0, (negatives, size))


def objective(svm, positives, negatives, penalty):
    count = len(positives) + len(negatives)
    total = 0.5 * svm.weights @ svm.weights
    for values, sign in ((positives, 1.0), (negatives, -1.0)):
        losses = np.maximum(0.0, 1.0 - sign * svm.scores(values)) ** 2
        total += penalty * count * 0.5 / len(values) * losses.sum()
    return total


@pytest.mark.parametrize("penalty", [0.01, 1.0, 10.0])
def test_no_other_weights_are_better(penalty):
    rng = np.random.default_rng(1)
    positives, negatives = clouds(rng)
    svm = train_svm(positives, negatives, penalty)
    best = objective(svm, positives, negatives, penalty)
    for _ in range(50):
        other = Svm(svm.weights + rng.normal(0.0, 1e-3, 6), svm.bias + rng.normal(0.0, 1e-3))
        assert objective(other, positives, negatives, penalty) > best


def test_two_points_on_a_line_have_the_solution_done_by_hand():
    # w/2 w^2 + 2 C (1 - w)^2 with points at -1 and 1: w = 4 C / (1 + 4 C).
    svm = train_svm(np.array([[1.0]]), np.array([[-1.0]]), 10.0)
    assert svm.weights[0] == pytest.approx(40.0 / 41.0) and svm.bias == pytest.approx(0.0, abs=1e-9)


def test_a_start_elsewhere_ends_at_the_same_place():
    positives, negatives = clouds(np.random.default_rng(2))
    plain = train_svm(positives, negatives, 1.0)
    started = train_svm(positives, negatives, 1.0, start=Svm(np.full(6, 3.0), -2.0))
    np.testing.assert_allclose(started.weights, plain.weights, rtol=1e-3, atol=1e-4)


def test_same_examples_give_the_same_bytes():
    positives, negatives = (part.astype(np.float32) for part in clouds(np.random.default_rng(3)))
    first, second = (train_svm(positives, negatives, 10.0) for _ in range(2))
    assert first.weights.tobytes() == second.weights.tobytes() and first.bias == second.bias


def test_empty_class_is_refused():
    with pytest.raises(DataError, match="0 positives and 3 negatives"):
        train_svm(np.zeros((0, 2)), np.zeros((3, 2)), 1.0)


def test_agrees_with_liblinear(oracle_python):
    positives, negatives = clouds(np.random.default_rng(4))
    count = len(positives) + len(negatives)
    weights = np.repeat([0.5 * count / len(positives), 0.5 * count / len(negatives)], [len(positives), len(negatives)])
    given = {
        "values": np.vstack([positives, negatives]).tolist(),
        "labels": [1] * len(positives) + [-1] * len(negatives),
        "weights": weights.tolist(),
        "C": 0.5,
    }
    told = subprocess.run(
        [oracle_python, "-c", ORACLE], input=json.dumps(given), capture_output=True, text=True, timeout=100, check=True
    )
    expected, bias = json.loads(told.stdout)
    svm = train_svm(positives, negatives, 0.5)
    np.testing.assert_allclose(svm.weights, expected, rtol=1e-3, atol=1e-4)
    assert svm.bias == pytest.approx(bias, abs=1e-3)
