#!/usr/bin/env python3
"""What the boxes of whole-body detectors hold, in metres, and whether the heads they give are as sure as they say.

PETS 2009 S2.L1, first view: people of 60 to 130 pixels who walk, a calibrated camera, their boxes and places on the
ground. A find belongs to the person whose box it shares most with, at least half. At that person's true distance the
find's box spans so many metres, its middle is so far below the head, so far to the side: means and standard deviations
of that are what `box` of the detector's config wants to know. The head is taken 12 cm below the top of the person's
true box. NEES is that of the head in space, on average 3 where covariances are right; in brackets the share of heads
within the ellipsoid of 95 %.

The finds' scores, and which of them were people, tell the confidence's `score_at_half` and `score_scale`. Times are
those of the process on one core for an image of 768x576, searched for people from 50 to 250 pixels.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import time
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np

from people_fusion.core.camera_models import Pinhole
from people_fusion.core.config import parse
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.detector import DETECTORS, Search
from people_fusion.cues.heads.people import heads_of_boxes

HEAD_BELOW = 0.12  # top of a person, metres
SAME = 0.5  # intersection over union
LEAST, LARGEST = 50.0, 250.0  # heights of people, pixels
ELLIPSE = 7.815  # chi-square of 3 degrees of freedom, 95 %


def tsai(path):
    """Pinhole camera, rotation into the world's axes (z up), place in the world, metres."""
    values = {}
    for group in ElementTree.parse(path).getroot():
        values.update({key: float(value) for key, value in group.attrib.items()})
    sines, cosines = (function([values[axis] for axis in ("rx", "ry", "rz")]) for function in (np.sin, np.cos))
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cosines[0], -sines[0]], [0.0, sines[0], cosines[0]]])
    about_y = np.array([[cosines[1], 0.0, sines[1]], [0.0, 1.0, 0.0], [-sines[1], 0.0, cosines[1]]])
    about_z = np.array([[cosines[2], -sines[2], 0.0], [sines[2], cosines[2], 0.0], [0.0, 0.0, 1.0]])
    rotation = about_z @ about_y @ about_x
    place = -rotation.T @ np.array([values["tx"], values["ty"], values["tz"]]) / 1000.0
    focal, width, height = values["focal"], int(values["width"]), int(values["height"])
    K = np.diag([focal * values["sx"] / values["dpx"], focal / values["dpy"], 1.0])
    K[:2, 2] = values["cx"], values["cy"]
    # Tsai's polynomial leads from the distorted to the ideal radius, OpenCV's back: fitted, to a hundredth of a pixel.
    distorted = np.linspace(0.0, 4.0, 200)[1:] / focal
    ideal = distorted * (1.0 + values["kappa1"] * (distorted * focal) ** 2)
    powers = np.column_stack([ideal**2, ideal**4, ideal**6])
    k1, k2, k3 = np.linalg.lstsq(powers, distorted / ideal - 1.0, rcond=None)[0]
    return Pinhole(width, height, K, (k1, k2, 0.0, 0.0, k3)), rotation.T, place


def find(detector, camera, folder, frames, truth):
    """Rows of find's corners, score, confidence, and index of the true row or -1; milliseconds per image."""
    found, times = [], []
    for frame in frames:
        pixels = cv2.imread(str(folder / f"img1/{frame:06d}.jpg"))
        image = Image(frame, "camera", pixels, camera)
        search = Search.everywhere(image, LEAST, LARGEST)
        if detector.needs_rest:
            before = cv2.imread(str(folder / f"img1/{frame - 1:06d}.jpg"))
            detector.reset()
            detector.detect(Image(frame - 1, "camera", before, camera), search)
        began = time.process_time()
        boxes = detector.detect(image, search)
        times.append(1e3 * (time.process_time() - began))
        there = np.flatnonzero(truth[:, 0] == frame)
        shared = overlaps(boxes.corners, truth[there, 2:6])
        rows = np.where(shared.max(axis=1, initial=0.0) > SAME, there[shared.argmax(axis=1)], -1)
        found.append(np.column_stack([boxes.corners, boxes.scores, boxes.confidences, rows]))
    return np.concatenate(found), float(np.median(times))


