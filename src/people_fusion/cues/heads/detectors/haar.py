"""Faces and upper bodies by OpenCV's cascades (Viola & Jones 2001), as Poschmann 2018, 3.1.2 and Volkhardt 2013 do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, List, Union

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.errors import ConfigError
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import BoxConfig, Boxes
from people_fusion.cues.heads.detector import DETECTORS, Crop, Detector, Search, crops, gathered

OVERLAP = 0.3
SIMILAR = 0.2  # of their size, by which windows differ that agree; OpenCV's own
NO_WINDOWS = np.zeros((0, 4), dtype=int)
# What boxes hold is measured on rendered people (benchmarks/calibrate_boxes.py); it varies as on photographs, where
# people differ more.
DEBIAN = ("/usr/share/opencv4/haarcascades", "/usr/share/opencv/haarcascades", "/usr/local/share/opencv4/haarcascades")


@dataclass(frozen=True)
class HaarFaceConfig:
    """Frontal faces."""

    cascade: str = parameter("haarcascade_frontalface_alt2.xml", "file, or the name of one that comes with OpenCV")
    step: float = parameter(1.1, "from one size to the next", low=1.01)
    neighbours: int = parameter(3, "windows that must agree", low=0)
    confidence: float = parameter(0.8, "of a find that so many agree on; more make it surer", 0.0, 1.0)
    box: BoxConfig = section(
        lambda: BoxConfig(height=0.19, height_std=0.022, head_above=0.014, head_above_std=0.009, across_std=0.024),
        "what a box holds",
    )


@dataclass(frozen=True)
class HaarProfileConfig:
    """Faces from the side, of both sides."""

    cascade: str = parameter("haarcascade_profileface.xml", "file, or the name of one that comes with OpenCV")
    step: float = parameter(1.1, "from one size to the next", low=1.01)
    neighbours: int = parameter(3, "windows that must agree", low=0)
    confidence: float = parameter(0.7, "of a find that so many agree on; more make it surer", 0.0, 1.0)
    box: BoxConfig = section(
        lambda: BoxConfig(height=0.217, height_std=0.025, head_above=0.01, head_above_std=0.01, across_std=0.021),
        "what a box holds",
    )


@dataclass(frozen=True)
class HaarUpperBodyConfig:
    """Heads with shoulders."""

    cascade: str = parameter("haarcascade_upperbody.xml", "file, or the name of one that comes with OpenCV")
    step: float = parameter(1.1, "from one size to the next", low=1.01)
    neighbours: int = parameter(3, "windows that must agree", low=0)
    confidence: float = parameter(0.7, "of a find that so many agree on; more make it surer", 0.0, 1.0)
    box: BoxConfig = section(
        lambda: BoxConfig(height=0.61, height_std=0.11, head_above=0.09, head_above_std=0.045, across_std=0.045),
        "what a box holds",
    )


class HaarDetector(Detector):
    """One cascade. Its score is the number of windows that agree."""

    mirrored: ClassVar[bool] = False  # whether the cascade knows one side only

    def __init__(self, config: Union[HaarFaceConfig, HaarProfileConfig, HaarUpperBodyConfig]) -> None:
        self.config, self.box = config, config.box
        self._cascade = load_cascade(config.cascade)

    def detect(self, image: Image, search: Search) -> Boxes:
        """See Detector."""
        step = self.config.step
        pieces = list(crops(image, search._replace(heights=search.heights * [1.0 / step, step])))
        finds = [self._agreed([self._windows(crop) for crop in pieces])]
        if self.mirrored:
            finds.append(self._agreed([self._mirrored_windows(crop) for crop in pieces]))
        return gathered(finds, image, search, OVERLAP)

    def _windows(self, crop: Crop) -> np.ndarray:
        """(N, 4) left, top, width and height of all windows in which the cascade sees what it knows."""
        least, largest = int(np.ceil(crop.heights[0])), int(min(crop.heights[1], crop.grey.shape[0]))
        if largest < self._cascade.getOriginalWindowSize()[1]:
            return NO_WINDOWS
        found = self._cascade.detectMultiScale(
            crop.grey, self.config.step, 0, 0, (1, least), (crop.grey.shape[1], largest)
        )
        windows = np.asarray(found, dtype=int).reshape(-1, 4)
        windows = windows[windows[:, 3] >= least]  # where no size fits OpenCV takes another
        return windows + [crop.left, crop.top, 0, 0]

    def _mirrored_windows(self, crop: Crop) -> np.ndarray:
        there = self._windows(crop._replace(grey=np.ascontiguousarray(crop.grey[:, ::-1])))
        there[:, 0] = 2 * crop.left + crop.grey.shape[1] - there[:, 0] - there[:, 2]
        return there

    def _agreed(self, windows: List[np.ndarray]) -> Boxes:
        """Those that enough windows, of whatever piece and size, agree on."""
        import cv2  # 100 MB: not for those who see no images

        neighbours = self.config.neighbours
        found, counts = cv2.groupRectangles(np.concatenate([NO_WINDOWS, *windows]).tolist(), neighbours, SIMILAR)
        if not len(found):
            return Boxes.none()
        x, y, w, h = np.asarray(found, dtype=float).T
        scores = np.ravel(counts).astype(float)
        # Each doubling of the windows that agree halves the doubt.
        doubt = (1.0 - self.config.confidence) * max(neighbours, 1) / np.maximum(scores, 1.0)
        return Boxes(np.column_stack([x, y, x + w, y + h]), scores, np.clip(1.0 - doubt, 0.0, 1.0))


@DETECTORS.register("haar_face", HaarFaceConfig)
class HaarFace(HaarDetector):
    """Frontal faces."""

    part: ClassVar[str] = "face"


@DETECTORS.register("haar_profile", HaarProfileConfig)
class HaarProfile(HaarDetector):
    """Faces from the left and from the right."""

    part: ClassVar[str] = "face"
    mirrored: ClassVar[bool] = True


@DETECTORS.register("haar_upper_body", HaarUpperBodyConfig)
class HaarUpperBody(HaarDetector):
    """Heads with shoulders."""

    part: ClassVar[str] = "upper_body"


def load_cascade(name: str) -> Any:
    """A cv2.CascadeClassifier from a file, or one that comes with OpenCV.

    Raises:
        ConfigError: there is no such file, or it holds no cascade; names the places that were tried.
    """
    import cv2  # 100 MB: not for those who see no images

    own = getattr(getattr(cv2, "data", None), "haarcascades", "")
    folders = [folder for folder in ("", own, *DEBIAN) if folder or "/" in name]
    for folder in folders:
        path = Path(folder) / name
        if path.is_file():
            try:
                cascade = cv2.CascadeClassifier(str(path))
            except cv2.error as error:
                raise ConfigError(f"cascade: {path}: {' '.join(str(error).split())}") from error
            if cascade.empty():
                raise ConfigError(f"cascade: {path} holds no cascade")
            return cascade
    places = ", ".join(filter(None, folders))
    raise ConfigError(f"cascade: there is no {name!r} in {places}; package opencv-data has those of OpenCV")
