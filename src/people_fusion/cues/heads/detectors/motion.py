"""Whatever moves while the camera stands still, by difference of images, as Volkhardt 2013, III-A 3 does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, List, Optional, Tuple

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.errors import DataError
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import BoxConfig, Boxes
from people_fusion.cues.heads.detector import DETECTORS, Detector, Search, gathered

OVERLAP = 0.5
NOISE = 3  # pixels over which the image is averaged, and specks that opening takes away
LEAST_AREA = 20  # pixels of a part
LONGEST = 1.3  # how much longer a body is than its longest part
CUT = 1  # rows from the image's edge; what reaches it goes on beyond


@dataclass(frozen=True)
class MotionConfig:
    """Moving bodies, seen by a camera that stands."""

    threshold: int = parameter(20, "least change of a pixel from one image to the next, grey levels", 1, 255)
    bridge: float = parameter(0.03, "gaps that are closed, of the image's height", 0.0, 0.5)
    body_aspect: float = parameter(0.5, "of one body, width over height; what fits into that together is one", 0.0)
    largest_share: float = parameter(0.4, "of the image that may change; if more does it is the light", 0.01, 1.0)
    least_fill: float = parameter(0.15, "of a box that must have changed", 0.0, 1.0)
    largest_aspect: float = parameter(1.5, "of a body, width over height", low=0.1)
    confidence: float = parameter(0.5, "that what moves is a person", 0.0, 1.0)
    box: BoxConfig = section(
        lambda: BoxConfig(height=1.75, height_std=0.25, head_above=0.78, head_above_std=0.15, across_std=0.15),
        "what a box holds",
    )


@DETECTORS.register("motion", MotionConfig)
class Motion(Detector):
    """Connected components of what changed since the image before. Its score is the share of the box that changed.

    A body that the image's upper or lower edge cuts tells no distance and is left out.
    """

    part: ClassVar[str] = "motion"
    needs_rest: ClassVar[bool] = True

    def __init__(self, config: MotionConfig) -> None:
        self.config, self.box = config, config.box
        self._last: Optional[np.ndarray] = None

    def reset(self) -> None:
        """See Detector."""
        self._last = None

    def detect(self, image: Image, search: Search) -> Boxes:
        """See Detector; nothing for the first image after a reset or of another size."""
        import cv2  # 100 MB: not for those who see no images

        smooth = cv2.blur(image.grey, (NOISE, NOISE))
        last, self._last = self._last, smooth
        if last is None or last.shape != smooth.shape:
            return Boxes.none()
        changed = (cv2.absdiff(smooth, last) >= self.config.threshold).astype(np.uint8)
        share = float(changed.mean())
        if share > self.config.largest_share:
            raise DataError("light changed", f"{100.0 * share:.0f} % of the image")
        return gathered([self._bodies(changed, image.camera.wraps)], image, search, OVERLAP)

    def _bodies(self, changed: np.ndarray, wraps: bool) -> Boxes:
        """Boxes of the components of an image of flags."""
        import cv2

        config, (rows, columns) = self.config, changed.shape
        # A panorama is cut where nothing moves, not through somebody.
        seam = int(np.argmin(changed.any(axis=0))) if wraps else 0
        changed = np.roll(changed, -seam, axis=1)
        changed = cv2.morphologyEx(changed, cv2.MORPH_OPEN, np.ones((NOISE, NOISE), np.uint8))
        reach = max(round(config.bridge * rows), 1)
        closed = cv2.morphologyEx(changed, cv2.MORPH_CLOSE, np.ones((reach, reach), np.uint8))
        count, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
        corners = stats[1:, :4].astype(float)
        corners[:, 2:] += corners[:, :2]
        areas = np.bincount(labels.ravel(), weights=changed.ravel(), minlength=count)[1:]
        (left, top, right, bottom), areas = self._joined(corners, areas)
        width, height = right - left, bottom - top
        scores = areas / (width * height)
        whole = (top > CUT) & (bottom < rows - CUT)
        if not wraps:
            whole &= (left > CUT) & (right < columns - CUT)
        bodies = whole & (scores >= config.least_fill) & (width <= config.largest_aspect * height)
        corners = np.column_stack([left + seam, top, right + seam, bottom])
        return Boxes(corners[bodies], scores[bodies], np.full(int(bodies.sum()), config.confidence))

    def _joined(self, corners: np.ndarray, areas: np.ndarray) -> Tuple[np.ndarray, np.ndarray]:
        """Edges (4, M) and areas (M,) of bodies: of one that is evenly coloured only its edges change."""
        tallest_first = np.argsort(corners[:, 1] - corners[:, 3], kind="stable")
        bodies: List[np.ndarray] = []
        sums: List[float] = []
        for row in tallest_first[areas[tallest_first] >= LEAST_AREA]:
            for body, box in enumerate(bodies):
                union = np.hstack([np.minimum(box[:2], corners[row, :2]), np.maximum(box[2:], corners[row, 2:])])
                width, height = union[2:] - union[:2]
                if width <= self.config.body_aspect * height and height <= LONGEST * (box[3] - box[1]):
                    bodies[body] = union
                    sums[body] += areas[row]
                    break
            else:
                bodies.append(corners[row])
                sums.append(areas[row])
        return np.array(bodies).reshape(-1, 4).T, np.array(sums)
