"""How well heads are found: cross-validation by photograph, and tables in the form of Poschmann 2018, 4.5."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.cues.heads.boxes import Boxes
from people_fusion.cues.heads.fhog import FhogConfig
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow
from people_fusion.evaluation.detection import Matches, det_curve, log_average_miss_rate, match, miss_rates_at, together
from people_fusion.evaluation.tables import Table, percent
from people_fusion.training.head_learning import Example, LearningConfig, example, found, learn
from people_fusion.training.head_sources import Photograph, considered, folds, squares
from people_fusion.training.train_legs import calibrate

LEAST_SCORE = -1.0  # of detections that a curve is made of (4.5.1)


@dataclass(frozen=True)
class WindowConfig:
    """What a model looks at; the head fills it but for the margins."""

    rows: int = parameter(8, "cells", low=1, high=64)
    cols: int = parameter(8, "cells", low=1, high=64)
    above: float = parameter(0.0, "of the head, cells", low=0.0)
    below: float = parameter(0.0, "of the head, cells", low=0.0)
    beside: float = parameter(0.0, "of the head on each side, cells", low=0.0)
    features: FhogConfig = section(FhogConfig, "of the cells")

    def window(self) -> HeadWindow:
        """The window that models know.

        Raises:
            ConfigError: the margins leave nothing.
        """
        box = (self.beside, self.above, self.cols - self.beside, self.rows - self.below)
        return HeadWindow(self.features, self.rows, self.cols, box)


@dataclass(frozen=True)
class HeadRecipeConfig:
    """Everything that a head model is made of."""

    photographs: str = parameter("heads", "folder with annotations.csv and images/, relative to the data folder")
    leave_out: Tuple[str, ...] = parameter((), "images that are not used")
    largest_side: int = parameter(640, "larger photographs are shrunk to that, pixels", low=64)
    least: float = parameter(40.0, "height of a head that counts, pixels", low=1.0)
    classes: Tuple[str, ...] = parameter(("head",), "of heads that are learned from")
    folds: int = parameter(4, "of cross-validation", low=2, high=50)
    seed: int = parameter(1, "of folds and random negatives", low=0)
    window: WindowConfig = section(WindowConfig, "what the model looks at")
    learning: LearningConfig = section(LearningConfig, "how it learns")

    def __post_init__(self) -> None:
        window = self.window.window()
        if window.head_height > self.least:
            raise ConfigError(f"window: heads of {self.least:.0f} pixels must fill {window.head_height:.0f} or more")
        if abs(window.aspect - 1.0) > 1e-6:
            raise ConfigError("window: what the margins leave for the head must be a square")


class Target(NamedTuple):
    """Which heads should be found; all others are ignored."""

    name: str
    classes: Tuple[str, ...]
    least: float
    largest: float = np.inf


def targets(least: float) -> Tuple[Target, ...]:
    """Heads by class and by size; the first is what models are compared on."""
    return (
        Target("bare", ("head",), least),
        Target("helmet", ("helmet",), least),
        Target("all", ("head", "helmet"), least),
        Target(f"bare {least:.0f}-64 px", ("head",), least, 64.0),
        Target("bare over 64 px", ("head",), 64.0),
    )


def matches(images: Sequence[Photograph], boxes: Sequence[Boxes], target: Target) -> Matches:
    """What became of the detections in photographs, as squares against squares (4.5.1)."""
    several = []
    for image, here in zip(images, boxes):
        heights = image.boxes[:, 3] - image.boxes[:, 1]
        counts = considered(image, target.classes, target.least) & (heights < target.largest)
        several.append(match(here.corners, here.scores, squares(image.boxes), counts))
    return together(several)


def lamr(images: Sequence[Photograph], boxes: Sequence[Boxes], target: Target) -> Optional[float]:
    """Log-average miss rate; None where there is nothing to be found."""
    counts = matches(images, boxes, target)
    return log_average_miss_rate(det_curve(counts)) if counts.considered else None


def rates(images: Sequence[Photograph], boxes: Sequence[Boxes], wanted: Sequence[Target]) -> Dict[str, Optional[float]]:
    """Log-average miss rates by target's name."""
    return {target.name: lamr(images, boxes, target) for target in wanted}


