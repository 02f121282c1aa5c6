"""Learning legs from labelled scans, and telling how well."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.special import expit

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError, PeopleFusionError
from people_fusion.core.resources import directory
from people_fusion.core.scans import Scan
from people_fusion.cues.legs.adaboost import Stumps
from people_fusion.cues.legs.classifier import load_leg_model
from people_fusion.cues.legs.features import NAMES
from people_fusion.training import leg_sources
from people_fusion.training.leg_sources import Examples, RecipeConfig, SourceConfig, examples, load_recipe
from people_fusion.training.leg_trials import (
    Trial,
    area,
    confusion_table,
    feature_table,
    heuristic,
    moving_heuristic,
    roc,
)
from people_fusion.training.paper_tables import Place, paper_tables, places
from people_fusion.training.train_legs import calibrate, main

SIMULATED = """
rounds: 30
split: {train: [a], test: [b]}
sources:
  a: {scanner: fine, scenario: hallway, seed: 1, duration_s: 8.0, every: 3}
  b: {scanner: coarse, scenario: hallway, seed: 2, duration_s: 8.0, every: 3, strides: [1, 2]}
"""


@pytest.fixture
def recipe(tmp_path):
    path = tmp_path / "recipe.yaml"
    path.write_text(SIMULATED)
    return path


def test_simulated_legs_are_learned_and_told_again(recipe, tmp_path, capsys):
    out, table, picture = (tmp_path / name for name in ("model.json", "table.json", "roc.png"))
    arguments = [str(recipe), "--out", str(out), "--json", str(table), "--roc", str(picture), "--transfer"]
    assert main(arguments) == 0
    figures = json.loads(table.read_text())
    assert figures["split"]["this recipe"]["auc"] > 0.8
    assert set(figures["transfer"]) == {"fine", "coarse"}
    assert picture.stat().st_size > 5000
    printed = capsys.readouterr().out
    assert "true label" in printed and "best features" in printed and "heuristic" in printed
    model = load_leg_model(out)
    assert model.provenance["recipe"]["sources"]["b"]["seed"] == 2
    assert model.provenance["examples"]["a"]["legs"] > 20
    first = out.read_bytes()
    assert main(arguments) == 0
    assert out.read_bytes() == first


def test_probabilities_are_calibrated_for_the_prior():
    """Gaussian scores: the right sigmoid is known."""
    rng = np.random.default_rng(0)
    labels = rng.random(40_000) < 0.5
    scores = rng.normal(size=len(labels)) + 2.0 * labels
    slope, offset = calibrate(scores, labels, 0.1)
    assert slope == pytest.approx(2.0, abs=0.1)
    assert offset == pytest.approx(-2.0 + np.log(0.1 / 0.9), abs=0.15)
    weights = np.where(labels, 0.1, 0.9)
    assert np.average(expit(slope * scores + offset), weights=weights) == pytest.approx(0.1, abs=0.005)


def test_area_is_the_share_of_pairs_in_right_order():
    rng = np.random.default_rng(0)
    trial = Trial(np.round(rng.normal(size=60), 1), rng.random(60) < 0.4)
    legs, others = trial.scores[trial.labels][:, None], trial.scores[~trial.labels][None]
    assert area(trial) == pytest.approx(((legs > others) + 0.5 * (legs == others)).mean())


def test_the_area_of_a_curve_is_the_area_below_it():
    rng = np.random.default_rng(1)
    trial = Trial(np.round(rng.normal(size=60), 1), rng.random(60) < 0.4)
    false, true, found = roc(trial)
    assert np.trapz(true, false) == pytest.approx(found)
    assert false[0] == true[0] == 0.0 and false[-1] == true[-1] == 1.0


def test_confusion_counts_add_up():
    trial = Trial(np.array([0.5, -0.5, 0.2, -0.1, -0.3]), np.array([True, True, False, False, False]))
    table = confusion_table({"office": trial})
    assert table.header == ("true label", "person", "no person", "total")  # as in tables 2 to 5
    assert table.rows == (
        ("office: person", "1 (50.00 %)", "1 (50.00 %)", "2"),
        ("office: no person", "1 (33.33 %)", "2 (66.67 %)", "3"),
    )


def test_the_best_features_are_those_of_largest_weight_with_their_side():
    chosen = [NAMES.index(name) for name in ("radius", "width", "across")]
    stumps = Stumps(np.array(chosen), np.array([0.1, 0.2, 0.3]), np.array([1.0, -1.0, 1.0]), np.array([0.5, 0.9, 0.1]))
    assert feature_table({"office": stumps}).rows == (
        ("office", "1", "2", "6", "width", "> 0.2", "0.90"),
        ("", "2", "1", "9", "radius", "< 0.1", "0.50"),
        ("", "3", "3", "–", "across", "< 0.3", "0.10"),
    )


def test_the_heuristic_has_the_papers_thresholds():
    leg = {"jump_before": 0.5, "jump_after": 0.5, "width": 0.1, "number": 6, "standard_deviation": 0.05}
    variants = [{}, {"jump_before": 0.2}, {"width": 0.6}, {"width": 0.04}, {"number": 3}, {"standard_deviation": 0.6}]
    values = np.zeros((len(variants), len(NAMES)))
    for row, variant in enumerate(variants):
        for name, value in {**leg, **variant}.items():
            values[row, NAMES.index(name)] = value
    np.testing.assert_array_equal(heuristic(values), [1, -1, -1, -1, -1, -1])
    moved = np.repeat([[0.03], [0.01]], len(values), axis=1)  # metres, of one beam
    np.testing.assert_array_equal(moving_heuristic(values, moved[0]), heuristic(values))
    np.testing.assert_array_equal(moving_heuristic(values, moved[1]), -np.ones(len(values)))


def in_place(rng, separated_by):
    """Segments of legs and others that differ in one feature only."""
    labels = rng.random(400) < 0.3
    values = rng.normal(size=(400, len(NAMES)))
    values[:, NAMES.index(separated_by)] += 6.0 * labels
    return Examples(values, labels, np.where(labels, 0.1, 0.0))


@pytest.fixture
def tables():
    rng = np.random.default_rng(4)
    found = {name: Place(in_place(rng, name), in_place(rng, name)) for name in ("mean_speed", "radius")}
    told, trials = paper_tables(found)
    return {title.split(":")[0]: table for title, table in told}, trials


def test_only_the_classifier_with_motion_looks_at_motion(tables):
    rows = {row[0]: [float(cell.split()[0]) for cell in row[1:]] for row in tables[0]["Table 8"].rows}
    assert tables[0]["Table 8"].header == ("", "without", "with")
    without, with_motion = rows["mean_speed: total error"]
    assert without > 20.0 and with_motion < 2.0
    assert rows["radius: total error"] == pytest.approx([0.5, 0.5], abs=1.5)
    best = [row for row in tables[0]["Table 6"].rows if row[0]]
    assert [(row[0], row[3]) for row in best if row[4] == "mean_speed"] == [("mean_speed, with motion", "14")]


def test_every_environment_is_tested_with_the_others_classifiers():
    """Two in which legs have another radius are learned from each other; a third tells nothing of them."""
    rng = np.random.default_rng(6)
    differ = {"office": "radius", "corridor": "radius", "hall": "width"}
    told, _ = paper_tables({name: Place(in_place(rng, by), in_place(rng, by)) for name, by in differ.items()})
    (table,) = (table for title, table in told if title.startswith("Table 5"))
    missed = {row[0]: float(row[2].split("(")[1].split()[0]) for row in table.rows if row[0].endswith(": person")}
    assert len(missed) == 6
    assert missed["office, in corridor: person"] < 5.0 and missed["corridor, in office: person"] < 5.0
    assert missed["office, in hall: person"] > 20.0 and missed["corridor, in hall: person"] > 20.0


def test_all_environments_together_are_one_more_and_have_a_scan_before():
    rng = np.random.default_rng(5)
    sources = {name: in_place(rng, "radius") for name in "abcd"}
    sources["a"].moved[:100] = np.nan  # the first scan has none before
    splits = {"x": {"train": ["a"], "test": ["b"]}, "y": {"train": ["c"], "test": ["d"]}}
    config = parse(RecipeConfig, {"sources": {name: {"csv": "."} for name in "abcd"}, "environments": splits})
    found = places(config.environments, sources)
    assert [len(place.train.labels) for place in found.values()] == [300, 400, 700]
    assert list(found) == ["x", "y", "all"]


def test_a_simulated_environment_gives_the_papers_tables(tmp_path, capsys):
    path, tables = tmp_path / "recipe.yaml", tmp_path / "tables.md"
    path.write_text(
        "environments: {corridor: {train: [a], test: [b]}}\n"
        "sources:\n"
        "  a: {scenario: hallway, seed: 1, duration_s: 12.0, every: 2}\n"
        "  b: {scenario: hallway, seed: 2, duration_s: 12.0, every: 2}\n"
    )
    assert main([str(path), "--tables", str(tables)]) == 0
    printed, written = capsys.readouterr().out, tables.read_text()
    for title in ("Tables 2 to 4", "Table 6", "Table 7", "Table 8"):
        assert title in printed and f"## {title}" in written
    assert "| corridor: person" in written and "Table 5" not in written  # there is no other environment


def write_scan(path, legs=((100, 106),)):
    ranges, is_leg = np.full(360, 3.0), np.zeros(360)
    for first, last in legs:
        ranges[first:last], is_leg[first:last] = 1.5, 1
    ranges[200] = 0.0
    table = np.column_stack([np.radians(np.arange(-180, 180)), ranges, is_leg])
    np.savetxt(path, table, delimiter=",", fmt="%.5f")


def test_beside_a_labelled_leg_nothing_is_known_unless_everybody_is_labelled(monkeypatch):
    """A leg at 1.5 m moves 5 cm before a wall at 3 m; another segment lies beside it, one far away."""
    angles = np.radians(np.arange(-90.0, 90.0, 0.5))
    ranges = np.full(len(angles), 3.0)
    ranges[180:186], ranges[195:200], ranges[30:40] = 1.5, 1.6, 1.0

    def labelled(_source, _data):
        for number, shift in enumerate((0.05, 0.0)):
            now = ranges.copy()
            now[180:186] += shift
            scan = Scan(10**9 + number * 10**8, "laser", now, float(angles[0]), float(angles[1] - angles[0]), 0.0, 20.0)
            yield leg_sources._Labelled(scan, None, np.array([[1.5 + shift, 0.03]]))

    monkeypatch.setattr(leg_sources, "_labelled", labelled)
    options = {"bag": "x", "scans": "/scan", "legs": "/legs"}
    few, all_told = (
        examples(parse(SourceConfig, {**options, **more}), parse(RecipeConfig, {}), Path())
        for more in ({}, {"beyond": 0.6})
    )
    assert few.labels.tolist() == [True, True]
    assert all_told.labels.sum() == 2 and (~all_told.labels).sum() == 2 * 5  # four pieces of wall and what is far away
    np.testing.assert_allclose(few.moved, [np.nan, 0.05])
    assert np.nanmax(all_told.moved[~all_told.labels]) == 0.0
    assert few.values[1, NAMES.index("mean_speed")] == pytest.approx(-0.5)


def test_csv_scans_are_labelled_point_by_point(tmp_path):
    write_scan(tmp_path / "1.csv")
    write_scan(tmp_path / "2.csv", legs=((50, 55), (60, 66)))
    found = examples(SourceConfig(csv="."), parse(RecipeConfig, {}), tmp_path)
    assert found.labels.sum() == 3 and np.isfinite(found.values).all()
    assert (found.values[found.labels, NAMES.index("number")] < 7).all()


@pytest.mark.parametrize(
    ("mapping", "message"),
    [
        ({"sources": {"a": {"bag": "x.bag"}}}, "topic"),
        ({"sources": {"a": {"bag": "x.bag", "csv": "y"}}}, "one of bag, csv and scenario"),
        ({"sources": {}, "split": {"train": ["a"]}}, "no source is named a"),
        ({"features": ["colour"]}, "colour"),
        ({"sources": {}, "environments": {"office": {"train": ["a"], "test": ["a"]}}}, "office: no source is named a"),
        ({"sources": {"a": {"csv": "."}}, "environments": {"office": {"train": ["a"]}}}, "office: needs sources"),
    ],
)
def test_a_recipe_that_cannot_be_is_refused(mapping, message):
    with pytest.raises(ConfigError, match=message):
        parse(RecipeConfig, mapping)


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ({"bag": "nowhere.bag", "scans": "/scan"}, "nowhere"),
        ({"csv": "empty"}, "no csv"),
        ({"scenario": "nothing_like_it"}, "nothing_like_it"),
        ({"scenario": "hallway", "scanner_topic": "/scan_up"}, "/scan_up"),
    ],
)
def test_a_source_that_is_not_there_is_named(tmp_path, source, message):
    with pytest.raises(PeopleFusionError, match=message):
        examples(parse(SourceConfig, source), parse(RecipeConfig, {}), tmp_path)


def test_a_csv_that_is_no_scan_is_named(tmp_path):
    (tmp_path / "bad.csv").write_text("angle,range\n")
    with pytest.raises(PeopleFusionError, match="bad"):
        examples(SourceConfig(csv="."), parse(RecipeConfig, {}), tmp_path)


def test_an_error_is_one_line_and_a_status(tmp_path, capsys):
    assert main([str(tmp_path / "none.yaml")]) != 0
    assert "none.yaml" in capsys.readouterr().err


def test_the_shipped_recipe_and_model_belong_together():
    recipe = load_recipe(directory("config") / "training" / "legs.yaml")
    model = load_leg_model(directory("config") / "models" / "legs.json")
    assert set(model.provenance["examples"]) == set(recipe.sources)
    assert set(model.stumps.features.tolist()) <= {NAMES.index(name) for name in recipe.features}


def test_the_shipped_recipe_of_the_papers_tables_tests_on_no_source_that_it_learned_from():
    recipe = load_recipe(directory("config") / "training" / "arras.yaml")
    learned = {name for split in recipe.environments.values() for name in split.train}
    tested = {name for split in recipe.environments.values() for name in split.test}
    assert not learned & tested and learned | tested == set(recipe.sources)


@pytest.mark.slow
def test_legs_of_unseen_recordings_and_scanners_are_told(recordings: Path, tmp_path):
    """Area of 0.95 on recordings that were left out; figures of docs/legs.md."""
    table = tmp_path / "table.json"
    recipe = directory("config") / "training" / "legs.yaml"
    assert main([str(recipe), "--data", str(recordings), "--transfer", "--json", str(table)]) == 0
    figures = json.loads(table.read_text())
    assert figures["split"]["this recipe"]["auc"] >= 0.95
    assert figures["transfer"]["mir"]["auc"] > 0.96 and figures["transfer"]["ydlidar"]["auc"] > 0.94
