"""FHOG cells: what they must not depend on, VLFeat's as oracle, and the kernel in C against NumPy."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fhog_kernel import SOURCE, VARIANTS, compiled, mirrored
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.cues.heads import native
from people_fusion.cues.heads.fhog import FhogConfig, cell_histograms, direction_table, fhog
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow, LinearModels, window_scores

UNDER_SANITIZERS = """
import numpy as np
from people_fusion.cues.heads import native
from people_fusion.cues.heads.fhog import FhogConfig
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow, LinearModels

assert native.is_native()
rng = np.random.default_rng(0)
VARIANTS = [(1, 2, 1, 1), (3, 6, 1, 0), (4, 6, 1, 1), (4, 4, 1, 1), (4, 9, 1, 1), (5, 18, 0, 1)]
for height, width in [(1, 1), (0, 7), (3, 9), (4, 4), (5, 4), (8, 8), (9, 7), (37, 53), (64, 64), (33, 130), (130, 33)]:
    for cell, bins, signed, unsigned in VARIANTS:
        config = FhogConfig(cell, bins, bool(signed), bool(unsigned))
        cells = native.fhog(rng.integers(0, 256, (height, width)).astype(np.uint8), config)
        for rows, cols, models in [(1, 1, 1), (3, 2, 5), (8, 8, 1), (5, 9, 2)]:
            window = HeadWindow(config, rows, cols, (0, 0, cols, rows))
            weights = rng.normal(size=(rows, cols, config.dimensions)).astype(np.float32)
            native.Scorer([HeadModel(window, weights, 0.0, -1.0, {})] * models).scores(cells)
            if cells.shape[0] >= rows and cells.shape[1] >= cols:
                corner = np.array([0, cells.shape[0] - rows]), np.array([0, cells.shape[1] - cols])
                which = np.array([models - 1, 0])
                several = LinearModels(np.stack([weights] * models), np.zeros(models, np.float32))
                native.scores_at(cells, *corner, which, several)