def detections(model: HeadModel, examples: Sequence[Example]) -> List[Boxes]:
    """A model's detections in photographs."""
    return [found(model, seen, LEAST_SCORE)[1] for seen in examples]


def cross_validated(
    images: Sequence[Photograph], examples: Sequence[Example], recipe: HeadRecipeConfig, advance: Callable[[], None]
) -> List[Boxes]:
    """Detections in each photograph by a model that has seen no photograph of its fold."""
    window, generator = recipe.window.window(), np.random.default_rng(recipe.seed)
    fold = folds(images, recipe.folds, generator)
    boxes = [Boxes.none() for _ in images]
    for number in range(recipe.folds):
        model = learn(select(examples, fold != number), window, recipe.learning, generator)
        for index in np.flatnonzero(fold == number).tolist():
            boxes[index] = found(model, examples[index], LEAST_SCORE)[1]
        advance()
    return boxes


def calibrated(model: HeadModel, images: Sequence[Photograph], boxes: Sequence[Boxes], target: Target) -> HeadModel:
    """The model with the sigmoid of detections in photographs that others like it had not seen (eq. 4.2).

    The thesis sets the sigmoid's offset to 0 so that a score of 0 has a probability of 0.5. Here the bias takes the
    offset up, so that 0.5 is true: half of the detections with a score near 0 are heads.
    """
    held_out = matches(images, boxes, target)
    if held_out.true.all() or not held_out.true.any():
        raise DataError("nothing to calibrate with", f"{held_out.true.sum()} of {len(held_out.true)} finds are heads")
    slope, offset = calibrate(held_out.scores, held_out.true, float(held_out.true.mean()))
    return dataclasses.replace(model, bias=model.bias + offset / slope, platt_slope=-slope)


def see(images: Sequence[Photograph], recipe: HeadRecipeConfig, advance: Callable[[], None]) -> List[Example]:
    """Photographs as a recipe's window sees them."""
    seen = []
    for image in images:
        seen.append(example(image, recipe.window.window(), recipe.classes, recipe.least))
        advance()
    return seen


def select(examples: Sequence[Example], which: np.ndarray) -> List[Example]:
    """Some of them, by mask."""
    return [examples[index] for index in np.flatnonzero(which).tolist()]


def score_table(images: Sequence[Photograph], trials: Mapping[str, Sequence[Boxes]], wanted: Sequence[Target]) -> Table:
    """Log-average miss rates of detectors by kind of head, and miss rates on the first kind."""
    header = ("LAMR", *(target.name for target in wanted), f"misses at 0.1, {wanted[0].name}", "at 1")
    rows = []
    for name, boxes in trials.items():
        points = miss_rates_at(det_curve(matches(images, boxes, wanted[0])), np.array([0.1, 1.0])).tolist()
        rows.append((name, *(percent(lamr(images, boxes, target)) for target in wanted), *map(percent, points)))
    counts = [str(matches(images, [Boxes.none()] * len(images), target).considered) for target in wanted]
    return Table(header, (*rows, ("heads", *counts, "", "")))


WINDOWS = ((3, 10), (3, 11), (3, 12), (3, 13), (4, 8), (4, 9), (4, 10), (5, 7), (5, 8), (6, 6), (7, 5), (8, 5))
FEATURES = (
    *(FhogConfig(bins=bins) for bins in range(2, 10)),
    FhogConfig(bins=9, signed=False),
    FhogConfig(bins=9, unsigned=False),
)
STRATEGIES = (("0", 20, 0.0), ("-1", 20, -1.0), ("-1", 100, -1.0))
CLASSES = (("head",), ("helmet",), ("head", "helmet"))
SHAPES = ((4, 4, 10), (4, 4, 8), (4, 5, 8), (6, 4, 10), (6, 4, 8), (6, 5, 8), (9, 4, 10), (9, 4, 8), (9, 5, 8))


