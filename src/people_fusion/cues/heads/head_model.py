"""Linear models of heads on FHOG cells: what window they look at, and their files."""

from __future__ import annotations

import dataclasses
import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, Mapping, NamedTuple, Tuple, Union

import numpy as np

from people_fusion.core.config import parse
from people_fusion.core.errors import ConfigError
from people_fusion.core.resources import directory
from people_fusion.cues.heads.fhog import FhogConfig

FORMAT = "people_fusion head model 1"


@dataclass(frozen=True)
class HeadWindow:
    """The window that slides over the cells, and where in it the head is.

    Attributes:
        features: of the cells.
        rows, cols: cells of the window.
        box: left, top, right, bottom of the head's box, in cells from the window's upper left.
    """

    features: FhogConfig
    rows: int
    cols: int
    box: Tuple[float, float, float, float]

    def __post_init__(self) -> None:
        left, top, right, bottom = self.box
        if self.rows < 1 or self.cols < 1 or not (left < right and top < bottom and np.isfinite(self.box).all()):
            raise ConfigError(f"a window of {self.rows}x{self.cols} cells with the box {self.box} holds nothing")

    @property
    def head_height(self) -> float:
        """Height of the head's box in pixels of the image that the cells are of."""
        return (self.box[3] - self.box[1]) * self.features.cell

    @property
    def aspect(self) -> float:
        """Width of the head's box over its height."""
        return (self.box[2] - self.box[0]) / (self.box[3] - self.box[1])

    @property
    def name(self) -> str:
        """As Poschmann calls it: "FHOG6 4x8"; "FHOG6 4x8x10" where 8 rows have 10 columns."""
        return f"{self.features.name} {self.features.cell}x{self.rows}" + f"x{self.cols}" * (self.rows != self.cols)


@dataclass(frozen=True, eq=False)
class HeadModel:
    """A linear SVM of heads (Poschmann 2018, eq. 4.1).

    Attributes:
        window: what it looks at.
        weights: (rows, cols, D) float32.
        bias: rho.
        platt_slope: a of eq. 4.2, negative; b is 0.
        provenance: how it came about; JSON.
    """

    window: HeadWindow
    weights: np.ndarray
    bias: float
    platt_slope: float
    provenance: Mapping[str, Any]

    def __post_init__(self) -> None:
        shape = (self.window.rows, self.window.cols, self.window.features.dimensions)
        if self.weights.shape != shape or self.weights.dtype != np.float32:
            raise ConfigError(f"weights: expected {shape} float32, got {self.weights.shape} {self.weights.dtype}")
        if not (np.isfinite(self.weights).all() and np.isfinite(self.bias) and self.platt_slope < 0.0):
            raise ConfigError("weights and bias must be finite, platt_slope negative")

    def responses(self, features: np.ndarray) -> np.ndarray:
        """Scores of all windows, eq. 4.1, float32; in NumPy, as definition (`native` has the same in C).

        Args:
            features: (R, C, D) cells.

        Returns:
            (R - rows + 1, C - cols + 1), by the window's upper left cell; empty where no window fits.
        """
        height, width = response_shape(features, self.window)
        scores = np.full((height, width), self.bias, dtype=np.float32)
        for row in range(self.window.rows if scores.size else 0):
            for col in range(self.window.cols):
                scores += features[row : row + height, col : col + width] @ self.weights[row, col]
        return scores

    def confidences(self, scores: np.ndarray) -> np.ndarray:
        """Probability of a head at each score, eq. 4.2 with b = 0."""
        return 1.0 / (1.0 + np.exp(np.clip(self.platt_slope * np.asarray(scores, dtype=float), -500.0, 500.0)))

    def save(self, path: Union[str, Path]) -> None:
        """Write as npz without pickle; the same model gives the same bytes."""
        window = dataclasses.asdict(self.window)
        header = {
            "format": FORMAT,
            "window": window,
            "bias": float(self.bias),
            "platt_slope": float(self.platt_slope),
            "provenance": dict(self.provenance),
        }
        with Path(path).open("wb") as stream:  # else savez appends a suffix of its own
            np.savez_compressed(stream, header=np.array(json.dumps(header)), weights=self.weights)


