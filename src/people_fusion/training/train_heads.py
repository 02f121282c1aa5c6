"""The command `train_heads`: learn what a head looks like, and tell how well heads are found."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path
from typing import Any, Dict, List, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from people_fusion.core.config import load_yaml, parse
from people_fusion.core.errors import ConfigError, RecordingError
from people_fusion.cues.heads.boxes import Boxes
from people_fusion.cues.heads.detectors.dnn import DnnFace, DnnFaceConfig
from people_fusion.cues.heads.detectors.haar import HaarFace, HaarFaceConfig
from people_fusion.cues.heads.head_model import HeadModel
from people_fusion.evaluation.detection import det_curve
from people_fusion.evaluation.tables import Table
from people_fusion.replay.results import guarded, settings, write_json
from people_fusion.training.head_learning import Example, learn
from people_fusion.training.head_peers import faces, reference
from people_fusion.training.head_plots import plot_det
from people_fusion.training.head_sources import Photograph, digest, photographs
from people_fusion.training.head_trials import (
    MODELS,
    HeadRecipeConfig,
    Split,
    Target,
    calibrated,
    cross_validated,
    matches,
    rates,
    score_table,
    see,
    targets,
)

LOWEST_FACE = 0.1  # score of YuNet that a curve goes down to


class Trained(NamedTuple):
    """What became of one recipe: its detections in photographs it had not seen, and its model if it was asked for."""

    boxes: List[Boxes]
    model: Optional[HeadModel]


def main(arguments: Optional[List[str]] = None) -> int:
    """Entry of scripts/train_heads; returns the exit status."""
    options = _parser().parse_args(arguments)
    errors = Console(stderr=True)
    return guarded("train_heads", lambda: run(options, errors), errors)


def run(options: argparse.Namespace, notes: Console) -> None:
    """Read, learn, test, print and write what was asked for.

    Raises:
        PeopleFusionError: a recipe or something that it names is not usable.
    """
    recipes = {path.stem: load_recipe(path) for path in options.recipes}
    first = next(iter(recipes.values()))
    if any(_material(recipe) != _material(first) for recipe in recipes.values()):
        raise ConfigError("recipes that are compared must use the same photographs, least size, folds and seed")
    images = photographs(options.data / first.photographs, first.largest_side, first.leave_out)
    if len(images) < first.folds:
        raise RecordingError(f"{options.data / first.photographs}: {len(images)} photographs for {first.folds} folds")
    if options.thesis:
        _tell(_thesis(images, first, options.thesis, notes), options.tables)
        return
    wanted = targets(first.least)
    trials: Dict[str, Sequence[Boxes]] = {}
    for name, recipe in recipes.items():
        trained = train(name, recipe, images, options.out is not None, notes)
        trials[f"{name}: {recipe.window.window().name}"] = trained.boxes
        if trained.model is not None:
            path = options.out / f"{name}.npz"
            _save(trained.model, path)
            print(path)
    if options.peers is not None:
        trials.update(_peers(images, options.peers, first, notes))
    _tell([("Heads that no model has seen before", score_table(images, trials, wanted))], options.tables)
    if options.det is not None:
        curves = {name: det_curve(matches(images, boxes, wanted[0])) for name, boxes in trials.items()}
        plot_det(curves, f"Bare upright heads of {first.least:.0f} pixels and more; log-average miss rate", options.det)
        print(options.det)
    if options.json is not None:
        write_json(options.json, {name: rates(images, boxes, wanted) for name, boxes in trials.items()})


def train(
    name: str, recipe: HeadRecipeConfig, images: Sequence[Photograph], wants_model: bool, notes: Console
) -> Trained:
    """Cross-validate a recipe and, if it is wanted, learn its model from all photographs.

    Raises:
        DataError: there is nothing to learn from.
    """
    with _progress(notes) as progress:
        task = progress.add_task(f"{name}: cells", total=len(images))
        examples = see(images, recipe, lambda: progress.advance(task))
        task = progress.add_task(f"{name}: folds", total=recipe.folds + wants_model)
        boxes = cross_validated(images, examples, recipe, lambda: progress.advance(task))
        model = None
        if wants_model:
            model = _model(name, recipe, images, examples, boxes)
            progress.advance(task)
    return Trained(boxes, model)


def load_recipe(path: Path) -> HeadRecipeConfig:
    """A recipe from YAML.

    Raises:
        ConfigError: names the file and the parameter that is refused.
    """
    try:
        return parse(HeadRecipeConfig, load_yaml(path))
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error


def _model(
    name: str,
    recipe: HeadRecipeConfig,
    images: Sequence[Photograph],
    examples: Sequence[Example],
    boxes: Sequence[Boxes],
) -> HeadModel:
    model = learn(examples, recipe.window.window(), recipe.learning, np.random.default_rng(recipe.seed))
    model = calibrated(model, images, boxes, Target("its own", recipe.classes, recipe.least))
    provenance = {
        "command": f"train_heads {name}.yaml --data DATA --out DIR",
        "photographs": len(images),
        "heads": int(sum(seen.considered.sum() for seen in examples)),
        "sha256": digest(images),
        "log_average_miss_rates": rates(images, boxes, targets(recipe.least)),
        "recipe": settings(recipe),
    }
    return dataclasses.replace(model, provenance=provenance)


def _peers(
    images: Sequence[Photograph], data: Path, recipe: HeadRecipeConfig, notes: Console
) -> Dict[str, Sequence[Boxes]]:
    """Detectors of others; what is not there is told and left out."""
    paths = sorted((data / "head_svm_reference").glob("svm-*"))
    bare = targets(recipe.least)[0].classes
    found: Dict[str, Sequence[Boxes]] = {}
    with _progress(notes) as progress:
        task = progress.add_task("others", total=len(paths) + 2)
        for path in paths:
            found[f"Poschmann's {path.name[4:]}"] = reference(path, images, recipe.least)
            progress.advance(task)
        found["haar_face"] = faces(HaarFace(HaarFaceConfig(neighbours=1)), images, bare, recipe.least)
        progress.advance(task)
        try:
            network = DnnFace(DnnFaceConfig(str(data / "models/yunet_n_320_320.onnx"), threshold=LOWEST_FACE))
            found["dnn_face (YuNet)"] = faces(network, images, bare, recipe.least)
        except ConfigError as error:
            notes.print(f"without YuNet: {error}", markup=False)
        progress.advance(task)
    return found


def _thesis(
    images: Sequence[Photograph], recipe: HeadRecipeConfig, every: int, notes: Console
) -> List[Tuple[str, Table]]:
    """Tables in the form of the thesis's 4.1 to 4.5, on every nth photograph, one fold."""
    with _progress(notes) as progress:
        task = progress.add_task("the thesis's tables", total=MODELS)
        split = Split(images[::every], recipe, lambda: progress.advance(task))
        return [
            ("Rounds of hard negatives (table 4.1)", split.bootstrapping()),
            ("Window sizes (table 4.2)", split.window_sizes()),
            ("Feature types (table 4.3)", split.feature_types()),
            ("Training classes, FHOG9 4x10 (table 4.4)", split.training_classes()),
            ("Features and training classes, tested on all heads (table 4.5)", split.features_and_classes()),
        ]