class Split:
    """One split of photographs, with which many models are compared.

    Args:
        images: all photographs.
        recipe: of which the tables vary one thing at a time.
        advance: called after each model.
    """

    def __init__(self, images: Sequence[Photograph], recipe: HeadRecipeConfig, advance: Callable[[], None]) -> None:
        test = folds(images, recipe.folds, np.random.default_rng(recipe.seed)) == 0
        self.recipe, self._advance = recipe, advance
        self._train = [image for image, is_test in zip(images, test) if not is_test]
        self._test = [image for image, is_test in zip(images, test) if is_test]

    def rates(
        self, recipe: HeadRecipeConfig, wanted: Sequence[Target], each: Optional[List[float]] = None
    ) -> Tuple[str, ...]:
        """Log-average miss rates; `each` is given those of the first target after every round."""
        train, test = (see(images, recipe, _nothing) for images in (self._train, self._test))

        def told(_: int, model: HeadModel) -> None:
            if each is not None:
                each.append(lamr(self._test, detections(model, test), wanted[0]) or 0.0)

        model = learn(train, recipe.window.window(), recipe.learning, np.random.default_rng(recipe.seed), told)
        boxes = detections(model, test)
        self._advance()
        return tuple(percent(lamr(self._test, boxes, target)) for target in wanted)

    def bootstrapping(self, rounds: int = 4, seeds: int = 2) -> Table:
        """As table 4.1: mean and standard deviation over seeds after each round of hard negatives."""
        columns = []
        for _, hard, score in STRATEGIES:
            runs: List[List[float]] = []
            for seed in range(seeds):
                learning = dataclasses.replace(self.recipe.learning, rounds=rounds, hard_negatives=hard)
                learning = dataclasses.replace(learning, hard_score=score)
                recipe = dataclasses.replace(self.recipe, learning=learning, seed=seed)
                runs.append([])
                self.rates(recipe, self._targets()[:1], runs[-1])
            columns += [np.mean(runs, axis=0), np.std(runs, axis=0)]
        header = ["rounds"]
        for score_name, hard, _ in STRATEGIES:
            header += [f"{hard} over {score_name}", "+-"]
        rows = [(str(number), *(percent(column[number]) for column in columns)) for number in range(rounds + 1)]
        return Table(tuple(header), tuple(rows))

    def window_sizes(self) -> Table:
        """As table 4.2, with this recipe's bins."""
        rows = []
        for cell, cells in WINDOWS:
            recipe = self._with(dataclasses.replace(self.recipe.window.features, cell=cell), cells)
            rows.append((f"{cell}x{cells}", str(cell * cells), *self.rates(recipe, self._targets())))
        return Table(("size", "height", *(target.name for target in self._targets())), tuple(rows))

    def feature_types(self) -> Table:
        """As table 4.3, in windows of 10 cells of 4 pixels."""
        rows = []
        for features in FEATURES:
            rates = self.rates(self._with(features, 10), self._targets())
            rows.append((features.name, str(features.dimensions), *rates))
        return Table(("features", "dimensions", *(target.name for target in self._targets())), tuple(rows))

    def training_classes(self) -> Table:
        """As table 4.4, with bare heads and helmets instead of orientations, which nobody has marked."""
        rows = []
        for classes in CLASSES:
            recipe = dataclasses.replace(self._with(FhogConfig(bins=9), 10), classes=classes)
            rows.append((" + ".join(classes), *self.rates(recipe, self._targets())))
        return Table(("trained on", *(f"tested on {target.name}" for target in self._targets())), tuple(rows))

    def features_and_classes(self) -> Table:
        """As table 4.5: tested on all heads."""
        rows, trained = [], (CLASSES[0], CLASSES[2])
        for bins, cell, cells in SHAPES:
            several: List[str] = []
            for classes in trained:
                recipe = dataclasses.replace(self._with(FhogConfig(cell=cell, bins=bins), cells), classes=classes)
                several += self.rates(recipe, self._targets()[2:3])
            rows.append((f"FHOG{bins} {cell}x{cells}", *several))
        return Table(("features", *(f"trained on {' + '.join(classes)}" for classes in trained)), tuple(rows))

    def _targets(self) -> Tuple[Target, ...]:
        return targets(self.recipe.least)[:3]

    def _with(self, features: FhogConfig, cells: int) -> HeadRecipeConfig:
        return dataclasses.replace(self.recipe, window=WindowConfig(cells, cells, features=features))


MODELS = 3 * 2 + len(WINDOWS) + len(FEATURES) + len(CLASSES) + 2 * len(SHAPES)  # of all tables


def _nothing() -> None:
    pass
