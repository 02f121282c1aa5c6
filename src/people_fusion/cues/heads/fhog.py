"""FHOG, the gradient histograms of Felzenszwalb et al. 2010 in the variants of Poschmann 2018, 4.2.1 and 4.5.4.

In NumPy, as definition; `native` has the same in C.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.errors import ConfigError

CLIP = np.float32(0.2)  # of normalised histograms
EPSILON = np.float32(1e-4)  # keeps cells without gradients at zero; pixels are 0..255
ENERGY_SCALE = np.float32(1 / np.sqrt(18))  # whatever the number of bins, as Poschmann's SVMs have it
STEEPEST = 255  # largest difference of two pixels


@dataclass(frozen=True)
class FhogConfig:
    """FHOG6 with cells of 4 pixels; FHOG9, UFHOG9 (not signed) and SFHOG9 (not unsigned) by the same switches."""

    cell: int = parameter(4, "edge of a cell, pixels", low=1, high=64)
    bins: int = parameter(6, "orientations of the unsigned histogram; the signed one has twice as many", 2, 18)
    signed: bool = parameter(True, "whether the histogram is there that tells bright-to-dark from dark-to-bright")
    unsigned: bool = parameter(True, "whether the histogram is there that does not")

    def __post_init__(self) -> None:
        if not (self.signed or self.unsigned):
            raise ConfigError("signed: a descriptor needs the signed or the unsigned histogram, or both")

    @property
    def dimensions(self) -> int:
        """D, of one cell's descriptor: signed histogram, unsigned histogram, four energies."""
        return (2 * self.signed + self.unsigned) * self.bins + 4

    @property
    def name(self) -> str:
        """As Poschmann calls it: "FHOG6", "UFHOG9", "SFHOG9"."""
        return ("" if self.signed and self.unsigned else "S" if self.signed else "U") + f"FHOG{self.bins}"


def fhog(pixels: np.ndarray, config: FhogConfig) -> np.ndarray:
    """(rows, cols, D) float32 descriptors of the whole cells in an image; what is beyond them is not looked at.

    A descriptor holds the signed histogram (2 bins), the unsigned one (bins), and the cell's energy against that of
    the 2x2 cells to its upper left, upper right, lower left and lower right.

    Args:
        pixels: (H, W) uint8, grey; rows = H // cell, cols = W // cell.
        config: the variant.
    """
    histograms = cell_histograms(pixels, config)
    bins = config.bins
    without_sign = histograms[:, :, :bins] + histograms[:, :, bins:]
    norms = _inverse_norms((without_sign**2).sum(axis=2))[..., None]
    clipped = np.minimum(histograms * norms, CLIP)  # (4, rows, cols, 2 bins)
    parts = [clipped.sum(axis=0) / 2] if config.signed else []
    if config.unsigned:
        parts.append(np.minimum(without_sign * norms, CLIP).sum(axis=0) / 2)
    energies = clipped.sum(axis=3) * ENERGY_SCALE
    return np.concatenate([*parts, np.moveaxis(energies, 0, 2)], axis=2).astype(np.float32)


def cell_histograms(pixels: np.ndarray, config: FhogConfig) -> np.ndarray:
    """(rows, cols, 2 bins) float32: gradients by direction, each shared among the four nearest cells.

    The outermost pixels have no gradient.
    """
    check_pixels(pixels)
    cell, directions = config.cell, 2 * config.bins
    rows, cols = pixels.shape[0] // cell, pixels.shape[1] // cell
    image = pixels[: rows * cell, : cols * cell].astype(np.int32)
    right, down = image[1:-1, 2:] - image[1:-1, :-2], image[2:, 1:-1] - image[:-2, 1:-1]
    direction = direction_table(config.bins)[down + STEEPEST, right + STEEPEST]
    strength = np.sqrt((right**2 + down**2).astype(np.float32))

    histograms = np.zeros(rows * cols * directions)
    for row, row_share in _nearest_cells(rows, cell):
        for col, col_share in _nearest_cells(cols, cell):
            index = (row[:, None] * cols + col) * directions + direction
            share = strength * row_share[:, None] * col_share
            histograms += np.bincount(index.ravel(), share.ravel(), histograms.size)
    return histograms.reshape(rows, cols, directions).astype(np.float32)


@lru_cache(maxsize=None)
def direction_table(bins: int) -> np.ndarray:
    """(511, 511) uint8: of 2 bins directions, the one nearest to the gradient (right, down); [down + 255, right + 255].

    Direction k points at an angle of k pi / bins; k and k + bins are opposite. Of two that are equally near the first.
    """
    steps = np.arange(-STEEPEST, STEEPEST + 1)
    angles = np.arange(bins) * (np.pi / bins)
    along = np.cos(angles) * steps[None, :, None] + np.sin(angles) * steps[:, None, None]
    nearest = np.round(np.abs(along), 6).argmax(axis=2)
    opposite = np.take_along_axis(along, nearest[:, :, None], axis=2)[:, :, 0] < 0
    table = (nearest + bins * opposite).astype(np.uint8)
    table.setflags(write=False)
    return table


def check_pixels(pixels: np.ndarray) -> None:
    """Raises ValueError unless they are (H, W) uint8."""
    if pixels.ndim != 2 or pixels.dtype != np.uint8:
        raise ValueError(f"expected grey pixels (H, W) uint8, got {pixels.shape} {pixels.dtype}")


def _nearest_cells(count: int, cell: int) -> list:
    """Of the pixels between the outermost ones of a line: the cell before and after each, and their shares of it."""
    places = (np.arange(1, max(count * cell - 1, 1)) + 0.5) / cell - 0.5
    before = np.floor(places).astype(int)
    after_share = (places - before).astype(np.float32)
    sides = ((before, 1 - after_share), (before + 1, after_share))
    return [(np.clip(index, 0, count - 1), share * ((index >= 0) & (index < count))) for index, share in sides]


def _inverse_norms(energies: np.ndarray) -> np.ndarray:
    """(4, rows, cols): one over the norm of the 2x2 cells to each cell's upper left, upper right, lower left, lower
    right; beyond the edge the outermost cells go on."""
    rows, cols = energies.shape
    if not energies.size:
        return np.zeros((4, rows, cols), dtype=np.float32)
    padded = np.pad(energies, 1, mode="edge")
    blocks = padded[:-1, :-1] + padded[:-1, 1:] + padded[1:, :-1] + padded[1:, 1:]
    corners = [blocks[row : row + rows, col : col + cols] for row in (0, 1) for col in (0, 1)]
    return 1 / np.sqrt(np.stack(corners) + EPSILON)