"""
MUTANTS = {
    "reads beyond the image": ("y < height - 1; y++", "y <= height; y++"),
    "writes beyond the scores": ("if (top < 0 || top >= down) continue;", "if (top < 0) continue;"),
    "reads beyond the weights": ("i < length; i++", "i <= length + LANES; i++"),
    "reads beyond a window's cells": ("i < whole; i += LANES", "i <= whole + LANES; i += LANES"),
}


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(native.VARIABLE, str(compiled(tmp_path_factory.mktemp("kernel"))))
        native._library.cache_clear()
        assert native.is_native()
        yield
    native._library.cache_clear()


def run_sanitized(folder, source):
    """Odd sizes through a kernel that tells of accesses out of bounds and of undefined behaviour."""
    compiled(
        folder, "-g", "-DFHOG_PORTABLE", "-fsanitize=address,undefined", "-fno-sanitize-recover=all", source=source
    )
    runtime = subprocess.run(["gcc", "-print-file-name=libasan.so"], check=True, capture_output=True, text=True)
    environment = {
        **os.environ,
        native.VARIABLE: str(folder),
        "LD_PRELOAD": runtime.stdout.strip(),
        "ASAN_OPTIONS": "detect_leaks=0",
        "PYTHONPATH": os.pathsep.join(filter(None, sys.path)),
    }
    command = [sys.executable, "-c", UNDER_SANITIZERS]
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120)


def test_kernel_stays_within_its_arrays(tmp_path):
    done = run_sanitized(tmp_path, SOURCE)
    assert done.returncode == 0, done.stderr[-3000:]


@pytest.mark.parametrize("mutant", MUTANTS)
def test_sanitizers_see_a_kernel_that_does_not(tmp_path, mutant):
    right, wrong = MUTANTS[mutant]
    source = SOURCE.read_text(encoding="utf-8")
    assert right in source
    (tmp_path / "fhog.c").write_text(source.replace(right, wrong), encoding="utf-8")
    done = run_sanitized(tmp_path, tmp_path / "fhog.c")
    assert done.returncode != 0 and "ERROR: AddressSanitizer" in done.stderr


def test_built_workspace_has_the_kernel(monkeypatch):
    spaces = [Path(space) for space in os.environ.get("CMAKE_PREFIX_PATH", "").split(os.pathsep) if space]
    if not any((space / "share/people_fusion").is_dir() for space in spaces):
        pytest.skip("no workspace is sourced: tools/test does")
    monkeypatch.delenv(native.VARIABLE, raising=False)
    native._library.cache_clear()
    try:
        assert native.is_native()
    finally:
        native._library.cache_clear()


def noise(height, width, seed=0, levels=256):
    return np.random.default_rng(seed).integers(0, levels, (height, width)).astype(np.uint8)


def smooth(height, width, seed=0):
    """Slopes and edges, as photographs have them."""
    down, across = np.mgrid[:height, :width]
    rng = np.random.default_rng(seed)
    waves = sum(rng.uniform(-1, 1) * np.sin(rng.normal(0, 0.2) * across + rng.normal(0, 0.2) * down) for _ in range(9))
    return np.clip(128 + 60 * waves + 40 * (across > width // 2), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("config", VARIANTS, ids=lambda config: config.name)
def test_descriptor_has_the_dimensions_of_table_4_3(config):
    expected = {"FHOG2": 10, "FHOG3": 13, "FHOG4": 16, "FHOG5": 19, "FHOG6": 22, "FHOG7": 25, "FHOG8": 28, "FHOG9": 31}
    expected.update({"UFHOG9": 13, "SFHOG9": 22})
    assert fhog(noise(9, 13), config).shape == (2, 3, expected[config.name])


def test_neither_histogram_is_refused():
    with pytest.raises(ConfigError, match="features/signed"):
        parse(FhogConfig, {"signed": False, "unsigned": False}, "features")


@pytest.mark.parametrize("bad", [np.zeros((4, 4)), np.zeros((4, 4, 3), np.uint8)], ids=["float", "colour"])
def test_what_is_no_grey_image_is_refused(bad):
    for cells in (fhog, native.fhog):
        with pytest.raises(ValueError, match="grey"):
            cells(bad, FhogConfig())


def test_step_edge_falls_into_the_bin_of_its_direction():
    pixels = np.zeros((24, 24), np.uint8)
    pixels[:, 12:] = 200  # brighter to the right: direction 0
    histograms = cell_histograms(pixels, FhogConfig(bins=4))
    assert histograms[3, 2:4, 0].min() > 0 and histograms[:, :, 1:].max() == 0
    assert np.flatnonzero(cell_histograms(pixels[:, ::-1], FhogConfig(bins=4)).sum(axis=(0, 1))).tolist() == [4]
    assert np.flatnonzero(cell_histograms(pixels.T, FhogConfig(bins=4)).sum(axis=(0, 1))).tolist() == [2]


def test_all_strength_is_shared_among_cells_away_from_the_edge():
    pixels = np.zeros((32, 32), np.uint8)
    pixels[14:18, 13:19] = 90
    inner = pixels.astype(int)
    right, down = inner[1:-1, 2:] - inner[1:-1, :-2], inner[2:, 1:-1] - inner[:-2, 1:-1]
    assert cell_histograms(pixels, FhogConfig()).sum() == pytest.approx(np.hypot(right, down).sum(), rel=1e-5)


@pytest.mark.parametrize("bins", range(2, 19))
def test_direction_is_the_nearest_there_is(bins):
    steps = np.arange(-255, 256)
    right, down = np.meshgrid(steps, steps)
    angles = np.arctan2(down, right)
    away = np.abs((angles - direction_table(bins) * np.pi / bins + np.pi) % (2 * np.pi) - np.pi)
    assert away[(right != 0) | (down != 0)].max() <= 0.5 * np.pi / bins + 1e-6


@pytest.mark.parametrize("config", VARIANTS, ids=lambda config: config.name)
def test_gain_and_offset_do_not_matter(config):
    pixels = noise(40, 52, levels=60)
    np.testing.assert_allclose(fhog(3 * pixels + 40, config), fhog(pixels, config), atol=1e-5)


@pytest.mark.parametrize("config", VARIANTS, ids=lambda config: config.name)
def test_shift_by_a_cell_shifts_cells(config):
    pixels, cell = noise(60, 72), config.cell
    moved = fhog(pixels[cell:, 2 * cell :], config)
    np.testing.assert_allclose(moved[2:-2, 2:-2], fhog(pixels, config)[3:-2, 4:-2], atol=1e-6)


@pytest.mark.parametrize("bins", [4, 8])  # others have directions between two bins that pixels meet
@pytest.mark.parametrize("signed,unsigned", [(True, True), (True, False), (False, True)])
def test_mirrored_image_has_mirrored_cells(bins, signed, unsigned):
    config = FhogConfig(bins=bins, signed=signed, unsigned=unsigned)
    pixels = noise(40, 48)
    np.testing.assert_allclose(fhog(pixels[:, ::-1], config), mirrored(fhog(pixels, config), config), atol=1e-5)


def test_flat_image_has_no_features():
    assert not fhog(np.full((32, 32), 77, np.uint8), FhogConfig()).any()


@pytest.fixture(scope="module")
def vlfeat():
    name = ctypes.util.find_library("vl")
    if name is None:
        pytest.skip("VLFeat is not installed: apt-get install libvlfeat1")
    library, pointer, size = ctypes.CDLL(name), ctypes.c_void_p, ctypes.c_size_t
    library.vl_hog_new.restype, library.vl_hog_new.argtypes = pointer, [ctypes.c_int, size, ctypes.c_int]
    library.vl_hog_put_image.argtypes = [pointer, pointer, size, size, size, size]
    library.vl_hog_extract.argtypes = [pointer, pointer]
    library.vl_hog_delete.argtypes = [pointer]

    def uoctti(pixels, config):
        image = np.ascontiguousarray(pixels, dtype=np.float32)
        rows, cols = pixels.shape[0] // config.cell, pixels.shape[1] // config.cell
        out = np.zeros((config.dimensions, rows, cols), np.float32)
        hog = library.vl_hog_new(1, config.bins, 0)
        library.vl_hog_put_image(hog, image.ctypes.data, *pixels.shape[::-1], 1, config.cell)
        library.vl_hog_extract(hog, out.ctypes.data)
        library.vl_hog_delete(hog)
        return np.moveaxis(out, 0, 2)

    return uoctti


@pytest.mark.parametrize("cell", [4, 5, 8])
@pytest.mark.parametrize("bins", [4, 6, 8, 9])
def test_histograms_are_those_of_vlfeat(vlfeat, bins, cell):
    """Its energies are of the unsigned histogram; those of Felzenszwalb et al. and Poschmann of the signed one."""
    config = FhogConfig(cell=cell, bins=bins)
    pixels = noise(cell * 23, cell * 31)
    if bins % 2:  # VLFeat takes either of two directions that are as near
        pixels = noise(cell * 23, cell * 31) // 2 + (np.arange(cell * 31) % 3 * 43).astype(np.uint8)
    theirs, ours = vlfeat(pixels, config)[:, :, :-4], fhog(pixels, config)[:, :, :-4]
    differs = np.abs(theirs - ours).max(axis=2) > 1e-4
    assert differs.mean() <= (0.0 if bins in (4, 8) else 0.15)
    assert np.abs(theirs - ours)[~differs].max() < 1e-5


@pytest.mark.usefixtures("kernel")
@pytest.mark.parametrize("config", VARIANTS, ids=lambda config: config.name)
@settings(max_examples=40, deadline=None)
@given(
    height=st.integers(0, 70), width=st.integers(0, 70), cell=st.integers(1, 9), seed=st.integers(0, 9),
    kind=st.sampled_from(["noise", "smooth", "black", "binary"]),
)  # fmt: skip
def test_kernel_agrees_with_numpy(config, height, width, cell, kind, seed):
    config = FhogConfig(cell, config.bins, config.signed, config.unsigned)
    pixels = {
        "noise": lambda: noise(height, width, seed),
        "smooth": lambda: smooth(height, width, seed),
        "black": lambda: np.zeros((height, width), np.uint8),
        "binary": lambda: 255 * noise(height, width, seed, 2),
    }[kind]()
    ours, theirs = native.fhog(pixels, config), fhog(pixels, config)
    assert ours.shape == theirs.shape and ours.dtype == theirs.dtype
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-5)


@pytest.mark.usefixtures("kernel")
def test_kernel_reads_pieces_of_images_and_mirrored_ones():
    pixels = noise(90, 110)
    for piece in (pixels[7:60, 11:95], pixels[::2], pixels[:, ::-1], pixels[::-1], pixels.T):
        np.testing.assert_allclose(native.fhog(piece, FhogConfig()), fhog(piece, FhogConfig()), atol=1e-5)


@pytest.mark.usefixtures("kernel")
def test_kernel_takes_the_largest_images():
    pixels = noise(4320, 7680)
    cells = native.fhog(pixels, FhogConfig())
    assert cells.shape == (1080, 1920, 22)
    there = fhog(pixels[2000:2200, 6000:6200], FhogConfig())
    np.testing.assert_allclose(cells[502:548, 1502:1548], there[2:-2, 2:-2], atol=1e-5)


@pytest.mark.usefixtures("kernel")
@settings(max_examples=60, deadline=None)
@given(
    rows=st.integers(0, 30), cols=st.integers(0, 40), window=st.tuples(st.integers(1, 13), st.integers(1, 13)),
    models=st.integers(1, 4), bins=st.sampled_from([2, 4, 6, 9]),
)  # fmt: skip
def test_kernel_scores_as_numpy(rows, cols, window, models, bins):
    rng = np.random.default_rng(rows * 41 + cols)
    place = HeadWindow(FhogConfig(bins=bins), *window, (0.0, 0.0, 1.0, 1.0))
    shape = (*window, place.features.dimensions)
    several = [
        HeadModel(place, rng.normal(0, 0.05, shape).astype(np.float32), rng.normal(), -1.0, {}) for _ in range(models)
    ]
    cells = rng.uniform(0, 0.4, (rows, cols, place.features.dimensions)).astype(np.float32)
    scores = native.Scorer(several).scores(cells)
    for model, ours in zip(several, scores):
        np.testing.assert_allclose(ours, model.responses(cells), rtol=1e-5, atol=1e-5)
    assert scores.shape == (models, *model.responses(cells).shape)


@pytest.mark.usefixtures("kernel")
@settings(max_examples=60, deadline=None)
@given(
    window=st.tuples(st.integers(1, 13), st.integers(1, 13)), models=st.integers(1, 4),
    bins=st.sampled_from([2, 4, 6, 9]), count=st.integers(0, 50), seed=st.integers(0, 9),
)  # fmt: skip
def test_kernel_scores_single_windows_as_numpy(window, models, bins, count, seed):
    rng = np.random.default_rng(seed)
    dimensions = FhogConfig(bins=bins).dimensions
    cells = rng.uniform(0, 0.4, (*(np.array(window) + rng.integers(0, 20, 2)), dimensions)).astype(np.float32)
    weights = rng.normal(0, 0.05, (models, *window, dimensions)).astype(np.float32)
    biases = rng.normal(size=models).astype(np.float32)
    rows, cols = (rng.integers(0, edge - size + 1, count) for edge, size in zip(cells.shape, window))
    which = rng.integers(0, models, count)
    several = LinearModels(weights, biases)
    ours = native.scores_at(cells, rows, cols, which, several)
    np.testing.assert_allclose(ours, window_scores(cells, rows, cols, which, several), rtol=1e-5, atol=1e-5)
    for model in range(models):
        place = HeadWindow(FhogConfig(bins=bins), *window, (0.0, 0.0, 1.0, 1.0))
        everywhere = HeadModel(place, weights[model], float(biases[model]), -1.0, {}).responses(cells)
        mine = which == model
        np.testing.assert_allclose(ours[mine], everywhere[rows[mine], cols[mine]], rtol=1e-5, atol=1e-5)


@pytest.mark.usefixtures("kernel")
def test_single_windows_beyond_the_cells_are_refused():
    cells = np.zeros((9, 9, 22), np.float32)
    models = LinearModels(np.zeros((2, 8, 8, 22), np.float32), np.zeros(2, np.float32))
    inside = np.array([1])
    native.scores_at(cells, inside, inside, inside, models)
    for beyond in (2, -1):
        for place in range(3):
            places = [inside, inside, inside]
            places[place] = np.array([beyond])
            with pytest.raises(ValueError, match="beyond"):
                native.scores_at(cells, *places, models)
    with pytest.raises(ValueError, match="do not fit"):
        native.scores_at(cells[:, :, :16], inside, inside, inside, models)


def test_a_kernel_of_an_older_build_is_as_none(tmp_path, monkeypatch):
    source = SOURCE.read_text(encoding="utf-8").replace("fhog_scores_at", "fhog_scores_of_old")
    (tmp_path / "fhog.c").write_text(source, encoding="utf-8")
    for variable in ("LD_LIBRARY_PATH", "CMAKE_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv(native.VARIABLE, str(compiled(tmp_path, source=tmp_path / "fhog.c")))
    native._library.cache_clear()
    try:
        assert not native.is_native()
    finally:
        native._library.cache_clear()


def test_models_of_different_windows_are_refused():
    models = [
        HeadModel(HeadWindow(FhogConfig(), n, n, (0, 0, n, n)), np.zeros((n, n, 22), np.float32), 0.0, -1.0, {})
        for n in (4, 5)
    ]
    with pytest.raises(ValueError, match="one size"):
        native.Scorer(models)


def test_without_the_kernel_numpy_does_it(monkeypatch):
    for variable in (native.VARIABLE, "LD_LIBRARY_PATH", "CMAKE_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    native._library.cache_clear()
    try:
        assert not native.is_native()
        np.testing.assert_array_equal(native.fhog(noise(20, 20), FhogConfig()), fhog(noise(20, 20), FhogConfig()))
    finally:
        native._library.cache_clear()
