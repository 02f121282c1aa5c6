"""How simulated people look: bodies of ellipsoids with hair, clothes and a painted face."""

from __future__ import annotations

from dataclasses import dataclass
from typing import List, NamedTuple, Tuple

import numpy as np

SKINS = np.array([[155, 185, 225], [135, 165, 210], [110, 140, 190], [75, 105, 155], [50, 70, 110]], dtype=float)
HAIRS = np.array([[25, 28, 32], [30, 45, 65], [50, 80, 115], [95, 135, 170], [150, 150, 150]], dtype=float)
DARK, DARK_HAIRS = 3, 2  # skins from there on go with the first hairs
SHORT, LONG, BALD = 0, 1, 2
SKIN, HAIR, SHIRT, TROUSERS, NECK, EAR = range(6)
FACE_HALF_ANGLE, FACE_HALF_HEIGHT = np.radians(110.0), 0.14  # covered by the face's texture
FACE_SHAPE = (224, 256)  # rows, columns
LONGEST = 16384  # column of points that OpenCV maps at once
# Skull, jaw, nose, ears, short hair and what hangs behind where it is long: middles and half axes, metres.
HEAD = [
    (np.array([-0.012, 0.0, 0.025]), np.array([0.1, 0.078, 0.097]), SKIN),
    (np.array([0.014, 0.0, -0.036]), np.array([0.078, 0.062, 0.084]), SKIN),
    (np.array([0.09, 0.0, -0.03]), np.array([0.022, 0.014, 0.024]), SKIN),
    (np.array([-0.008, 0.078, -0.004]), np.array([0.02, 0.011, 0.031]), EAR),
    (np.array([-0.008, -0.078, -0.004]), np.array([0.02, 0.011, 0.031]), EAR),
    (np.array([-0.02, 0.0, 0.032]), np.array([0.104, 0.086, 0.1]), HAIR),
    (np.array([-0.045, 0.0, -0.06]), np.array([0.075, 0.095, 0.17]), HAIR),
]
SKULL, FACE, SHORT_HEAD = 2, 3, 6  # so many of them
KNEE_M = 0.48
SITS_M = (0.18, 0.28)  # feet that far before the head are those of one who stands, of one who sits


@dataclass(frozen=True, eq=False)
class Look:
    """The looks of one person.

    Attributes:
        colours: (6, 3) blue, green, red by material, 0 to 255.
        face: (R, C, 3) factors of the skin's colour over azimuth, from right to left, and height, from above.
        style: of the hair.
        scale: (3,) of the head, ahead, aside and up.
        shoulders: half their width, metres.
        stripes: contrast of the shirt's.
    """

    colours: np.ndarray
    face: np.ndarray
    style: int
    scale: np.ndarray
    shoulders: float
    stripes: float


class Solids(NamedTuple):
    """Ellipsoids {x: |A (x - c)| <= 1}.

    Attributes:
        centres: (K, 3) metres.
        shapes: (K, 3, 3) the matrices A.
        materials: (K,).
        is_skull: (K,) whether they are skull or jaw, which head boxes enclose.
        is_face: (K,) whether the face is painted on them: skull, jaw and nose.
        on_head: (K,) whether they belong to the head, hair that hangs down left out.
    """

    centres: np.ndarray
    shapes: np.ndarray
    materials: np.ndarray
    is_skull: np.ndarray
    is_face: np.ndarray
    on_head: np.ndarray


def draw_looks(count: int, rng: np.random.Generator) -> List[Look]:
    """So many people."""
    looks = []
    for _ in range(count):
        tone = rng.choice(len(SKINS), p=[0.3, 0.3, 0.2, 0.1, 0.1])
        skin = SKINS[tone] * rng.uniform(0.92, 1.06)
        hairs = len(HAIRS) if tone < DARK else DARK_HAIRS
        hair = HAIRS[rng.integers(len(HAIRS)) % hairs] * rng.uniform(0.8, 1.2)
        shirt = rng.uniform(20.0, 225.0) * rng.uniform(0.6, 1.0, 3)
        trousers = rng.uniform(25.0, 110.0) * rng.uniform(0.7, 1.0, 3)
        style = int(rng.choice([SHORT, LONG, BALD], p=[0.55, 0.35, 0.1]))
        colours = np.array([skin, hair, shirt, trousers, 0.85 * skin, 0.9 * skin])
        face = _face(hair / skin, rng, beard=style != LONG and rng.random() < 0.25, glasses=rng.random() < 0.25)
        scale = rng.normal(1.0, [0.04, 0.04, 0.045]).clip(0.88, 1.12)
        shoulders = rng.uniform(0.165, 0.205)
        looks.append(Look(colours, face, style, scale, shoulders, rng.choice([0.0, 0.0, 0.25])))
    return looks


