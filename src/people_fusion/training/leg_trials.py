"""How well legs are told from what is none: rates, curves, and tables in the form of Arras et al. 2012, 2.3."""

from __future__ import annotations

from typing import Dict, List, Mapping, NamedTuple, Tuple

import numpy as np
from scipy.stats import rankdata

from people_fusion.cues.legs.adaboost import Stumps
from people_fusion.cues.legs.features import NAMES, PAPER
from people_fusion.evaluation.tables import UNDEFINED, Table

BEST = 5  # features that are named, as in table 6
# The manually designed classifier of 2.3.3.
LEAST_JUMP_M = 0.3
LEG_WIDTHS_M = (0.05, 0.5)
LEAST_POINTS = 4
LEAST_MOTION_M = 0.02
LARGEST_DEVIATION_M = 0.5


class Trial(NamedTuple):
    """A classifier's scores (N,) of examples that it has not seen, and what they are (N,)."""

    scores: np.ndarray
    labels: np.ndarray


def area(trial: Trial) -> float:
    """Area under the ROC curve: how often a leg scores higher than what is none; NaN without both."""
    positives, negatives = int(trial.labels.sum()), int((~trial.labels).sum())
    if not positives or not negatives:
        return float("nan")
    ranks = rankdata(trial.scores)
    return float((ranks[trial.labels].sum() - positives * (positives + 1) / 2) / (positives * negatives))


def roc(trial: Trial) -> Tuple[np.ndarray, np.ndarray, float]:
    """False and true positive rates over all thresholds, and the area below."""
    order = np.argsort(-trial.scores, kind="stable")
    hits, scores = trial.labels[order], trial.scores[order]
    last = np.append(scores[1:] < scores[:-1], True)  # those of equal score are told apart by no threshold
    true, false = np.cumsum(hits)[last] / max(int(hits.sum()), 1), np.cumsum(~hits)[last] / max(int((~hits).sum()), 1)
    return np.append(0.0, false), np.append(0.0, true), area(trial)


def summary(trial: Trial) -> Dict[str, float]:
    """Area, and the errors of table 7 for the sign of the score."""
    says = trial.scores > 0.0
    return {
        "auc": area(trial),
        "false_negatives": float((~says[trial.labels]).mean()) if trial.labels.any() else float("nan"),
        "false_positives": float(says[~trial.labels].mean()) if not trial.labels.all() else float("nan"),
        "error": float((says != trial.labels).mean()) if len(says) else float("nan"),
        "legs": int(trial.labels.sum()),
        "others": int((~trial.labels).sum()),
    }


def heuristic(values: np.ndarray) -> np.ndarray:
    """(N,) 1 or -1 of features (N, F): the manually designed classifier of 2.3.3 but for its test of motion."""
    get = {name: values[:, NAMES.index(name)] for name in PAPER}
    is_leg = (get["jump_before"] > LEAST_JUMP_M) & (get["jump_after"] > LEAST_JUMP_M)
    is_leg &= (get["width"] > LEG_WIDTHS_M[0]) & (get["width"] < LEG_WIDTHS_M[1]) & (get["number"] >= LEAST_POINTS)
    is_leg &= get["standard_deviation"] < LARGEST_DEVIATION_M
    return np.where(is_leg, 1.0, -1.0)


def moving_heuristic(values: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """(N,) 1 or -1: all of 2.3.3; `moved` (N,) metres by which one beam of the segment moved at most."""
    return np.where(moved > LEAST_MOTION_M, heuristic(values), -1.0)


def error_table(trials: Mapping[str, Trial]) -> Table:
    """Areas and errors as in tables 7 and 8."""
    rows = []
    for name, trial in trials.items():
        entry = summary(trial)
        cells = [f"{entry['auc']:.3f}" if np.isfinite(entry["auc"]) else UNDEFINED]
        cells += [percent(entry[key]) for key in ("false_negatives", "false_positives", "error")]
        rows.append((name, *cells, str(entry["legs"]), str(entry["others"])))
    return Table(("", "ROC area", "false neg.", "false pos.", "error", "legs", "others"), tuple(rows))


def confusion_table(trials: Mapping[str, Trial]) -> Table:
    """Tables 2 to 5 for the sign of the score: true label in rows, detected label in columns."""
    rows = []
    for name, (scores, labels) in trials.items():
        says = scores > 0.0
        for label, members in (("person", labels), ("no person", ~labels)):
            total = max(int(members.sum()), 1)
            counts = [int((says[members] == verdict).sum()) for verdict in (True, False)]
            cells = (f"{count} ({100 * count / total:.2f} %)" for count in counts)
            rows.append((f"{name}: {label}", *cells, str(int(members.sum()))))
    return Table(("true label", "person", "no person", "total"), tuple(rows))


def feature_table(classifiers: Mapping[str, Stumps]) -> Table:
    """Table 6: the features of largest weight, in which round each was chosen, and on which side a leg lies."""
    rows: List[Tuple[str, ...]] = []
    for name, stumps in classifiers.items():
        for rank, entry in enumerate(np.argsort(-stumps.weights, kind="stable")[:BEST].tolist(), start=1):
            feature = int(stumps.features[entry])
            side = "<" if stumps.parities[entry] > 0 else ">"
            threshold = f"{side} {stumps.thresholds[entry]:.3g}"
            place = (str(rank), str(entry + 1), number(feature), NAMES[feature])
            rows.append((name if rank == 1 else "", *place, threshold, f"{stumps.weights[entry]:.2f}"))
    return Table(("classifier", "rank", "round", "#", "feature", "a leg if", "weight"), tuple(rows))


def number(feature: int) -> str:
    """The paper's number of a feature; none of ours."""
    return str(feature + 1) if feature < len(PAPER) else UNDEFINED


def percent(share: float) -> str:
    """Share of 1 in percent, as precise as the paper."""
    return f"{100 * share:.2f} %" if np.isfinite(share) else UNDEFINED
