"""Files of head models: written, read, and refused where they are damaged."""

from __future__ import annotations

import csv
import io
import json
import zipfile

import cv2
import numpy as np
import pytest

from people_fusion.core.errors import ConfigError
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.fhog import FhogConfig
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow, load_head_model, read_poschmann_model
from people_fusion.cues.heads.pyramid import detect


def model_of(features=None, rows=3, cols=5, seed=0):
    features = features or FhogConfig(cell=5, bins=4, unsigned=False)
    window = HeadWindow(features, rows, cols, (0.5, 1.0, 4.5, 2.5))
    weights = np.random.default_rng(seed).normal(size=(rows, cols, features.dimensions)).astype(np.float32)
    return HeadModel(window, weights, 0.25, -1.5, {"photographs": 3, "why": "größer"})


def test_model_comes_back_as_it_was_written(tmp_path):
    model = model_of()
    for name in ("one.npz", "two"):
        model.save(tmp_path / name)
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two").read_bytes()
    back = load_head_model(tmp_path / "two")
    assert back.window == model.window and back.bias == model.bias and back.platt_slope == model.platt_slope
    assert back.provenance == model.provenance
    np.testing.assert_array_equal(back.weights, model.weights)


def test_response_is_the_dot_product_with_each_window():
    model = model_of()
    cells = np.random.default_rng(1).random((6, 9, model.window.features.dimensions)).astype(np.float32)
    expected = [
        [(cells[row : row + 3, col : col + 5] * model.weights).sum() + model.bias for col in range(5)]
        for row in range(4)
    ]  # fmt: skip
    np.testing.assert_allclose(model.responses(cells), expected, rtol=1e-4, atol=1e-4)
    assert model.responses(cells[:2]).size == 0
    with pytest.raises(ValueError, match="cells"):
        model.responses(cells[:, :, 1:])


def test_confidence_is_half_at_the_plane_and_grows():
    confidences = model_of().confidences(np.array([-1e6, -1.0, 0.0, 1.0, 1e6]))
    assert confidences[2] == 0.5 and (np.diff(confidences) > 0).all()
    assert confidences[3] == pytest.approx(1 / (1 + np.exp(-1.5)))


@pytest.mark.parametrize(
    "window,name",
    [
        (HeadWindow(FhogConfig(), 8, 8, (0, 0, 8, 8)), "FHOG6 4x8"),
        (HeadWindow(FhogConfig(5, 9, signed=False), 8, 8, (0, 0, 8, 8)), "UFHOG9 5x8"),
        (HeadWindow(FhogConfig(4, 9, unsigned=False), 8, 7, (0, 0, 7, 8)), "SFHOG9 4x8x7"),
    ],
)
def test_window_is_called_as_in_the_thesis(window, name):
    assert window.name == name


def header_of(path):
    with np.load(path) as content:
        return json.loads(str(content["header"]))


def rewrite(path, change=dict, weights=None):
    header = header_of(path)
    change(header)
    model = load_head_model(path)
    weights = model.weights if weights is None else weights
    np.savez(path, header=np.array(json.dumps(header)), weights=weights)


DAMAGES = {
    "format": lambda header: header.update(format="something else"),
    "no box": lambda header: header["window"].pop("box"),
    "short box": lambda header: header["window"].update(box=[0, 0, 1]),
    "empty box": lambda header: header["window"].update(box=[4, 1, 4, 2]),
    "unknown feature": lambda header: header["window"]["features"].update(colour=True),
    "bins out of range": lambda header: header["window"]["features"].update(bins=200),
    "other bins": lambda header: header["window"]["features"].update(bins=5),
    "more rows": lambda header: header["window"].update(rows=4),
    "bias of text": lambda header: header.update(bias="high"),
    "bias that is no number": lambda header: header.update(bias=float("nan")),
    "rising slope": lambda header: header.update(platt_slope=1.0),
    "no provenance": lambda header: header.pop("provenance"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_header_is_refused_and_the_file_named(tmp_path, damage):
    path = tmp_path / "model.npz"
    model_of().save(path)
    rewrite(path, DAMAGES[damage])
    with pytest.raises(ConfigError, match=str(path)):
        load_head_model(path)


@pytest.mark.parametrize(
    "weights",
    [np.zeros((3, 5, 11), np.float32), np.zeros((3, 5, 12)), np.full((3, 5, 12), np.inf, np.float32)],
    ids=["shape", "double", "infinite"],
)
def test_damaged_weights_are_refused(tmp_path, weights):
    path = tmp_path / "model.npz"
    model_of().save(path)
    rewrite(path, weights=weights)
    with pytest.raises(ConfigError, match=str(path)):
        load_head_model(path)


def test_pickled_content_is_refused_unread(tmp_path):
    path = tmp_path / "model.npz"
    model_of().save(path)
    np.savez(path, header=np.array([{"a": 1}], dtype=object), weights=np.zeros(3))
    with pytest.raises(ConfigError, match=str(path)):
        load_head_model(path)


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def test_files_of_other_kinds_are_refused(tmp_path):
    path = tmp_path / "model.npz"
    model_of().save(path)
    whole = path.read_bytes()
    spoilt = bytearray(whole)
    spoilt[len(whole) // 2] ^= 0xFF
    empty = io.BytesIO()
    zipfile.ZipFile(empty, "w").close()
    for content in (
        b"",
        b"text",
        whole[: len(whole) // 2],
        whole[:-30],
        bytes(spoilt),
        empty.getvalue(),
        npy(np.ones(3)),
    ):
        path.write_bytes(content)
        with pytest.raises(ConfigError, match=str(path)):
            load_head_model(path)
    for missing in (tmp_path / "nothing.npz", tmp_path, "no_such_model"):
        with pytest.raises(ConfigError, match=str(missing)):
            load_head_model(missing)


REFERENCES = {4: 16, 6: 22, 9: 31}


@pytest.mark.parametrize("bins", REFERENCES)
def test_svm_of_the_thesis_works_on_our_cells(recordings, bins):
    """Its weights are sorted by cell and bin as ours are; otherwise it would find nothing, or everything."""
    model = read_poschmann_model(recordings / f"head_svm_reference/svm-frontal-fhog{bins}-4x10")
    assert model.window.name == f"FHOG{bins} 4x10" and model.window.features.dimensions == REFERENCES[bins]
    found = hits = 0
    for name, marked in list(annotations(recordings).items())[:25]:
        grey = cv2.imread(str(recordings / "heads/images" / name), cv2.IMREAD_GRAYSCALE)
        boxes = detect(model, grey, 40, 300, 0.0)
        found += len(boxes.scores)
        hits += int((overlaps(boxes.corners, marked).max(axis=1, initial=0.0) > 0.4).sum())
    assert hits >= 12 and found <= 3 * hits  # of many heads that are no frontal ones


@pytest.mark.parametrize("content", ["", "Kernel RBF\n", "Kernel Linear\nBias x\n"])
def test_text_that_is_no_svm_is_refused(tmp_path, content):
    path = tmp_path / "svm"
    path.write_text(content, encoding="utf-8")
    for wrong in (path, tmp_path / "nothing"):
        with pytest.raises(ConfigError, match=str(wrong)):
            read_poschmann_model(wrong)


def annotations(recordings):
    """(N, 4) marked boxes of each photograph, by its name."""
    marked = {}
    with (recordings / "heads/annotations.csv").open(encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            marked.setdefault(row["image"], []).append([float(row[key]) for key in ("xmin", "ymin", "xmax", "ymax")])
    return {name: np.array(boxes) for name, boxes in sorted(marked.items())}