def stand(head: np.ndarray, heading: float, gaze: float, legs: np.ndarray, look: Look) -> Solids:
    """The solids of one person in the world.

    Args:
        head: (3,) middle of the head, metres.
        heading, gaze: where the body and the head point, radians.
        legs: (2, 3) left and right leg where a scanner cuts them.
        look: of the person.
    """
    solids = _Collector()
    turn, scale = _about_z(gaze), look.scale
    for offset, axes, material in HEAD[: len(HEAD) - (look.style != LONG) - (look.style == BALD)]:
        solids.add(head, turn, offset * scale, axes * scale, material)
    solids.head_ends()
    body, wide = _about_z(heading), look.shoulders
    solids.add(head, body, np.array([-0.025, 0.0, -0.12]), np.array([0.054, 0.059, 0.11]), NECK)
    solids.add(head, body, np.array([-0.035, 0.0, -0.265]), np.array([0.07, wide + 0.01, 0.09]), SHIRT)
    solids.add(head, body, np.array([-0.035, 0.0, -0.43]), np.array([0.12, wide, 0.23]), SHIRT)
    solids.add(head, body, np.array([-0.03, 0.0, -0.6]), np.array([0.11, 0.165, 0.22]), SHIRT)
    hips = head + body @ np.array([-0.03, 0.0, -0.72])
    solids.add(hips, body, np.zeros(3), np.array([0.11, 0.165, 0.12]), TROUSERS)
    ahead = (legs[:, :2].mean(axis=0) - head[:2]) @ body[:2, 0]
    sitting = float(np.clip((ahead - SITS_M[0]) / (SITS_M[1] - SITS_M[0]), 0.0, 1.0))
    for side, leg in zip((1.0, -1.0), legs):
        shoulder = head + body @ np.array([-0.035, side * (wide - 0.03), -0.295])
        elbow = head + body @ np.array([-0.06 + 0.05 * sitting, side * (wide + 0.05), -0.53])
        hand = head + body @ np.array([0.04 + 0.2 * sitting, side * (wide + 0.04), -0.76 + 0.14 * sitting])
        solids.add(shoulder, body, np.zeros(3), np.array([0.058, 0.05, 0.075]), SHIRT)
        solids.limb(shoulder, elbow, 0.054, SHIRT)
        solids.limb(elbow, hand, 0.04, SHIRT)
        solids.add(hand, body, np.zeros(3), np.array([0.042, 0.02, 0.065]), SKIN)
        hip = hips + body @ np.array([0.0, side * 0.085, -0.03])
        upright = leg + (leg - hip) * (leg[2] - 0.05) / max(hip[2] - leg[2], 0.1)
        foot = sitting * np.array([leg[0], leg[1], 0.05]) + (1.0 - sitting) * upright
        knee = sitting * np.array([leg[0], leg[1], KNEE_M]) + (1.0 - sitting) * 0.5 * (hip + foot)
        solids.limb(hip, knee, 0.085, TROUSERS)
        solids.limb(knee, foot, 0.06, TROUSERS)
        solids.add(foot, body, np.array([0.05, 0.0, -0.01]), np.array([0.13, 0.045, 0.05]), TROUSERS)
    return solids.solids()


def hairy(points: np.ndarray) -> np.ndarray:
    """(N,) whether hair grows at points (N, 3) of a head: ahead, left, up, metres."""
    azimuths = np.abs(np.arctan2(points[:, 1], points[:, 0]))
    back = np.clip((azimuths - 0.75) / 0.9, 0.0, 1.0)
    return np.asarray((points[:, 2] > 0.064 - 0.16 * back * back * (3.0 - 2.0 * back)) | (azimuths > 1.75))


def face_factors(points: np.ndarray, look: Look) -> np.ndarray:
    """(N, 3) factors of the skin's colour at points (N, 3) of a head: ahead, left, up, metres."""
    import cv2  # 100 MB: not for those who simulate no images

    rows, columns = FACE_SHAPE
    azimuths = np.arctan2(points[:, 1], points[:, 0])
    x = (azimuths / FACE_HALF_ANGLE + 1.0) * (0.5 * (columns - 1))
    y = (1.0 - points[:, 2] / look.scale[2] / FACE_HALF_HEIGHT) * (0.5 * (rows - 1))
    found = np.ones((len(points), 3), dtype=np.float32)
    for first in range(0, len(points), LONGEST):
        part = slice(first, first + LONGEST)
        across, down = (column[part, None].astype(np.float32) for column in (x, y))
        found[part] = cv2.remap(look.face, across, down, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)[:, 0]
    return found


