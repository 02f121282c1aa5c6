"""Learning heads from photographs, and telling how well they are found."""

import json
from types import SimpleNamespace

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError, DataError
from people_fusion.cues.heads.boxes import Boxes, overlaps
from people_fusion.cues.heads.fhog import FhogConfig, fhog
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow, load_head_model
from people_fusion.cues.heads.pyramid import detect, window_features
from people_fusion.training.head_learning import (
    LearningConfig,
    Mirror,
    example,
    found,
    hard_negatives,
    learn,
    mirrored_cell,
    near_heads,
    random_negatives,
)
from people_fusion.training.head_peers import faces
from people_fusion.training.head_sources import Photograph, photographs, squares
from people_fusion.training.head_trials import (
    MODELS,
    HeadRecipeConfig,
    Split,
    calibrated,
    cross_validated,
    lamr,
    matches,
    see,
    targets,
)
from people_fusion.training.train_heads import load_recipe, main

cv2 = pytest.importorskip("cv2")

WINDOW = HeadWindow(FhogConfig(), 8, 8, (0.0, 0.0, 8.0, 8.0))
FAST = LearningConfig(rounds=1, penalty=0.1)


def photograph(number):
    """Bright discs with two dark dots among bright rectangles: heads, one of each class."""
    rng = np.random.default_rng(number)
    grey = rng.normal(90, 8, (140, 220))
    for _ in range(3):
        left, top, width, height = rng.integers([0, 0, 15, 15], [180, 100, 60, 60])
        grey[top : top + height, left : left + width] = rng.uniform(120, 220)
    grey = np.ascontiguousarray(grey.clip(0, 255).astype(np.uint8))
    boxes = []
    for left in (20, 130):
        size = int(rng.integers(44, 60))
        x, y = left + int(rng.integers(0, 15)), int(rng.integers(15, 60))
        middle = (x + size // 2, y + size // 2)
        cv2.ellipse(grey, middle, (int(size * 0.42), size // 2), 0, 0, 360, 230, -1)
        for side in (-1, 1):
            cv2.circle(grey, (middle[0] + side * size // 6, y + size // 3), size // 12, 40, -1)
        boxes.append([x + 0.08 * size, y, x + 0.92 * size, y + size])
    return Photograph(f"{number:02}.png", grey, np.array(boxes), np.array(["head", "helmet"]))


@pytest.fixture(scope="module")
def images():
    return [photograph(number) for number in range(16)]


@pytest.fixture(scope="module")
def examples(images):
    return [example(image, WINDOW, ["head", "helmet"], 40.0) for image in images]


@pytest.fixture(scope="module")
def model(examples):
    return learn(examples[:12], WINDOW, FAST, np.random.default_rng(1))


def test_heads_of_photographs_not_seen_before_are_found(model, images, examples):
    for image, seen in zip(images[12:], examples[12:]):
        _, boxes = found(model, seen, 0.0)
        assert overlaps(squares(image.boxes), boxes.corners).max(axis=1).min() > 0.6


@pytest.mark.parametrize(
    "features",
    [FhogConfig(), FhogConfig(bins=9), FhogConfig(bins=5, unsigned=False), FhogConfig(bins=4, signed=False)],
)
def test_cells_of_a_mirrored_image_are_the_mirrored_cells(features):
    pixels = np.random.default_rng(0).integers(0, 256, (32, 48)).astype(np.uint8)
    there = fhog(np.ascontiguousarray(pixels[:, ::-1]), features)
    here = fhog(pixels, features)[:, ::-1][:, :, mirrored_cell(features)]
    # Gradients midway between two directions fall to one of them, so that the mirror image is not exact.
    assert np.abs(there - here).mean() < 0.005 < 0.02 < np.abs(there - fhog(pixels, features)[:, ::-1]).mean()


def test_folded_examples_have_the_scores_of_their_means_with_their_mirror_images():
    rng = np.random.default_rng(2)
    window = HeadWindow(FhogConfig(bins=3), 3, 5, (1.0, 0.0, 4.0, 3.0))
    cells = rng.random((4, 3, 5, 13)).astype(np.float32)
    mirrored = cells[:, :, ::-1][..., mirrored_cell(window.features)]
    mirror = Mirror(window)
    np.testing.assert_allclose(mirror.fold(cells), mirror.fold(mirrored), rtol=1e-6)
    weights = rng.normal(size=mirror.fold(cells).shape[1])
    unfolded = mirror.unfold(weights)
    np.testing.assert_allclose(unfolded, unfolded[:, ::-1][..., mirrored_cell(window.features)], rtol=1e-6)
    expected = 0.5 * ((cells + mirrored) * unfolded).sum(axis=(1, 2, 3))
    np.testing.assert_allclose(mirror.fold(cells) @ weights, expected, rtol=1e-4)
    assert np.linalg.norm(unfolded) == pytest.approx(np.linalg.norm(weights), rel=1e-6)


def test_positives_lie_on_heads_and_every_head_has_one(examples):
    for seen in examples:
        windows = near_heads(seen, WINDOW, 0.7)
        shared = overlaps(windows.corners, seen.truth)
        assert (shared.max(axis=1) >= 0.6).all() and (shared.max(axis=0) >= 0.6).all()
        cells = window_features(windows, seen.layers, WINDOW)
        assert cells.shape == (len(windows.scores), 8, 8, WINDOW.features.dimensions)


def test_negatives_overlap_nothing_marked_and_do_not_score_as_heads_do(model, examples):
    generator = np.random.default_rng(3)
    config = LearningConfig(hard_negatives=5, hard_score=-3.0)
    for seen in examples:
        drawn = random_negatives(seen, WINDOW, config, generator)
        hard = hard_negatives(model, config, np.inf, seen)
        assert 0 < len(drawn.scores) <= 20 and len(hard.scores) <= 5
        for windows in (drawn, hard):
            assert (overlaps(windows.corners, seen.truth) <= 0.3).all()
        high = hard_negatives(model, config, -2.0, seen)
        assert (high.scores < -2.0).all()


def test_nothing_to_learn_from_is_refused(examples):
    with pytest.raises(DataError):
        learn([], WINDOW, FAST, np.random.default_rng(0))
    with pytest.raises(DataError, match="0 positives"):
        nobody = [seen._replace(considered=np.zeros(2, dtype=bool)) for seen in examples[:2]]
        learn(nobody, WINDOW, FAST, np.random.default_rng(0))


def test_cross_validation_never_tests_what_was_learned_from(images, monkeypatch):
    recipe = parse(HeadRecipeConfig, {"folds": 4, "classes": ["head", "helmet"], "learning": {"rounds": 0}})
    examples = see(images, recipe, lambda: None)
    learned = []

    def spy(some, *rest):
        learned.append({id(seen) for seen in some})
        return learn(some, *rest)

    monkeypatch.setattr("people_fusion.training.head_trials.learn", spy)
    boxes = cross_validated(images, examples, recipe, lambda: None)
    assert len(boxes) == 16 and len(learned) == 4
    for seen in examples:
        assert sum(id(seen) in some for some in learned) == 3
    assert lamr(images, boxes, targets(40.0)[2]) < 0.5


def test_half_of_the_finds_with_a_calibrated_score_of_zero_are_heads(model, images):
    """Where heads' scores are those of a known sigmoid, the calibrated model's probabilities are that sigmoid's."""
    rng = np.random.default_rng(4)
    image, target = images[0], targets(40.0)[0]
    several, boxes = [], []
    for _ in range(4000):  # one find an image, on the head that counts or beside it
        score = rng.uniform(-1.0, 3.0)
        is_head = rng.random() < 1.0 / (1.0 + np.exp(-2.5 * (score - 1.2)))
        several.append(image)
        corners = squares(image.boxes)[:1] if is_head else np.array([[0.0, 0.0, 5.0, 5.0]])
        boxes.append(Boxes(corners, np.array([score]), np.array([0.5])))
    better = calibrated(model, several, boxes, target)
    assert better.bias == pytest.approx(model.bias - 1.2, abs=0.1)
    assert better.platt_slope == pytest.approx(-2.5, rel=0.1)
    with pytest.raises(DataError, match="calibrate"):
        calibrated(model, [image], [Boxes.none()], target)


def test_heads_of_other_classes_and_sizes_are_ignored(images):
    exact = [Boxes(squares(image.boxes), np.ones(2), np.ones(2)) for image in images]
    for target, heads in zip(targets(40.0), (16, 16, 32, 16, 0)):
        result = matches(images, exact, target)
        assert result.considered == heads == result.true.sum() == len(result.true)


def test_faces_become_heads(images):
    """A detector of faces that are a known part of the head is as good as one of heads."""

    class Faces:
        def detect(self, image, _):
            number = next(i for i, entry in enumerate(images) if entry.grey is image.pixels)
            heads = squares(images[number].boxes)
            size = heads[:, 3] - heads[:, 1]
            corners = np.column_stack([heads[:, 0] + 0.2 * size, heads[:, 1] + 0.3 * size, heads[:, 2] - 0.2 * size])
            return Boxes(np.column_stack([corners, heads[:, 3] - 0.1 * size]), np.ones(2), np.ones(2))

    boxes = faces(Faces(), images, ["head"], 40.0)
    for image, found_here in zip(images, boxes):
        np.testing.assert_allclose(found_here.corners, squares(image.boxes), atol=1e-6)


def test_tables_of_the_thesis_have_its_rows_and_columns(images):
    recipe = parse(HeadRecipeConfig, {"folds": 2, "learning": {"rounds": 0, "penalty": 0.1}})
    told = []
    split = Split(images, recipe, lambda: told.append(1))
    rounds = split.bootstrapping(rounds=1, seeds=2)
    assert [row[0] for row in rounds.rows] == ["0", "1"] and len(rounds.header) == 7
    classes = split.training_classes()
    assert [row[0] for row in classes.rows] == ["head", "helmet", "head + helmet"]
    assert len(split.feature_types().rows) == 10 and len(split.window_sizes().rows) == 12
    assert [row[0] for row in split.features_and_classes().rows][4] == "FHOG6 4x8"
    assert len(told) == MODELS


@pytest.fixture
def data(tmp_path, images):
    (tmp_path / "heads/images").mkdir(parents=True)
    lines = ["image,class,xmin,ymin,xmax,ymax"]
    for image in images:
        cv2.imwrite(str(tmp_path / "heads/images" / image.name), image.grey)
        lines += [f"{image.name},{kind},{','.join(map(str, box))}" for kind, box in zip(image.classes, image.boxes)]
    (tmp_path / "heads/annotations.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "small.yaml").write_text("{folds: 2, learning: {rounds: 1, penalty: 0.1}}")
    return tmp_path


def test_command_writes_model_table_picture_and_figures_and_the_same_bytes_again(data, capsys):
    out = data / "out"
    out.mkdir()
    arguments = [str(data / "small.yaml"), "--data", str(data), "--out", str(out), "--det", str(data / "det.png")]
    arguments += ["--tables", str(data / "tables.md"), "--json", str(data / "figures.json")]
    assert main(arguments) == 0
    model = load_head_model(out / "small.npz")
    assert model.window.name == "FHOG6 4x8" and model.platt_slope < 0
    assert model.provenance["photographs"] == 16 and model.provenance["heads"] == 16
    assert len(model.provenance["sha256"]) == 64 and model.provenance["command"].startswith("train_heads small.yaml")
    figures = json.loads((data / "figures.json").read_text())
    assert figures["small: FHOG6 4x8"] == model.provenance["log_average_miss_rates"]
    assert figures["small: FHOG6 4x8"]["bare"] < 0.5 and figures["small: FHOG6 4x8"]["bare over 64 px"] is None
    assert "small: FHOG6 4x8" in (data / "tables.md").read_text() and (data / "det.png").stat().st_size > 5000
    assert "LAMR" in capsys.readouterr().out
    first = (out / "small.npz").read_bytes()
    assert main(arguments) == 0
    assert (out / "small.npz").read_bytes() == first


def test_recipes_of_other_photographs_are_not_compared(data, capsys):
    (data / "other.yaml").write_text("{folds: 3}")
    assert main([str(data / "small.yaml"), str(data / "other.yaml"), "--data", str(data)]) == 1
    assert "the same photographs" in capsys.readouterr().err


def test_missing_photographs_are_told(tmp_path, capsys):
    (tmp_path / "recipe.yaml").write_text("{}")
    assert main([str(tmp_path / "recipe.yaml"), "--data", str(tmp_path)]) == 1
    assert "annotations.csv" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"window": {"rows": 12, "cols": 12}}, "heads of 40 pixels"),
        ({"window": {"rows": 8, "cols": 9}}, "square"),
        ({"folds": 1}, "folds"),
        ({"learning": {"speed": 1}}, "learning/speed"),
    ],
)
def test_recipes_that_make_no_sense_are_refused(wrong, told):
    with pytest.raises(ConfigError, match=told):
        parse(HeadRecipeConfig, wrong)


@pytest.mark.parametrize("name", ["heads", "heads_accurate"])
def test_shipped_models_were_made_by_the_shipped_recipes(checkout, name):
    recipe = load_recipe(checkout / f"config/training/{name}.yaml")
    model = load_head_model(checkout / f"config/models/{name}.npz")
    assert isinstance(model, HeadModel) and model.window == recipe.window.window()
    assert SimpleNamespace(**model.provenance).recipe["learning"]["penalty"] == recipe.learning.penalty
    assert model.provenance["log_average_miss_rates"]["bare"] < 0.6


@pytest.mark.parametrize("name", ["heads", "heads_accurate"])
def test_shipped_models_find_most_heads_of_some_photographs_and_little_else(recordings, checkout, name):
    """These they have been learned from: it is the way from the file to the boxes that is tested."""
    recipe = load_recipe(checkout / f"config/training/{name}.yaml")
    some = photographs(recordings / recipe.photographs, recipe.largest_side, recipe.leave_out)[:40]
    model = load_head_model(checkout / f"config/models/{name}.npz")
    boxes = [detect(model, image.grey, recipe.least, float(image.grey.shape[0]), -0.5) for image in some]
    result = matches(some, boxes, targets(recipe.least)[0])
    assert result.considered > 20
    assert result.true.sum() > 0.7 * result.considered
    assert (~result.true).sum() < 0.5 * len(some)
    half = (result.scores > -0.5) & (result.scores < 0.5)
    assert 0.2 < result.true[half].mean() < 0.98
