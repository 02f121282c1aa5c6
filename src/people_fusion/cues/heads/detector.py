"""The contract of all detectors: an image in, boxes out."""

from __future__ import annotations

import abc
from typing import ClassVar, Optional

import numpy as np

from people_fusion.core.images import Image
from people_fusion.core.registry import Registry
from people_fusion.cues.heads.boxes import Boxes


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
    def detect(self, image: Image, least_height: float, largest_height: float, regions: Optional[np.ndarray]) -> Boxes:
        """All finds in an image, without doubles.

        Args:
            image: of any size; a detector is not told of images that follow each other unless it says so.
            least_height: of boxes worth finding, pixels.
            largest_height: the same; may exceed the image.
            regions: (R, 4) corners as in Boxes; only finds whose middle lies in one of them are wanted, so that work
                may be saved elsewhere. None: everywhere.

        Raises:
            DataError: the image is unusable; the detector is unharmed.
        """

    def reset(self) -> None:
        """Forget what was seen: time has jumped."""


DETECTORS: Registry[Detector] = Registry("detector", "people_fusion.cues.heads")
