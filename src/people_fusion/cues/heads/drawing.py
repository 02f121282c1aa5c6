"""What a head cue did with an image, drawn into it."""

from __future__ import annotations

from typing import Tuple

import numpy as np

from people_fusion.cues.heads.heads import Look

PERSON, NO_PERSON, SEARCHED = (80, 220, 60), (130, 130, 130), (220, 140, 40)  # blue, green, red


def annotated(pixels: np.ndarray, look: Look) -> np.ndarray:
    """(H, W, 3) copy of the image: where was searched, and each find with its confidence; grey: no person's.

    Args:
        pixels: (H, W) or (H, W, 3).
        look: see HeadCue.
    """
    import cv2  # 100 MB: not for those who see no images

    canvas = cv2.cvtColor(pixels, cv2.COLOR_GRAY2BGR) if pixels.ndim == 2 else pixels.copy()
    for corners in look.search.corners:
        _rectangle(canvas, corners, SEARCHED, 1)
    for corners, confidence, kept in zip(look.boxes.corners, look.boxes.confidences, look.kept):
        colour = PERSON if kept else NO_PERSON
        _rectangle(canvas, corners, colour, 2)
        place = (int(corners[0]), int(corners[1]) - 4)
        cv2.putText(canvas, f"{confidence:.2f}", place, cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)
    return canvas


def _rectangle(canvas: np.ndarray, corners: np.ndarray, colour: Tuple[int, int, int], width: int) -> None:
    import cv2

    limit = 4 * np.array([canvas.shape[1], canvas.shape[0]] * 2)
    left, top, right, bottom = (int(edge) for edge in np.clip(corners, -limit, limit))
    cv2.rectangle(canvas, (left, top), (right - 1, bottom - 1), colour, width)
