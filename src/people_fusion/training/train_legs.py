"""The command `train_legs`: learn what a leg looks like, and tell how well that is known."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from scipy.optimize import minimize
from scipy.stats import rankdata

from people_fusion.core.errors import ConfigError
from people_fusion.cues.legs.adaboost import Stumps, adaboost
from people_fusion.cues.legs.classifier import LegModel
from people_fusion.cues.legs.features import NAMES, PAPER
from people_fusion.evaluation.tables import UNDEFINED, Table
from people_fusion.replay.results import guarded, settings, write_json
from people_fusion.training.leg_plots import plot_roc
from people_fusion.training.leg_sources import (
    PAPER_STILL,
    Examples,
    RecipeConfig,
    columns,
    examples,
    load_recipe,
)

PAPER_ROUNDS = 10  # Arras et al. 2012, 2.3
BEST = 5  # features that are named, as in table 6


class Trial(NamedTuple):
    """A classifier's scores (N,) of examples that it has not seen, and what they are (N,)."""

    scores: np.ndarray
    labels: np.ndarray


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/train_legs; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("train_legs", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Read, learn, test, print and write what was asked for.

    Raises:
        PeopleFusionError: the recipe or something that it names is not usable.
    """
    recipe = load_recipe(options.recipe)
    if not recipe.sources:
        raise ConfigError(f"{options.recipe}: no sources")
    with _progress(notes) as progress:
        read = progress.add_task("reading", total=len(recipe.sources))
        sources: Dict[str, Examples] = {}
        for name, source in recipe.sources.items():
            sources[name] = examples(source, recipe, options.data)
            progress.advance(read)
    result: Dict[str, Any] = {"sources": _counts(sources)}
    curves: Dict[str, Trial] = {}
    if recipe.split.train and recipe.split.test:
        curves.update(_experiment(recipe, sources, notes))
        result["split"] = {name: summary(trial) for name, trial in curves.items()}
    if options.transfer:
        moved = _transfer(recipe, sources, notes)
        result["transfer"] = {name: summary(trial) for name, trial in moved.items()}
        curves.update({f"new scanner: {name}": trial for name, trial in moved.items()})
    if options.out is not None:
        model = learn(recipe, sources, _provenance(options, recipe, sources), notes)
        model.save(options.out)
        result["calibration"] = {"slope": model.slope, "offset": model.offset, "prior": model.prior}
        print(options.out)
    if options.roc is not None:
        plot_roc({name: roc(trial) for name, trial in curves.items()}, options.roc)
        print(options.roc)
    if options.json is not None:
        write_json(options.json, result)


def learn(
    recipe: RecipeConfig, sources: Mapping[str, Examples], provenance: Mapping[str, Any], notes: Console
) -> LegModel:
    """A model of all sources; its probability is calibrated on scores of recordings that were left out."""
    with _progress(notes) as progress:
        task = progress.add_task("calibrating", total=len(sources) + 1)
        held_out: List[Trial] = []
        for name in sources:
            rest = joined(entry for other, entry in sources.items() if other != name)
            if rest.labels.any() and not rest.labels.all() and len(sources[name].labels):
                stumps = _boost(rest, recipe)
                held_out.append(Trial(stumps.scores(sources[name].values), sources[name].labels))
            progress.advance(task)
        stumps = _boost(joined(sources.values()), recipe)
        progress.advance(task)
    scores = np.concatenate([trial.scores for trial in held_out])
    labels = np.concatenate([trial.labels for trial in held_out])
    slope, offset = calibrate(scores, labels, recipe.prior)
    return LegModel(stumps, slope, offset, recipe.prior, recipe.jump, recipe.jump_beams, provenance)


def calibrate(scores: np.ndarray, labels: np.ndarray, prior: float) -> Tuple[float, float]:
    """Slope and offset of the sigmoid that makes probabilities of scores (Platt 1999), for a given share of legs."""
    weights = np.where(labels, prior / labels.sum(), (1.0 - prior) / (~labels).sum())
    signs = np.where(labels, 1.0, -1.0)

    def loss(parameters: np.ndarray) -> float:
        return float((weights * np.logaddexp(0.0, -signs * (parameters[0] * scores + parameters[1]))).sum())

    found = minimize(loss, np.array([1.0, np.log(prior / (1.0 - prior))]), method="Nelder-Mead")
    return float(found.x[0]), float(found.x[1])


def joined(entries: Iterable[Examples]) -> Examples:
    """Examples of several sources as one."""
    several = list(entries)
    return Examples(np.concatenate([e.values for e in several]), np.concatenate([e.labels for e in several]))


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
    """(N,) 1 or -1: the manually designed classifier of 2.3.3, without its test of motion: robots move."""
    get = {name: values[:, NAMES.index(name)] for name in PAPER}
    is_leg = (get["jump_before"] > 0.3) & (get["jump_after"] > 0.3)
    is_leg &= (get["width"] > 0.05) & (get["width"] < 0.5) & (get["number"] >= 4)
    is_leg &= get["standard_deviation"] < 0.5
    return np.where(is_leg, 1.0, -1.0)


def _experiment(recipe: RecipeConfig, sources: Mapping[str, Examples], notes: Console) -> Dict[str, Trial]:
    """The recipe's split: our features, the paper's with and without motion, the heuristic (tables 2 to 8)."""
    train = joined(sources[name] for name in recipe.split.train)
    test = joined(sources[name] for name in recipe.split.test)
    ways = {
        "this recipe": (recipe.features, recipe.rounds),
        "paper, features 1 to 13": (PAPER_STILL, PAPER_ROUNDS),
        "paper, with motion": (PAPER, PAPER_ROUNDS),
        "paper's features, as many rounds": (PAPER_STILL, recipe.rounds),
    }
    trials: Dict[str, Trial] = {}
    best: Dict[str, str] = {}
    with _progress(notes) as progress:
        task = progress.add_task("testing", total=len(ways))
        for name, (names, rounds) in ways.items():
            stumps = adaboost(train.values, train.labels, rounds, columns(names))
            trials[name] = Trial(stumps.scores(test.values), test.labels)
            best[name] = ", ".join(_best_features(stumps))
            progress.advance(task)
    trials["heuristic of 2.3.3"] = Trial(heuristic(test.values), test.labels)
    print(f"learned from {', '.join(recipe.split.train)}; tested on {', '.join(recipe.split.test)}")
    print(error_table(trials).as_text())
    print()
    print(confusion_table(trials["this recipe"]).as_text())
    print()
    print(Table(("", f"best {BEST} features"), tuple(best.items())).as_text())
    print()
    return trials


def _transfer(recipe: RecipeConfig, sources: Mapping[str, Examples], notes: Console) -> Dict[str, Trial]:
    """Each scanner with labelled legs, by a model that has seen all others only."""
    scanners: Dict[str, List[str]] = {}
    for name, source in recipe.sources.items():
        scanners.setdefault(source.scanner, []).append(name)
    trials: Dict[str, Trial] = {}
    with _progress(notes) as progress:
        task = progress.add_task("leaving scanners out", total=len(scanners))
        for scanner, names in scanners.items():
            test = joined(sources[name] for name in names)
            train = joined([entry for name, entry in sources.items() if name not in names] or [test])
            if test.labels.any() and train.labels.any() and len(names) < len(sources):
                trials[scanner] = Trial(_boost(train, recipe).scores(test.values), test.labels)
            progress.advance(task)
    print("learned from all scanners but the one that it is tested on")
    print(error_table(trials).as_text())
    print()
    return trials


def error_table(trials: Mapping[str, Trial]) -> Table:
    """Areas and errors as in tables 7 and 8."""
    rows = []
    for name, trial in trials.items():
        entry = summary(trial)
        cells = [f"{entry['auc']:.3f}" if np.isfinite(entry["auc"]) else UNDEFINED]
        for key in ("false_negatives", "false_positives", "error"):
            cells.append(f"{100 * entry[key]:.2f} %" if np.isfinite(entry[key]) else UNDEFINED)
        rows.append((name, *cells, str(entry["legs"]), str(entry["others"])))
    return Table(("", "ROC area", "false neg.", "false pos.", "error", "legs", "others"), tuple(rows))


def confusion_table(trial: Trial) -> Table:
    """Tables 2 to 5 for the sign of the score."""
    says = trial.scores > 0.0
    rows = []
    for name, members in (("leg", trial.labels), ("no leg", ~trial.labels)):
        total = max(int(members.sum()), 1)
        counts = [int((says[members] == verdict).sum()) for verdict in (True, False)]
        rows.append((name, *(f"{count} ({100 * count / total:.2f} %)" for count in counts), str(int(members.sum()))))
    return Table(("true label", "leg", "no leg", "total"), tuple(rows))


def _best_features(stumps: Stumps) -> List[str]:
    order = np.argsort(-stumps.weights, kind="stable")[:BEST]
    return [NAMES[feature] for feature in stumps.features[order].tolist()]


def _boost(entry: Examples, recipe: RecipeConfig) -> Stumps:
    return adaboost(entry.values, entry.labels, recipe.rounds, columns(recipe.features))


def _counts(sources: Mapping[str, Examples]) -> Dict[str, Dict[str, int]]:
    return {
        name: {"legs": int(entry.labels.sum()), "others": int((~entry.labels).sum())}
        for name, entry in sources.items()
    }


def _provenance(
    options: argparse.Namespace, recipe: RecipeConfig, sources: Mapping[str, Examples]
) -> Dict[str, Any]:
    return {
        "command": f"train_legs {options.recipe.name} --data DATA --out {options.out.name}",
        "examples": _counts(sources),
        "recipe": {**settings(recipe), "sources": {name: settings(entry) for name, entry in recipe.sources.items()}},
    }


def _progress(notes: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), console=notes
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="train_legs", description=__doc__)
    add = parser.add_argument
    add("recipe", type=Path, help="YAML file that names the recordings, e.g. config/training/legs.yaml")
    add("--data", type=Path, default=Path(), metavar="DIR", help="folder that the recipe's paths are relative to")
    add("--out", type=Path, metavar="JSON", help="learn from all sources and write the model")
    add("--transfer", action="store_true", help="also test each scanner with a model that has not seen it")
    add("--roc", type=Path, metavar="PNG", help="picture of the ROC curves")
    add("--json", type=Path, metavar="FILE", help="write the figures")
    return parser
