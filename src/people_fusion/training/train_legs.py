"""The command `train_legs`: learn what a leg looks like, and tell how well that is known."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any, Dict, List, Mapping, Optional, Tuple

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn
from scipy.optimize import minimize

from people_fusion.core.errors import ConfigError, RecordingError
from people_fusion.cues.legs.adaboost import Stumps, adaboost
from people_fusion.cues.legs.classifier import LegModel
from people_fusion.evaluation.tables import Table
from people_fusion.replay.results import guarded, settings, write_json
from people_fusion.training.leg_plots import plot_roc
from people_fusion.training.leg_sources import (
    PAPER_STILL,
    Examples,
    RecipeConfig,
    columns,
    examples,
    joined,
    load_recipe,
)
from people_fusion.training.leg_trials import (
    Trial,
    confusion_table,
    error_table,
    feature_table,
    heuristic,
    roc,
    summary,
)
from people_fusion.training.paper_tables import PAPER_ROUNDS, paper_tables, places

Titled = Tuple[str, Table]


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
    tables: List[Titled] = []
    if recipe.split.train and recipe.split.test:
        told, trials = _experiment(recipe, sources, notes)
        result["split"] = {name: summary(trial) for name, trial in trials.items()}
        tables += told
        curves.update(trials)
    if recipe.environments:
        told, trials = _paper(recipe, sources, notes)
        result["paper"] = {name: summary(trial) for name, trial in trials.items()}
        tables += told
        curves.update(trials)
    if options.transfer:
        trials = _transfer(recipe, sources, notes)
        result["transfer"] = {name: summary(trial) for name, trial in trials.items()}
        tables.append(("Learned from all scanners but the one that it is tested on", error_table(trials)))
        curves.update({f"new scanner: {name}": trial for name, trial in trials.items()})
    for title, table in tables:
        print(f"{title}\n\n{table.as_text()}\n")
    if options.tables is not None:
        _write(options.tables, "".join(f"\n## {title}\n\n{table.as_markdown()}\n" for title, table in tables)[1:])
        print(options.tables)
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


def _experiment(
    recipe: RecipeConfig, sources: Mapping[str, Examples], notes: Console
) -> Tuple[List[Titled], Dict[str, Trial]]:
    """The recipe's split: our features, the paper's, the heuristic. None looks at motion: robots drive."""
    train = joined(sources[name] for name in recipe.split.train)
    test = joined(sources[name] for name in recipe.split.test)
    ways = {
        "this recipe": (recipe.features, recipe.rounds),
        "paper, features 1 to 13": (PAPER_STILL, PAPER_ROUNDS),
        "paper's features, as many rounds": (PAPER_STILL, recipe.rounds),
    }
    trials: Dict[str, Trial] = {}
    classifiers: Dict[str, Stumps] = {}
    with _progress(notes) as progress:
        task = progress.add_task("testing", total=len(ways))
        for name, (names, rounds) in ways.items():
            classifiers[name] = adaboost(train.values, train.labels, rounds, columns(names))
            trials[name] = Trial(classifiers[name].scores(test.values), test.labels)
            progress.advance(task)
    confusions = dict(trials)
    trials["heuristic of 2.3.3"] = Trial(heuristic(test.values), test.labels)
    title = f"Learned from {', '.join(recipe.split.train)}; tested on {', '.join(recipe.split.test)}"
    tables = [
        (title, error_table(trials)),
        ("Confusion", confusion_table(confusions)),
        ("The best features", feature_table(classifiers)),
    ]
    return tables, trials


def _paper(
    recipe: RecipeConfig, sources: Mapping[str, Examples], notes: Console
) -> Tuple[List[Titled], Dict[str, Trial]]:
    found = places(recipe.environments, sources)
    with _progress(notes) as progress:
        task = progress.add_task("the paper's tables", total=2 * len(found))
        return paper_tables(found, lambda: progress.advance(task))


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
    return trials


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


def _write(path: Path, text: str) -> None:
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error


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
    add("--tables", type=Path, metavar="MD", help="write the tables as Markdown")
    add("--roc", type=Path, metavar="PNG", help="picture of the ROC curves")
    add("--json", type=Path, metavar="FILE", help="write the figures")
    return parser