def _material(recipe: HeadRecipeConfig) -> Tuple[Any, ...]:
    return (recipe.photographs, recipe.leave_out, recipe.largest_side, recipe.least, recipe.folds, recipe.seed)


def _tell(tables: Sequence[Tuple[str, Table]], path: Optional[Path]) -> None:
    """Print tables, and write them as Markdown where that is wanted."""
    for title, table in tables:
        print(f"{title}\n\n{table.as_text()}\n")
    if path is not None:
        _write(path, "".join(f"\n## {title}\n\n{table.as_markdown()}\n" for title, table in tables)[1:])
        print(path)


def _save(model: HeadModel, path: Path) -> None:
    try:
        model.save(path)
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error


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
    parser = argparse.ArgumentParser(prog="train_heads", description=__doc__)
    add = parser.add_argument
    add("recipes", type=Path, nargs="+", metavar="recipe", help="YAML file; several are compared")
    add("--data", type=Path, default=Path(), metavar="DIR", help="folder that the recipes' paths are relative to")
    add("--out", type=Path, metavar="DIR", help="learn from all photographs; one model a recipe, of its name")
    add("--peers", type=Path, metavar="DIR", help="compare others: folder with head_svm_reference/ and models/")
    add("--thesis", type=int, default=0, metavar="N", help="instead, the thesis's tables, on every Nth photograph")
    add("--tables", type=Path, metavar="MD", help="write the tables as Markdown")
    add("--det", type=Path, metavar="PNG", help="picture of the DET curves")
    add("--json", type=Path, metavar="FILE", help="write the figures")
    return parser