class _Collector:
    def __init__(self) -> None:
        self._rows: List[Tuple[np.ndarray, np.ndarray, int]] = []
        self._on_head = 0

    def add(self, at: np.ndarray, turn: np.ndarray, offset: np.ndarray, axes: np.ndarray, material: int) -> None:
        """An ellipsoid in axes that are turned."""
        self._rows.append((at + turn @ offset, turn.T / axes[:, None], material))

    def head_ends(self) -> None:
        """What comes now does not turn with the head."""
        self._on_head = len(self._rows)

    def limb(self, start: np.ndarray, end: np.ndarray, radius: float, material: int) -> None:
        """An ellipsoid from one joint to the next."""
        along = end - start
        length = float(np.linalg.norm(along))
        x = along / max(length, 1e-6)
        y = np.cross(x, [0.0, 0.0, 1.0] if abs(x[2]) < 0.9 else [1.0, 0.0, 0.0])
        y /= np.linalg.norm(y)
        axes = np.array([0.5 * length + radius, radius, radius])
        turn = np.column_stack([x, y, np.cross(x, y)])
        self._rows.append((0.5 * (start + end), turn.T / axes[:, None], material))

    def solids(self) -> Solids:
        centres, shapes, materials = zip(*self._rows)
        numbers = np.arange(len(centres))
        flags = (numbers < SKULL, numbers < FACE, numbers < min(self._on_head, SHORT_HEAD))
        return Solids(np.array(centres), np.array(shapes), np.array(materials), *flags)


def _face(hair: np.ndarray, rng: np.random.Generator, beard: bool, glasses: bool) -> np.ndarray:
    """Factors of the skin's colour, see Look.face; light comes from above."""
    rows, columns = FACE_SHAPE
    azimuth = np.degrees(np.linspace(-FACE_HALF_ANGLE, FACE_HALF_ANGLE, columns))[None, :]
    z = np.linspace(FACE_HALF_HEIGHT, -FACE_HALF_HEIGHT, rows)[:, None]
    face = np.ones((rows, columns, 3))

    def spot(at: float, level: float, wide: float, tall: float, power: float = 2.0) -> np.ndarray:
        return np.exp(-0.5 * (np.abs((azimuth - at) / wide) ** power + np.abs((z - level) / tall) ** power))

    def shade(amount: float, place: np.ndarray, tint: Tuple[float, float, float] = (1.0, 1.0, 1.0)) -> None:
        face[:] *= 1.0 - amount * place[:, :, None] * np.array(tint)

    eye, brow, mouth = rng.normal([20.0, 0.025, -0.072], [0.8, 0.0012, 0.002])
    for side in (-1.0, 1.0):
        shade(0.38, spot(side * eye, 0.008, 12.0, 0.016))  # the socket
        shade(-0.35, spot(side * eye, -0.002, 7.5, 0.0045, 4.0))  # white
        shade(0.75, spot(side * eye, 0.004, 7.5, 0.0028, 4.0))  # lid
        shade(0.85, spot(side * eye, -0.001, 3.6, 0.0058, 4.0))  # iris
        lid = spot(side * (eye + 1.0), brow, 10.0, 0.0052, 4.0)[:, :, None]
        face[:] = face * (1.0 - 0.8 * lid) + 0.8 * lid * np.minimum(hair, 0.75)
        shade(0.16, spot(side * 9.0, -0.022, 4.0, 0.02))  # beside the nose
        shade(0.55, spot(side * 5.0, -0.049, 3.2, 0.0035))
        shade(-0.1, spot(side * 27.0, -0.03, 11.0, 0.016))
        shade(0.1, spot(side * 18.0, -0.055, 4.0, 0.014))
        shade(0.3, spot(side * 75.0, -0.02, 18.0, 0.08))
        shade(0.35, spot(side * 48.0, -0.095, 18.0, 0.03))
    shade(-0.16, spot(0.0, -0.012, 4.0, 0.03))
    shade(-0.08, spot(0.0, 0.045, 26.0, 0.02))
    shade(0.3, spot(0.0, -0.056, 9.0, 0.006))
    shade(0.28, spot(0.0, mouth - 0.003, 13.0, 0.011, 3.0), (1.0, 0.9, 0.35))
    shade(0.55, spot(0.0, mouth, 15.0, 0.0028, 3.0))
    shade(0.22, spot(0.0, mouth - 0.018, 10.0, 0.006))
    shade(-0.07, spot(0.0, -0.1, 9.0, 0.009))
    shade(0.4, spot(0.0, -0.135, 60.0, 0.014))  # under the chin
    if beard:
        chin = np.clip((-0.058 - 0.2 * np.abs(azimuth) ** 2 / 9e4 - z) / 0.01, 0.0, 1.0)
        chin = (chin * (1.0 - spot(0.0, mouth - 0.001, 11.0, 0.007, 4.0)))[:, :, None]
        face[:] = face * (1.0 - 0.7 * chin) + 0.7 * chin * np.minimum(hair, 0.8)
    if glasses:
        for side in (-1.0, 1.0):
            ring = np.hypot((azimuth - side * eye) / 13.0, (z + 0.001) / 0.017)
            shade(0.7, np.exp(-0.5 * ((ring - 1.0) / 0.08) ** 2))
        shade(0.6, spot(0.0, 0.004, 6.0, 0.002, 4.0))
    return face.astype(np.float32)


def _about_z(angle: float) -> np.ndarray:
    cos, sin = np.cos(angle), np.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