def heights_at(rows, columns, distances, camera, level_from_camera):
    """Over the camera, metres, of what is seen in pixels at horizontal distances."""
    rays = camera.rays(np.column_stack([columns, rows])) @ level_from_camera.T
    return distances * rays[:, 2] / np.hypot(rays[:, 0], rays[:, 1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    default = Path(os.environ.get("PEOPLE_FUSION_DATA", Path(__file__).resolve().parents[2] / "shared/data"))
    parser.add_argument("--data", type=Path, default=default, help="directory of the recordings")
    parser.add_argument("--every", type=int, default=4, help="of so many frames one is looked at (default: 4)")
    arguments = parser.parse_args()
    folder = arguments.data / "pets09_s2l1"
    if not folder.is_dir():
        parser.error(f"{folder} is not there")
    cv2.setNumThreads(1)

    camera, level_from_camera, place = tsai(folder / "View_001.xml")
    truth = np.loadtxt(folder / "gt_frames_1_200.txt", delimiter=",")
    truth[:, 4:6] += truth[:, 2:4]
    frames = range(2, 201, arguments.every)
    people = int(np.isin(truth[:, 0], frames).sum())
    feet = np.column_stack([truth[:, 7:9], np.zeros(len(truth))]) - place
    seen = camera.project(feet @ level_from_camera)
    apart = seen - np.column_stack([0.5 * (truth[:, 2] + truth[:, 4]), truth[:, 5]])
    print(f"camera {place.round(2)} m; true boxes' feet are {np.abs(np.median(apart, axis=0)).round(1)} pixels off")
    model = str(arguments.data / "models/yolo-fastest-1.1_body.weights")
    print("\n                     found  nobody   spans       head above    across        NEES   at config's box")
    for name, parameters in (("hog_body", {"enlarge": 2.0}), ("dnn_body", {"model": model}), ("motion", {})):
        detector = DETECTORS.build(parse(DETECTORS.config_of(name, name), parameters))
        finds, took_ms = find(detector, camera, folder, frames, truth)
        hits = finds[finds[:, 6] >= 0]
        persons = hits[:, 6].astype(int)
        corners, ground = hits[:, :4], feet[persons]
        distances = np.hypot(ground[:, 0], ground[:, 1])
        columns = 0.5 * (corners[:, 0] + corners[:, 2]) - 0.5
        top, bottom = (
            heights_at(corners[:, row] - 0.5, columns, distances, camera, level_from_camera) for row in (1, 3)
        )
        heads = ground.copy()
        true_columns = 0.5 * (truth[persons, 2] + truth[persons, 4])
        heads[:, 2] = heights_at(truth[persons, 3], true_columns, distances, camera, level_from_camera) - HEAD_BELOW
        rays = camera.rays(np.column_stack([columns, 0.5 * (corners[:, 1] + corners[:, 3])])) @ level_from_camera.T
        turn = np.arctan2(rays[:, 1], rays[:, 0]) - np.arctan2(ground[:, 1], ground[:, 0])
        across = distances * np.sin(turn)
        span, above = top - bottom, heads[:, 2] - 0.5 * (top + bottom)
        given = heads_of_boxes(corners, camera, level_from_camera, detector.box)
        errors = given.positions - heads
        nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(given.covariances), errors)
        along = np.hypot(given.positions[:, 0], given.positions[:, 1]) / distances - 1.0
        print(
            f"{name:10s} of {people:5d} {len(hits):7d} {len(finds) - len(hits):7d}   "
            f"{span.mean():.2f} +- {span.std():.2f}  {above.mean():.2f} +- {above.std():.2f}  "
            f"{across.mean():+.2f} +- {across.std():.2f}  {nees.mean():.1f} ({100.0 * (nees < ELLIPSE).mean():.0f} %)  "
            f"distance {100.0 * along.mean():+.0f} % +- {100.0 * along.std():.0f} %  {took_ms:5.1f} ms"
        )
        print_confidences(finds)


def print_confidences(finds):
    """Share of people among the finds of each fifth, and the confidences they were given."""
    order = np.argsort(finds[:, 4])
    for part in np.array_split(finds[order], 5):
        print(
            f"    score {part[0, 4]:6.2f} to {part[-1, 4]:6.2f}: {100.0 * (part[:, 6] >= 0).mean():3.0f} % people, "
            f"confidence {part[:, 5].mean():.2f}"
        )


if __name__ == "__main__":
    main()
