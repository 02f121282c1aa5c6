"""Painted heads with shoulders before clutter, and a model that was fitted to them."""

from __future__ import annotations

import cv2
import numpy as np

from people_fusion.cues.heads.fhog import FhogConfig, fhog
from people_fusion.cues.heads.head_model import HeadModel, HeadWindow

WINDOW = HeadWindow(FhogConfig(), 10, 10, (1.0, 1.0, 9.0, 9.0))
SHIFT = 4  # bits of fractions in OpenCV's coordinates


def clutter(rows, cols, rng):
    """Soft patches and bars."""
    coarse = rng.integers(60, 150, (rows // 16 + 2, cols // 16 + 2)).astype(np.uint8)
    pixels = cv2.resize(coarse, (cols, rows), interpolation=cv2.INTER_CUBIC)
    for _ in range(rows * cols // 6000):
        start, end = rng.integers(0, [cols, rows], (2, 2)).tolist()
        cv2.line(pixels, start, end, int(rng.integers(40, 200)), int(rng.integers(1, 6)))
    return np.clip(pixels + rng.normal(0.0, 3.0, pixels.shape), 0, 255).astype(np.uint8)


def paint_head(pixels, middle, height, rng):
    """An ellipse as high as the box, 0.8 of that wide, over shoulders."""
    shade = int(rng.choice([rng.integers(0, 40), rng.integers(200, 255)]))

    def ellipse(x, y, half_width, half_height):
        scale = 1 << SHIFT
        place = [round(scale * (value - 0.5)) for value in (x, y)]
        axes = [round(scale * value) for value in (half_width, half_height)]
        cv2.ellipse(pixels, place, axes, 0, 0, 360, shade, -1, cv2.LINE_AA, SHIFT)

    x, y = middle
    ellipse(x, y, 0.4 * height, 0.5 * height)
    ellipse(x, y + 1.05 * height, 0.9 * height, 0.6 * height)


def scene(rows, cols, heads, seed=0):
    """(rows, cols) grey with heads of (x, y, height)."""
    rng = np.random.default_rng(seed)
    pixels = clutter(rows, cols, rng)
    for x, y, height in heads:
        paint_head(pixels, (x, y), height, rng)
    return pixels


def box_of(x, y, height):
    return np.array([x - height / 2, y - height / 2, x + height / 2, y + height / 2])


def fitted_model(count=300, seed=3):
    """Least squares with a ridge: +1 for heads in their place and size, -1 for what is beside them, larger or none."""
    rng = np.random.default_rng(seed)
    cell, size = WINDOW.features.cell, WINDOW.features.cell * WINDOW.rows
    examples, labels = [], []
    for _ in range(count):
        for label in (1, -1, -1, -1):
            pixels = clutter(size + 2 * cell, size + 2 * cell, rng)
            offset, height = rng.uniform(-1.5, 1.5, 2), WINDOW.head_height * rng.uniform(0.95, 1.05)
            if label < 0:
                offset = rng.choice([-1, 1], 2) * rng.uniform(6, 30, 2)
                height *= rng.choice([0.6, 1.0, 1.8])
            paint_head(pixels, offset + 0.5 * size + cell, height, rng)
            examples.append(fhog(pixels, WINDOW.features)[1:-1, 1:-1].ravel())
            labels.append(label)
    examples, labels = np.array(examples, dtype=float), np.array(labels, dtype=float)
    examples = np.column_stack([examples, np.ones(len(examples))])
    gram = examples.T @ examples + 3.0 * np.eye(examples.shape[1])
    weights = np.linalg.solve(gram, examples.T @ labels)
    shape = (WINDOW.rows, WINDOW.cols, WINDOW.features.dimensions)
    return HeadModel(WINDOW, weights[:-1].reshape(shape).astype(np.float32), float(weights[-1]), -3.0, {"made": "here"})
