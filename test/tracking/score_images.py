"""Scored images made by hand: high where heads are, low elsewhere."""

from __future__ import annotations

import dataclasses

import numpy as np

from people_fusion.core.camera_models import Panorama, PanoramaConfig
from people_fusion.core.head_scores import HeadScores, ScoreLayer, ScoreWindow
from people_fusion.core.measurements import Measurement
from people_fusion.core.poses import Pose
from people_fusion.cues.heads.places import seen

WINDOW = ScoreWindow(8, 8, 4, (1.0, 1.0, 7.0, 7.0))
CAMERA = Panorama(PanoramaConfig(1406, 240))
POSE = Pose(np.eye(3), np.array([0.0, 0.0, 1.4]))  # a panorama's frame is level, and seen from the floor
PEAK, BACKGROUND = 3.0, -4.0


def scored(heads, found=None, **changes):
    """HeadScores of an image in which heads (N, 3) look like heads; `found` of them are detected."""
    scores = HeadScores(
        camera=CAMERA, window=WINDOW, platt_slope=-1.5, height=0.24, head_above=0.0, beyond=64, layers=(),
        corners=np.zeros((0, 4)), box_scores=np.zeros(0), pose=POSE, **changes,
    )  # fmt: skip
    boxes = seen(scores, np.asarray(heads, dtype=float).reshape(-1, 3))
    layers = []
    for number in range(12):
        scale = 0.5 ** (number / 5)
        width, height = round((CAMERA.width + 128) * scale), round(CAMERA.height * scale)
        cols, rows = width // 4 - 7, height // 4 - 7
        if rows < 1:
            break
        values = np.full((rows, cols), BACKGROUND)
        middles = np.stack(np.meshgrid(np.arange(cols) + 4.0, np.arange(rows) + 4.0), axis=2) * 4.0 / scale
        size = WINDOW.head_height / scale
        for middle, tall in zip(boxes.middles, boxes.heights):
            off = np.abs(np.log2(tall / size)) * 5.0
            away = np.hypot(*np.moveaxis(middles - [64.0, 0.0] - middle, 2, 0)) / (0.25 * tall)
            values = np.maximum(values, BACKGROUND + (PEAK - BACKGROUND) * np.exp(-0.5 * (away**2 + off**2)))
        layers.append(ScoreLayer(np.full(2, scale), 0, 0, values.astype(np.float32), np.zeros((0, 0, 22), np.float32)))
    rows = np.arange(len(boxes.heights)) if found is None else np.asarray(found, dtype=int)
    half = 0.5 * np.repeat(boxes.heights[rows, None], 2, axis=1)
    corners = np.hstack([boxes.middles[rows] - half, boxes.middles[rows] + half])
    peaks = np.full(len(rows), PEAK)
    return dataclasses.replace(scores, layers=tuple(layers), corners=corners, box_scores=peaks)


def image(time_s, heads, found=None, sequence=0, **changes):
    """A measurement of heads in an image; positions are the truth, wide along the ray."""
    heads = np.asarray(heads, dtype=float).reshape(-1, 3)
    scores = scored(heads, found, **changes)
    rows = np.arange(len(heads)) if found is None else np.asarray(found, dtype=int)
    along = heads[rows] - POSE.translation
    distances = np.linalg.norm(along, axis=1)
    rays = along / distances[:, None]
    spread = (0.1 * distances)[:, None, None] ** 2 * rays[:, :, None] * rays[:, None, :]
    return Measurement(
        stamp_ns=round(time_s * 1e9),
        cue="camera",
        modality="head",
        frame_id="map",
        positions=heads[rows],
        covariances=spread + 0.03**2 * np.eye(3),
        confidences=np.full(len(rows), 0.9),
        sequence=sequence,
        scores=scores,
    )


def with_features(measurement, dimensions=22, seed=0):
    """Cells of which nothing is known but that all are different."""
    rng, scores = np.random.default_rng(seed), measurement.scores
    layers = []
    for layer in scores.layers:
        rows, cols = layer.scores.shape
        shape = rows + scores.window.rows - 1, cols + scores.window.cols - 1, dimensions
        layers.append(layer._replace(features=rng.random(shape).astype(np.float32)))
    return dataclasses.replace(measurement, scores=dataclasses.replace(scores, layers=tuple(layers)))
