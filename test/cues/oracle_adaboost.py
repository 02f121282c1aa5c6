"""Scores of scikit-learn's AdaBoost over stumps; run by its own Python, JSON in, JSON out."""

import json
import sys

import numpy as np
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.ensemble import AdaBoostClassifier


class Stump(ClassifierMixin, BaseEstimator):
    """The threshold on one feature with the least weighted error; scikit-learn's own trees split by impurity."""

    def fit(self, examples, labels, sample_weight):
        self.classes_ = np.unique(labels)
        signs, best = np.where(labels, 1.0, -1.0), -1.0
        for feature, column in enumerate(examples.T):
            values = np.unique(column)
            for threshold in 0.5 * (values[1:] + values[:-1]):
                r = float((sample_weight * signs * np.where(column < threshold, 1.0, -1.0)).sum())
                if abs(r) > best + 1e-12:
                    best, self.feature_, self.threshold_, self.below_ = abs(r), feature, threshold, r > 0
        return self

    def predict(self, examples):
        return (examples[:, self.feature_] < self.threshold_) == self.below_


question = json.load(sys.stdin)
examples, labels = np.array(question["examples"]), np.array(question["labels"])
weights = np.where(labels, 0.5 / labels.sum(), 0.5 / (~labels).sum())
classifier = AdaBoostClassifier(Stump(), n_estimators=question["rounds"], algorithm="SAMME")
classifier.fit(examples, labels, sample_weight=weights)
# Every vote counts twice there: for one class and against the other.
json.dump((0.5 * classifier.decision_function(examples)).tolist(), sys.stdout)
