"""Faces and bodies by small networks that OpenCV runs: YuNet (Wu et al. 2023) and Yolo-Fastest.

The models are others' and don't come with this package; a file is named by its path and told from others by its
SHA-256.
"""

from __future__ import annotations

import abc
import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, List, NamedTuple, Union

import numpy as np

from people_fusion.core.config import parameter, section
from people_fusion.core.errors import ConfigError
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import BoxConfig, Boxes
from people_fusion.cues.heads.detector import DETECTORS, Crop, Detector, Search, crops, gathered

OVERLAP = 0.4
CUT = 0.02  # of its height, so near to the image's upper or lower edge a box is cut
YUNET_SINCE = (4, 8)  # OpenCV
CONTEXT, OCTAVES = 1.5, 3.0  # of what a network looks at, over the box; of the sizes it looks for at once
MOST_FACES = 500  # in one piece
CELL = 32  # pixels; what Yolo-Fastest's input must be a multiple of
FILLING = 128  # grey beside the image


class Sizes(NamedTuple):
    """Heights that a network finds, in pixels of its input."""

    least: float
    largest: float


@dataclass(frozen=True)
class DnnFaceConfig:
    """Faces, upright, from the front and mostly from the side too."""

    model: str = parameter("", "file of YuNet of 2023, yunet_n_320_320.onnx or face_detection_yunet_2023mar.onnx")
    sha256: str = parameter(
        "81dbde155e982455488235acb8ec2dec5d647edf7cf7080d33e4abb69b93a0d2", "of that file; empty: any file will do"
    )
    threshold: float = parameter(0.5, "of the network's score, which is the confidence", 0.0, 1.0)
    enlarge: float = parameter(1.0, "of the image at most, for faces of less than 12 rows", 1.0, 4.0)
    box: BoxConfig = section(
        lambda: BoxConfig(height=0.17, height_std=0.03, head_above=0.03, head_above_std=0.03), "what a box holds"
    )


@dataclass(frozen=True)
class DnnBodyConfig:
    """Whole bodies."""

    model: str = parameter("", "file of Yolo-Fastest's weights, yolo-fastest-1.1_body.weights")
    sha256: str = parameter(
        "5bbb6d878f6e2eb3deee39e91dc6f9b39700e99ec83fa94d258670a554949728", "of that file; empty: any file will do"
    )
    layers: str = parameter("", "file of its layers; empty: beside the weights, .cfg")
    layers_sha256: str = parameter(
        "045b8e276ebe3924474da8c866b7e709159ea067137b5d66bf9dd560411b2c1a", "of that file; empty: any file will do"
    )
    threshold: float = parameter(0.5, "of the network's score", 0.0, 1.0)
    score_at_half: float = parameter(0.85, "score of finds half of which are people", 0.0, 1.0)
    score_scale: float = parameter(0.05, "of the scores about that", low=1e-3)
    enlarge: float = parameter(1.0, "of the image at most, for people of less than 64 rows", 1.0, 4.0)
    box: BoxConfig = section(
        lambda: BoxConfig(height=1.75, height_std=0.16, head_above=0.75, head_above_std=0.08, across_std=0.08),
        "what a box holds",
    )


class NetworkDetector(Detector):
    """A network that finds a range of sizes at once. Its score is the network's, from 0 to 1.

    Every region of a search is shown to it in as low a resolution as shows what is wanted there. What the image's upper
    or lower edge cuts tells no distance and is left out.
    """

    sizes: ClassVar[Sizes]

    def __init__(self, config: Union[DnnFaceConfig, DnnBodyConfig]) -> None:
        self.config, self.box = config, config.box

    def detect(self, image: Image, search: Search) -> Boxes:
        """See Detector."""
        finds = [self._whole(self._finds(image, crop), image) for crop in crops(image, search, CONTEXT, OCTAVES)]
        return gathered(finds, image, search, OVERLAP)

    @abc.abstractmethod
    def _look(self, pixels: np.ndarray) -> Boxes:
        """What is found in a piece of the image, (H, W, 3), in its pixels."""

    def _finds(self, image: Image, crop: Crop) -> Boxes:
        import cv2  # 100 MB: not for those who see no images

        rows, columns = crop.grey.shape
        if image.pixels.ndim == 3:
            pixels = image.pixels[crop.top : crop.top + rows]
            pixels = pixels.take(np.arange(crop.left, crop.left + columns), axis=1, mode="wrap")
        else:
            pixels = cv2.cvtColor(crop.grey, cv2.COLOR_GRAY2BGR)
        found = [Boxes.none()]
        for factor in self._factors(crop):
            size = max(round(columns * factor), 1), max(round(rows * factor), 1)
            resized = pixels if factor == 1.0 else cv2.resize(pixels, size, interpolation=cv2.INTER_AREA)
            boxes = self._look(np.ascontiguousarray(resized))
            ratios = np.array([columns / size[0], rows / size[1]] * 2)
            corners = boxes.corners * ratios + [crop.left, crop.top, crop.left, crop.top]
            found.append(boxes._replace(corners=corners))
        return Boxes(*(np.concatenate(column) for column in zip(*found)))

    def _factors(self, crop: Crop) -> List[float]:
        """Of the resolutions in which the network sees all sizes that are wanted, the finest first."""
        least, largest = self.sizes
        factors = [float(min(self.config.enlarge, least / max(crop.heights[0], 1e-6)))]
        while min(crop.heights[1], crop.grey.shape[0]) * factors[-1] > largest:
            factors.append(factors[-1] * 2.0 * least / largest)
        return factors

    def _whole(self, boxes: Boxes, image: Image) -> Boxes:
        """Without those that are cut; of those at the sides what is in the image."""
        rows, columns = image.grey.shape
        corners = boxes.corners
        slack = CUT * (corners[:, 3] - corners[:, 1])
        whole = (corners[:, 1] > slack) & (corners[:, 3] < rows - slack)
        if not image.camera.wraps:
            corners = corners.copy()
            corners[:, [0, 2]] = corners[:, [0, 2]].clip(0.0, columns)
        whole &= corners[:, 2] > corners[:, 0]
        return boxes._replace(corners=corners).take(whole)


