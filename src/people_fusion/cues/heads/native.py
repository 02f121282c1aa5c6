"""Cells and scores of heads by the kernel in native/fhog.c; by NumPy where it is not built."""

from __future__ import annotations

import ctypes
import os
from functools import lru_cache
from pathlib import Path
from typing import Iterator, List, Optional, Sequence

import numpy as np

from people_fusion.cues.heads import fhog as definition
from people_fusion.cues.heads.fhog import FhogConfig, check_pixels, direction_table
from people_fusion.cues.heads.head_model import HeadModel, LinearModels, response_shape, window_scores

LIBRARY = "libpeople_fusion_fhog.so"
VARIABLE = "PEOPLE_FUSION_NATIVE"  # directory of the library, for those who have sourced no workspace
LANES = 8  # as in native/fhog.c


def is_native() -> bool:
    """Whether the kernel is there; otherwise NumPy does the same, many times slower."""
    return _library() is not None


def fhog(pixels: np.ndarray, config: FhogConfig) -> np.ndarray:
    """As `fhog.fhog`, to 1e-5."""
    library = _library()
    if library is None:
        return definition.fhog(pixels, config)
    check_pixels(pixels)
    if pixels.strides[1] != 1 and pixels.size:
        pixels = np.ascontiguousarray(pixels)
    rows, cols = pixels.shape[0] // config.cell, pixels.shape[1] // config.cell
    cells = np.empty((rows, cols, config.dimensions), dtype=np.float32)
    if cells.size:
        _check(
            library.fhog_cells(
                pixels.ctypes.data,
                *pixels.shape,
                pixels.strides[0],
                config.cell,
                config.bins,
                config.signed,
                config.unsigned,
                direction_table(config.bins).ctypes.data,
                cells.ctypes.data,
            )
        )
    return cells


class Scorer:
    """Scores of several models of one window on the same cells.

    Args:
        models: at least one; their windows have the same features and size.
    """

    def __init__(self, models: Sequence[HeadModel]) -> None:
        self.models = tuple(models)
        sizes = {(model.window.features, model.window.rows, model.window.cols) for model in self.models}
        if len(sizes) != 1:
            raise ValueError(f"expected models with windows of one size, got {len(sizes)} sizes")
        rows = self.models[0].window.rows
        weights = np.concatenate([model.weights.reshape(rows, -1) for model in self.models])
        unused = -len(weights) % LANES
        self._weights = np.ascontiguousarray(np.pad(weights, [(0, unused), (0, 0)], mode="constant").T)
        self._biases = np.array([model.bias for model in self.models], dtype=np.float32)

    def scores(self, features: np.ndarray) -> np.ndarray:
        """(M, R - rows + 1, C - cols + 1) as `HeadModel.responses` of each model, to 1e-5 of the largest sum."""
        window = self.models[0].window
        shape = response_shape(features, window)
        library = _library()
        if library is None:
            return np.stack([model.responses(features) for model in self.models])
        features = np.ascontiguousarray(features, dtype=np.float32)
        scores = np.empty((len(self.models), *shape), dtype=np.float32)
        if scores.size:
            _check(
                library.fhog_scores(
                    features.ctypes.data,
                    *features.shape,
                    self._weights.ctypes.data,
                    self._biases.ctypes.data,
                    len(self.models),
                    window.rows,
                    window.cols,
                    self._weights.shape[1],
                    scores.ctypes.data,
                )
            )
        return scores


def scores_at(
    features: np.ndarray, rows: np.ndarray, cols: np.ndarray, which: np.ndarray, models: LinearModels
) -> np.ndarray:
    """As `head_model.window_scores`, to 1e-5 of the largest sum.

    Raises:
        ValueError: a window is not within the cells, or there is no such model.
    """
    weights, biases = (np.ascontiguousarray(each, dtype=np.float32) for each in models)
    if features.shape[2] != weights.shape[3] or len(biases) != len(weights):
        raise ValueError(f"models of {weights.shape} and {len(biases)} biases do not fit cells of {features.shape}")
    lasts = features.shape[0] - weights.shape[1], features.shape[1] - weights.shape[2], len(weights) - 1
    for places, last in zip((rows, cols, which), lasts):
        if places.shape != rows.shape or (places.size and not (places.min() >= 0 and places.max() <= last)):
            raise ValueError(f"windows beyond cells of {features.shape} or models of {weights.shape}")
    library = _library()
    if library is None:
        return window_scores(features, rows, cols, which, models)
    features = np.ascontiguousarray(features, dtype=np.float32)
    tops, lefts, numbers = (np.ascontiguousarray(each, dtype=np.int32) for each in (rows, cols, which))
    scores = np.empty(len(rows), dtype=np.float32)
    library.fhog_scores_at(
        features.ctypes.data,
        *features.shape[1:],
        tops.ctypes.data,
        lefts.ctypes.data,
        numbers.ctypes.data,
        len(scores),
        weights.ctypes.data,
        biases.ctypes.data,
        *weights.shape[1:3],
        scores.ctypes.data,
    )
    return scores


def _check(result: int) -> None:
    if result:
        raise MemoryError("the FHOG kernel got no memory")


@lru_cache(maxsize=1)
def _library() -> Optional[ctypes.CDLL]:
    for folder in _folders():
        path = folder / LIBRARY
        if path.is_file():
            try:
                return _with_arguments(ctypes.CDLL(str(path)))
            except (OSError, AttributeError):  # of another machine, of an older build
                continue
    return None


def _with_arguments(library: ctypes.CDLL) -> ctypes.CDLL:
    pointer, number = ctypes.c_void_p, ctypes.c_int
    library.fhog_cells.argtypes = [pointer, number, number, ctypes.c_ssize_t, *[number] * 4, pointer, pointer]
    library.fhog_scores.argtypes = [pointer, *[number] * 3, pointer, pointer, *[number] * 4, pointer]
    at = library.fhog_scores_at
    at.argtypes = [pointer, *[number] * 2, *[pointer] * 3, number, *[pointer] * 2, *[number] * 2, pointer]
    at.restype = None
    return library


def _folders() -> Iterator[Path]:
    if os.environ.get(VARIABLE):
        yield Path(os.environ[VARIABLE])
    for variable, below in (("LD_LIBRARY_PATH", "."), ("CMAKE_PREFIX_PATH", "lib")):
        for entry in _entries(variable):
            yield entry / below


def _entries(variable: str) -> List[Path]:
    return [Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if entry]
