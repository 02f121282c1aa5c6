"""The contract of all detectors: an image in, boxes out."""

from __future__ import annotations

import abc
from typing import ClassVar, Iterator, NamedTuple, Optional, Sequence

import numpy as np

from people_fusion.core.head_scores import NO_SCORES, HeadScores
from people_fusion.core.images import Image
from people_fusion.core.registry import Registry
from people_fusion.cues.heads.boxes import BoxConfig, Boxes, best_of_overlapping

OCTAVES = 0.5  # of sizes that are searched together


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


class Crop(NamedTuple):
    """A piece of the grey image in which finds of some sizes may be.

    Attributes:
        grey: (h, w) uint8.
        left, top: of the piece in the image, pixels; left is negative where it begins beyond the seam of a panorama.
        heights: (2,) least and largest height of boxes.
    """

    grey: np.ndarray
    left: int
    top: int
    heights: np.ndarray


def without_repeats(search: Search, octaves: float = OCTAVES) -> Search:
    """A search of at least the same, in which hardly anything is looked at twice.

    Where regions overlap in place and in size, what is searched is cut by size instead: of each interval the smallest
    region that holds all those that want it.

    Args:
        search: R regions.
        octaves: of an interval of sizes, about.
    """
    corners, heights = search
    margins = 0.5 * heights[:, 1:]
    low, high = corners[:, :2] - margins, corners[:, 2:] + margins
    meet = ((low[:, None] < high[None]) & (low[None] < high[:, None])).all(axis=2)
    meet &= (heights[:, None, 0] < heights[None, :, 1]) & (heights[None, :, 0] < heights[:, None, 1])
    found = []
    free = np.ones(len(corners), dtype=bool)
    while free.any():
        group = np.zeros(len(corners), dtype=bool)
        group[np.argmax(free)] = True
        while (grown := meet[group].any(axis=0)).sum() > group.sum():
            group = grown
        free &= ~group
        members, sizes = corners[group], heights[group]
        least, largest = max(float(sizes[:, 0].min()), 1.0), float(sizes[:, 1].max())
        count = max(round(np.log2(largest / least) / octaves), 1) if len(members) > 1 else 1
        edges = np.geomspace(least, largest, count + 1)
        for lower, upper in zip(edges[:-1], edges[1:]):
            wants = (sizes[:, 0] < upper) & (sizes[:, 1] > lower)
            if wants.any():
                found.append([*members[wants, :2].min(axis=0), *members[wants, 2:].max(axis=0), lower, upper])
    table = np.array(found).reshape(-1, 6)
    return Search(table[:, :4], table[:, 4:])


def crops(image: Image, search: Search, window: float = 1.0, octaves: float = OCTAVES) -> Iterator[Crop]:
    """The pieces of the image that a search needs.

    What is seen in windows of neighbouring sizes may be in several of them.

    Args:
        image, search: as given to `Detector.detect`.
        window: height of what is looked at, over that of the box; the margin is half of the largest.
        octaves: see `without_repeats`; many for detectors that find many sizes at once.
    """
    height, width = image.grey.shape
    for corners, heights in zip(*without_repeats(search, octaves)):
        margin = 0.5 * min(window * heights[1], height)
        top, bottom = np.clip([corners[1] - margin, corners[3] + margin], 0, height).round().astype(int)
        left, right = np.round([corners[0] - margin, corners[2] + margin]).astype(int)
        if image.camera.wraps:
            grey = image.grey[top:bottom].take(np.arange(left, right), axis=1, mode="wrap")
        else:
            left, right = np.clip([left, right], 0, width)
            grey = image.grey[top:bottom, left:right]
        if grey.size and min(grey.shape) >= 1 and heights[0] <= grey.shape[0]:
            yield Crop(np.ascontiguousarray(grey), int(left), int(top), heights)


def gathered(
    finds: Sequence[Boxes], image: Image, search: Search, overlap: float, inside: float = 1.0
) -> Boxes:
    """The finds of all pieces, in the image's pixels: those that are wanted, and of those that overlap the best.

    Args:
        finds: with corners in the image's pixels.
        image, search: as given to `Detector.detect`.
        overlap: intersection over union from which two boxes hold the same.
        inside: share of a smaller box within a larger one from which it holds but a part of that.
    """
    boxes = Boxes(*(np.concatenate(columns) for columns in zip(Boxes.none(), *finds)))
    if image.camera.wraps:
        turns = np.floor(0.5 * (boxes.corners[:, 0] + boxes.corners[:, 2]) / image.camera.width) * image.camera.width
        boxes = boxes._replace(corners=boxes.corners - turns[:, None] * [1.0, 0.0, 1.0, 0.0])
    boxes = boxes.take(search.wanted(boxes.corners))
    period = image.camera.width if image.camera.wraps else 0
    return boxes.take(best_of_overlapping(boxes, overlap, period, inside))


class Detector(abc.ABC):
    """Finds people, or parts of them, in single images. Called from one thread; reads no clock.

    Attributes:
        part: of a person that its boxes hold: "face", "head", "upper_body", "body" or "motion"; the measurement's
            modality.
        needs_rest: whether it compares images that follow each other, so that the camera must stand still.
        box: what its boxes hold, in metres.
        wanted_scores: what `scores` is to give: NO_SCORES, SCORES or FEATURES of core.head_scores; of most detectors
            there are none.

    Args (of every detector's constructor):
        config: its frozen config dataclass.
    """

    part: ClassVar[str]
    needs_rest: ClassVar[bool] = False
    box: BoxConfig
    wanted_scores: str = NO_SCORES

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

    def scores(self, image: Image, boxes: Boxes) -> Optional[HeadScores]:  # noqa: ARG002
        """What its model says of every window of the last image.

        Args:
            image: the same that was given to `detect`.
            boxes: finds in it that are taken for people.
        """
        return None

    def reset(self) -> None:
        """Forget what was seen: time has jumped."""


DETECTORS: Registry[Detector] = Registry("detector", "people_fusion.cues.heads")
