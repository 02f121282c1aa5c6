"""HeadScores of images that no detector has seen."""

from __future__ import annotations

import numpy as np

from people_fusion.core.head_scores import HeadScores, ScoreLayer, ScoreWindow
from people_fusion.core.poses import Pose
from people_fusion.cues.heads.boxes import BoxConfig

WINDOW = ScoreWindow(8, 8, 4, (0.5, 0.5, 7.5, 7.0))
BOX = BoxConfig(height=0.24, head_above=-0.01)


def scored(camera, layers=(), pose=None, beyond=0, window=WINDOW, platt_slope=-2.0):
    return HeadScores(
        camera=camera,
        window=window,
        platt_slope=platt_slope,
        height=BOX.height,
        head_above=BOX.head_above,
        beyond=beyond,
        layers=tuple(layers),
        corners=np.zeros((0, 4)),
        box_scores=np.zeros(0),
        pose=pose or Pose.identity(),
    )


def flat_layer(scale, row, col, shape, value=0.0):
    """All windows of the same score."""
    return ScoreLayer(np.full(2, scale), row, col, np.full(shape, value, dtype=np.float32), np.zeros((0, 0, 22)))


def pyramid_of(camera, scales, beyond=0, value=0.0, window=WINDOW):
    """Layers over the whole image."""
    return [
        flat_layer(
            scale,
            0,
            0,
            (
                int(camera.height * scale) // window.cell - window.rows + 1,
                int((camera.width + 2 * beyond) * scale) // window.cell - window.cols + 1,
            ),
            value,
        )
        for scale in scales
    ]
