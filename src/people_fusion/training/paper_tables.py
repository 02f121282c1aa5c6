"""The experiments of Arras et al. 2012, 2.3, on other recordings: tables 2 to 8.

Everything is learned by ten rounds from the paper's features, in places where the scanner stands, so that what moves is
a person. Other than in the paper, no scan of a recording that is learned from is tested on.
"""

from __future__ import annotations

from typing import Callable, Dict, List, Mapping, NamedTuple, Tuple

import numpy as np

from people_fusion.cues.legs.adaboost import Stumps, adaboost
from people_fusion.cues.legs.features import PAPER
from people_fusion.evaluation.tables import Table
from people_fusion.training.leg_sources import PAPER_STILL, Examples, SplitConfig, columns, joined
from people_fusion.training.leg_trials import (
    Trial,
    confusion_table,
    feature_table,
    heuristic,
    moving_heuristic,
    percent,
    summary,
)

PAPER_ROUNDS = 10  # Arras et al. 2012, 2.3
ALL = "all"
ERRORS = {"false negatives": "false_negatives", "false positives": "false_positives", "total error": "error"}


class Place(NamedTuple):
    """What is learned from in one environment, and what is tested on; all have a scan before."""

    train: Examples
    test: Examples


def places(environments: Mapping[str, SplitConfig], sources: Mapping[str, Examples]) -> Dict[str, Place]:
    """Each environment, and all together where there are several."""
    found = {
        name: Place(*(_with_motion(joined(sources[source] for source in part)) for part in (split.train, split.test)))
        for name, split in environments.items()
    }
    if len(found) > 1:
        parts = tuple(found.values())
        found[ALL] = Place(joined(place.train for place in parts), joined(place.test for place in parts))
    return found


def paper_tables(
    found: Mapping[str, Place], progress: Callable[[], None] = lambda: None
) -> Tuple[List[Tuple[str, Table]], Dict[str, Trial]]:
    """Tables 2 to 8 with their titles, and the trials behind them by name.

    Args:
        found: see `places`.
        progress: called after each classifier that was learned; there are two for each place.

    Raises:
        DataError: a place has not both legs and others to learn from.
    """
    still: Dict[str, Stumps] = {}
    moving: Dict[str, Stumps] = {}
    for name, place in found.items():
        for classifiers, names in ((still, PAPER_STILL), (moving, PAPER)):
            classifiers[name] = adaboost(place.train.values, place.train.labels, PAPER_ROUNDS, columns(names))
            progress()
    same = {name: _trial(still[name], place.test) for name, place in found.items()}
    single = [name for name in found if name != ALL]
    elsewhere = {
        f"{learned}, in {tested}": _trial(still[learned], found[tested].test)
        for learned in single
        for tested in single
        if learned != tested
    }
    with_motion = {name: _trial(moving[name], place.test) for name, place in found.items()}
    by_hand = {name: Trial(heuristic(test.values), test.labels) for name, (_, test) in found.items()}
    by_motion = {
        name: Trial(moving_heuristic(test.values, test.moved), test.labels) for name, (_, test) in found.items()
    }
    tables = [("Tables 2 to 4: confusion, in the environment that was learned", confusion_table(same))]
    if elsewhere:
        tables.append(("Table 5: confusion, learned in one environment, tested in another", confusion_table(elsewhere)))
    named = {**still, **{f"{name}, with motion": stumps for name, stumps in moving.items()}}
    compared = {"heuristic": by_motion, "without its test of motion": by_hand, "AdaBoost": same}
    tables += [
        ("Table 6: the best five features of each classifier", feature_table(named)),
        ("Table 7: comparison with the heuristic of 2.3.3", _side_by_side(compared)),
        ("Table 8: with and without the motion feature", _side_by_side({"without": same, "with": with_motion})),
    ]
    trials = {
        **{f"{name}, paper": trial for name, trial in same.items()},
        **{f"{name}, paper with motion": trial for name, trial in with_motion.items()},
        **{f"{name}, heuristic": trial for name, trial in by_motion.items()},
    }
    return tables, trials


def _side_by_side(ways: Mapping[str, Mapping[str, Trial]]) -> Table:
    """Errors of several ways, by environment: the form of tables 7 and 8."""
    first = next(iter(ways.values()))
    summaries = {way: {name: summary(trial) for name, trial in trials.items()} for way, trials in ways.items()}
    rows = [
        (f"{name}: {error}", *(percent(summaries[way][name][key]) for way in ways))
        for name in first
        for error, key in ERRORS.items()
    ]
    return Table(("", *ways), tuple(rows))


def _trial(stumps: Stumps, test: Examples) -> Trial:
    return Trial(stumps.scores(test.values), test.labels)


def _with_motion(examples: Examples) -> Examples:
    return examples.select(np.isfinite(examples.moved))
