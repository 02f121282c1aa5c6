"""Photographs in which somebody has marked the heads, and which of these count.

`annotations.csv` has a line for each head: image, class, xmin, ymin, xmax, ymax (pixels); the images are in `images/`.
"""

from __future__ import annotations

import csv
import hashlib
from pathlib import Path
from typing import Dict, List, NamedTuple, Sequence, Tuple

import numpy as np

from people_fusion.core.errors import RecordingError

COLUMNS = ("image", "class", "xmin", "ymin", "xmax", "ymax")
FINGERPRINT_PX = 24
SAME_SCENE = 0.85  # correlation of fingerprints
UPRIGHT = (0.55, 1.15)  # width over height: what is outside lies, is bent or half hidden
EDGE_PX = 2.0


class Photograph(NamedTuple):
    """One photograph.

    Attributes:
        name: of its file.
        grey: (H, W) uint8.
        boxes: (N, 4) all heads that are marked: left, top, right, bottom, pixels.
        classes: (N,) what kind of head each is.
    """

    name: str
    grey: np.ndarray
    boxes: np.ndarray
    classes: np.ndarray


def photographs(folder: Path, largest_side: int, leave_out: Sequence[str] = ()) -> List[Photograph]:
    """All photographs that have marks, by name.

    Args:
        folder: with annotations.csv and images/.
        largest_side: what is larger is shrunk to that, pixels.
        leave_out: names of files.

    Raises:
        RecordingError: a file is missing or damaged; names it, and the line.
    """
    import cv2  # 100 MB: not for those who see no images

    marks = _marks(folder / "annotations.csv")
    found = []
    for name in sorted(set(marks) - set(leave_out)):
        path = folder / "images" / name
        grey = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if grey is None:
            raise RecordingError(f"{path}: there is no such image, or it is damaged")
        shrink = min(1.0, largest_side / max(grey.shape))
        if shrink < 1.0:
            grey = cv2.resize(grey, None, fx=shrink, fy=shrink, interpolation=cv2.INTER_AREA)
        boxes = np.array([box for _, box in marks[name]])
        found.append(Photograph(name, grey, boxes * shrink, np.array([kind for kind, _ in marks[name]])))
    return found


def digest(images: Sequence[Photograph]) -> str:
    """SHA-256 of all that is learned from."""
    total = hashlib.sha256()
    for image in images:
        for part in (image.name, str(image.grey.shape), *image.classes.tolist()):
            total.update(part.encode())
        total.update(np.ascontiguousarray(image.grey).tobytes())
        total.update(image.boxes.astype("<f8").tobytes())
    return total.hexdigest()


def squares(boxes: np.ndarray) -> np.ndarray:
    """The narrowest squares (N, 4) that enclose boxes (N, 4), about the same middles (Poschmann 2018, 4.5.1)."""
    middles = 0.5 * (boxes[:, :2] + boxes[:, 2:])
    half = 0.5 * (boxes[:, 2:] - boxes[:, :2]).max(axis=1, keepdims=True)
    return np.hstack([middles - half, middles + half])


def upright(image: Photograph) -> np.ndarray:
    """(N,) which heads are whole and of an upright head's shape: not cut by the image's edge, not lying."""
    height, width = image.grey.shape
    low, high = image.boxes[:, :2], image.boxes[:, 2:]
    whole = (low > EDGE_PX).all(axis=1) & (high < [width - EDGE_PX, height - EDGE_PX]).all(axis=1)
    sides = high - low
    ratio = sides[:, 0] / np.maximum(sides[:, 1], 1e-9)
    return np.asarray(whole & (ratio >= UPRIGHT[0]) & (ratio <= UPRIGHT[1]))


def considered(image: Photograph, classes: Sequence[str], least: float) -> np.ndarray:
    """(N,) which heads count: of these classes, upright, and at least so high, pixels. The others are ignored."""
    heights = image.boxes[:, 3] - image.boxes[:, 1]
    return np.asarray(upright(image) & (heights >= least) & np.isin(image.classes, list(classes)))


def folds(images: Sequence[Photograph], count: int, generator: np.random.Generator) -> np.ndarray:
    """(N,) which of `count` folds each photograph is tested in; photographs of one scene are in one fold."""
    scene = scenes(images)
    names = np.unique(scene)
    fold = np.zeros(len(names), dtype=int)
    fold[generator.permutation(len(names))] = np.arange(len(names)) % count
    return fold[np.searchsorted(names, scene)]


def scenes(images: Sequence[Photograph]) -> np.ndarray:
    """(N,) one number for all photographs that show the same from the same place, mirrored or cut otherwise."""
    import cv2  # 100 MB: not for those who see no images

    size = (FINGERPRINT_PX, FINGERPRINT_PX)
    small = np.array([cv2.resize(image.grey, size, interpolation=cv2.INTER_AREA) for image in images], dtype=float)
    plain, mirrored = _unit(small), _unit(small[:, :, ::-1])
    alike = np.maximum(plain @ plain.T, plain @ mirrored.T) > SAME_SCENE
    np.fill_diagonal(alike, True)
    number = np.arange(len(images))
    while True:
        spread = np.where(alike | alike.T, number[None], len(images)).min(axis=1)
        if (spread == number).all():
            return number
        number = spread


def _unit(small: np.ndarray) -> np.ndarray:
    flat = small.reshape(len(small), -1)
    flat = flat - flat.mean(axis=1, keepdims=True)
    return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9))


def _marks(path: Path) -> Dict[str, List[Tuple[str, Tuple[float, ...]]]]:
    """Class and box of each head, by image."""
    marks: Dict[str, List[Tuple[str, Tuple[float, ...]]]] = {}
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            missing = set(COLUMNS) - set(reader.fieldnames or ())
            if missing:
                raise RecordingError(f"{path}: no column {', '.join(sorted(missing))}")
            for line in reader:
                box = tuple(float(line[name]) for name in COLUMNS[2:])
                if not (np.isfinite(box).all() and box[0] < box[2] and box[1] < box[3]):
                    raise RecordingError(f"{path}: line {reader.line_num}: not a box: {box}")
                marks.setdefault(line["image"], []).append((line["class"], box))
    except OSError as error:
        raise RecordingError(f"{path}: {error.strerror}") from error
    except (TypeError, ValueError) as error:
        raise RecordingError(f"{path}: line {reader.line_num}: {error}") from error
    if not marks:
        raise RecordingError(f"{path}: nothing is marked")
    return marks