def response_shape(features: np.ndarray, window: HeadWindow) -> Tuple[int, int]:
    """How many windows fit into cells (R, C, D), down and across.

    Raises:
        ValueError: the cells are of other features.
    """
    if features.ndim != 3 or features.shape[2] != window.features.dimensions:
        raise ValueError(f"expected cells (R, C, {window.features.dimensions}), got {features.shape}")
    height, width = features.shape[0] - window.rows + 1, features.shape[1] - window.cols + 1
    return (height, width) if height > 0 and width > 0 else (0, 0)


class LinearModels(NamedTuple):
    """Several models of one window.

    Attributes:
        weights: (M, rows, cols, D) float32.
        biases: (M,) float32.
    """

    weights: np.ndarray
    biases: np.ndarray


def window_scores(
    features: np.ndarray, rows: np.ndarray, cols: np.ndarray, which: np.ndarray, models: LinearModels
) -> np.ndarray:
    """Scores (N,) of single windows, each by a model of its own, eq. 4.1; as definition (`native` has the same in C).

    Args:
        features: (R, C, D) cells.
        rows, cols: (N,) upper left cells.
        which: (N,) index of each window's model.
        models: M of them.
    """
    size = models.weights.shape[1:]
    cut = [features[row : row + size[0], col : col + size[1]] for row, col in zip(rows.tolist(), cols.tolist())]
    sums = np.einsum("nrcd,nrcd->n", np.array(cut, dtype=np.float32).reshape(-1, *size), models.weights[which])
    return np.asarray(models.biases[which] + sums)


def load_head_model(name: Union[str, Path]) -> HeadModel:
    """Read what `HeadModel.save` wrote.

    Args:
        name: of a model in config/models, e.g. "heads" or "heads.npz", or the path of a file.

    Raises:
        ConfigError: the file is missing or is not such a model; the message names it.
    """
    path = Path(name)
    if len(path.parts) == 1 and not path.is_file():
        path = directory("config") / "models" / path.with_suffix(".npz")
    try:
        with np.load(str(path), allow_pickle=False) as content:
            header, weights = json.loads(str(content["header"])), content["weights"]
    except FileNotFoundError as error:
        raise ConfigError(f"{path}: there is no such head model") from error
    except (OSError, ValueError, KeyError, EOFError, AttributeError, TypeError) as error:
        raise ConfigError(f"{path}: not a head model: {error}") from error
    except (zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise ConfigError(f"{path}: damaged head model: {error}") from error
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise ConfigError(f"{path}: not a head model of format {FORMAT!r}")
    try:
        return HeadModel(
            _window(header["window"]),
            weights,
            float(header["bias"]),
            float(header["platt_slope"]),
            dict(header["provenance"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError, ConfigError) as error:
        raise ConfigError(f"{path}: damaged head model: {error}") from error


def read_poschmann_model(path: Union[str, Path], cell: int = 4) -> HeadModel:
    """An SVM of Poschmann's own, as text: bias, logistic offset and slope, weights of FHOG cells; to compare with.

    Args:
        path: of the file.
        cell: edge of its cells, pixels, which the file does not tell.

    Raises:
        ConfigError: the file is missing or is not such a model; the message names it.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").split("\n")
        _, count, rows, cols, dimensions, _ = lines[4].split()
        weights = np.array(lines[5].split(), dtype=np.float32).reshape(int(rows), int(cols), int(dimensions))
        if lines[0] != "Kernel Linear" or count != "1" or lines[2].split() != ["Coefficients", "1"]:
            raise ValueError("not one linear support vector")
        bias, slope = float(lines[1].split()[1]), float(lines[6].split()[2])
        features = FhogConfig(cell, (int(dimensions) - 4) // 3)
        window = HeadWindow(features, int(rows), int(cols), (0.0, 0.0, float(cols), float(rows)))
        return HeadModel(window, weights, -bias, slope, {"file": Path(path).name})
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except (ValueError, IndexError, ConfigError) as error:
        raise ConfigError(f"{path}: not a head SVM as text: {error}") from error


def _window(entry: Dict[str, Any]) -> HeadWindow:
    left, top, right, bottom = (float(edge) for edge in entry["box"])
    return HeadWindow(
        parse(FhogConfig, entry["features"], "features"),
        int(entry["rows"]),
        int(entry["cols"]),
        (left, top, right, bottom),
    )