@DETECTORS.register("dnn_face", DnnFaceConfig)
class DnnFace(NetworkDetector):
    """YuNet. Its scores are as good as probabilities."""

    part: ClassVar[str] = "face"
    sizes: ClassVar[Sizes] = Sizes(12.0, 300.0)

    def __init__(self, config: DnnFaceConfig) -> None:
        import cv2

        super().__init__(config)
        if tuple(int(part) for part in cv2.__version__.split(".")[:2]) < YUNET_SINCE:
            wanted = ".".join(map(str, YUNET_SINCE))
            raise ConfigError(f"dnn_face: needs OpenCV {wanted} or newer, here is {cv2.__version__}")
        path = checked_file("model", config.model, config.sha256)
        try:
            self._net = cv2.FaceDetectorYN.create(str(path), "", (320, 320), config.threshold, OVERLAP, MOST_FACES)
        except cv2.error as error:
            raise ConfigError(f"model: {path}: {' '.join(str(error).split())}") from error

    def _look(self, pixels: np.ndarray) -> Boxes:
        self._net.setInputSize((pixels.shape[1], pixels.shape[0]))
        _, faces = self._net.detect(pixels)
        if faces is None:
            return Boxes.none()
        faces = np.asarray(faces, dtype=float)
        scores = faces[:, 14]  # left, top, width, height, five points of the face, score
        return Boxes(np.hstack([faces[:, :2], faces[:, :2] + faces[:, 2:4]]), scores, scores.clip(0.0, 1.0))


@DETECTORS.register("dnn_body", DnnBodyConfig)
class DnnBody(NetworkDetector):
    """Yolo-Fastest. It is surer than it may be."""

    part: ClassVar[str] = "body"
    sizes: ClassVar[Sizes] = Sizes(64.0, 280.0)

    config: DnnBodyConfig

    def __init__(self, config: DnnBodyConfig) -> None:
        import cv2

        super().__init__(config)
        path = checked_file("model", config.model, config.sha256)
        layers = checked_file("layers", config.layers or str(path.with_suffix(".cfg")), config.layers_sha256)
        try:
            self._net = cv2.dnn.readNetFromDarknet(str(layers), str(path))
        except cv2.error as error:
            raise ConfigError(f"model: {path}: {' '.join(str(error).split())}") from error
        self._outputs = self._net.getUnconnectedOutLayersNames()

    def _look(self, pixels: np.ndarray) -> Boxes:
        import cv2

        rows, columns = pixels.shape[:2]
        below, beside = -rows % CELL, -columns % CELL
        filled = cv2.copyMakeBorder(pixels, 0, below, 0, beside, cv2.BORDER_CONSTANT, value=(FILLING,) * 3)
        self._net.setInput(cv2.dnn.blobFromImage(filled, 1.0 / 255.0, swapRB=True))
        # Middle and size in shares of the input, that there is something, that it is a body.
        found = np.vstack([output.reshape(-1, 6) for output in self._net.forward(self._outputs)]).astype(float)
        found = found[found[:, 5] >= self.config.threshold]
        size = np.array([columns + beside, rows + below], dtype=float)
        middles, halves = found[:, :2] * size, 0.5 * found[:, 2:4] * size
        doubt = 1.0 + np.exp((self.config.score_at_half - found[:, 5]) / self.config.score_scale)
        return Boxes(np.hstack([middles - halves, middles + halves]), found[:, 5], 1.0 / doubt)


def checked_file(parameter_name: str, path: str, sha256: str) -> Path:
    """A model's file.

    Raises:
        ConfigError: it isn't named, isn't there, or is another than `sha256` tells; names the parameter, the file and
            both digests.
    """
    if not path:
        raise ConfigError(f"{parameter_name}: names no file; the network does not come with this package")
    file = Path(path).expanduser()
    try:
        digest = hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise ConfigError(f"{parameter_name}: {file}: {error.strerror}") from error
    if sha256 and digest != sha256.lower():
        raise ConfigError(f"{parameter_name}: {file} has SHA-256 {digest}, expected {sha256.lower()}")
    return file
