"""The contract of all detectors: an image in, boxes out."""

from __future__ import annotations

import abc
from typing import ClassVar, NamedTuple

import numpy as np

from people_fusion.core.images import Image
from people_fusion.core.registry import Registry
from people_fusion.cues.heads.boxes import Boxes


class Search(NamedTuple):
    """What finds are wanted: those whose middle lies in a region and whose height is within that region's limits.

    Attributes:
        corners: (R, 4) regions as Boxes.corners.
        heights: (R, 2) least and largest height of boxes, pixels.
    """

    corners: np.ndarray
    heights: np.ndarray

    @staticmethod
    def everywhere(image: Image, least: float, largest: float) -> Search:
        """The whole image."""
        height, width = image.pixels.shape[:2]
        return Search(np.array([[0.0, 0.0, width, height]]), np.array([[least, largest]]))

    def wanted(self, corners: np.ndarray) -> np.ndarray:
        """(N,) which of the boxes (N, 4) are."""
        middles, heights = 0.5 * (corners[:, :2] + corners[:, 2:]), corners[:, 3] - corners[:, 1]
        inside = (middles[:, None] >= self.corners[:, :2]) & (middles[:, None] <= self.corners[:, 2:])
        fits = (heights[:, None] >= self.heights[:, 0]) & (heights[:, None] <= self.heights[:, 1])
        return np.asarray((inside.all(axis=2) & fits).any(axis=1))


class Detector(abc.ABC):
    """Finds people, or parts of them, in single images. Called from one thread; reads no clock.

    Attributes:
        part: of a person that its boxes hold: "face", "head", "upper_body", "body" or "motion"; the measurement's
            modality.

    Args (of every detector's constructor):
        config: its frozen config dataclass.
    """

    part: ClassVar[str]

    @abc.abstractmethod
    def detect(self, image: Image, search: Search) -> Boxes:
        """All finds in an image that are wanted, without doubles.

        Args:
            image: of any size; a detector is not told of images that follow each other unless it says so.
            search: where and how large finds may be; elsewhere work may be saved. What is found there all the same is
                left out (`Search.wanted`).

        Raises:
            DataError: the image is unusable; the detector is unharmed.
        """

    def reset(self) -> None:
        """Forget what was seen: time has jumped."""


DETECTORS: Registry[Detector] = Registry("detector", "people_fusion.cues.heads")
