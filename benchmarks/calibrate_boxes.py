#!/usr/bin/env python3
"""What detectors find of rendered people, what their boxes hold, and whether their heads are as sure as they say.

Rooms with people who stand before a camera and look about are rendered (docs/cameras.md). A find belongs to the person
the middle of whose head it covers, the best one only; all others are false. At that person's true distance the find's
box spans so many metres, its middle is so far below the head, so far to the side: means and standard deviations of that
are what `box` of the detector's config wants to know. NEES is that of the head in space, on average 3 where covariances
are right: with the config's box, and with the measured one, which knows no doubt; beside it the share of heads within
the ellipsoid of 95 %.

Recall is that of heads of so many pixels and more, nine tenths of which are visible: of faces turned away by half a
radian at most, and of all. With --ground images are searched as the cue does, where people on the floor may be seen.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import argparse
import dataclasses
import time

import numpy as np
import yaml

from people_fusion.core.config import parse
from people_fusion.core.errors import PeopleFusionError
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import BoxConfig
from people_fusion.cues.heads.detector import DETECTORS, Search
from people_fusion.cues.heads.heads import HeadCueConfig
from people_fusion.cues.heads.people import ground_search, heads_of_boxes
from people_fusion.simulation.scenario import ScenarioConfig, load_scenario
from people_fusion.simulation.simulator import BASE_HEIGHT, Simulation

PLAIN, FRONTAL = 0.9, 0.5  # share, radians
LOOKS = 4  # pictures of the same people, who look about
MUSEUM = "museum_cameras"
VISITS, VISIT_S = 15, 3.0  # pictures of one run of a scenario, and the time from one to the next
RATIOS = (0.4, 12.0)  # of a find's height and the head's
ELLIPSE = 7.815  # chi-square of 3 degrees of freedom, 95 %
CAMERAS = {
    "pinhole": {
        "model": "pinhole",
        "topic": "/camera/image_raw",
        "frame": "camera",
        "at": [0.0, 0.0, 1.4],
        "pinhole": {"field": 1.05, "distortion": [0.1, -0.2, 0.0, 0.0, 0.0]},
    },
    "panorama": {},
    "panorama_large": {"panorama": {"width": 2812, "height": 480}, "blur": 0.8},
}


def scenario(camera, rng):
    """Some people before the camera, who look at it more or less."""
    places = []
    while len(places) < 4:
        distance, bearing = rng.uniform(0.9, 3.6), rng.uniform(-0.45, 0.45)
        place = distance * np.array([np.cos(bearing), np.sin(bearing)])
        if all(np.linalg.norm(place - other) > 0.6 for other in places):
            places.append(place)
    room = {"walls": [{"points": [[-3.0, -3.5], [5.0, -3.5], [5.0, 3.5], [-3.0, 3.5]], "closed": True}]}
    people = [
        {"start": [float(x), float(y)], "facing": [float(rng.normal(0.0, 0.5)), float(rng.normal(0.0, 0.7))]}
        for x, y in places
    ]
    mapping = {"duration_s": 1.5 * LOOKS, "room": room, "people": people, "cameras": [CAMERAS[camera]], "scanners": []}
    return parse(ScenarioConfig, mapping)


def rendered(camera, count, seed):
    """Pairs of picture and simulated camera."""
    if camera not in CAMERAS:
        config = load_scenario(camera)
        cameras = config.cameras or load_scenario(MUSEUM).cameras
        config = dataclasses.replace(config, cameras=cameras, duration_s=VISITS * VISIT_S + 1.0)
        for number in range(count):
            visit, place = divmod(number, VISITS)
            if not place:
                simulation = Simulation(config, seed + visit)
            yield simulation.cameras[0].picture(simulation.history, 1.0 + VISIT_S * place, 0), simulation.cameras[0]
        return
    rng = np.random.default_rng(seed)
    for number in range(-(-count // LOOKS)):
        simulation = Simulation(scenario(camera, rng), seed + number)
        for look in range(LOOKS):
            yield simulation.cameras[0].picture(simulation.history, 0.1 + 1.5 * look, 0), simulation.cameras[0]


def owners(corners, heads):
    """(N,) row of the head that each box holds, -1: none."""
    middles = 0.5 * (heads.corners[:, :2] + heads.corners[:, 2:])
    tall = heads.corners[:, 3] - heads.corners[:, 1]
    ratio = (corners[:, 3] - corners[:, 1])[:, None] / tall
    holds = (middles[None] > corners[:, None, :2]).all(axis=2) & (middles[None] < corners[:, None, 2:]).all(axis=2)
    holds &= (ratio > RATIOS[0]) & (ratio < RATIOS[1]) & (heads.visibility > 0.5)
    off = np.abs(0.5 * (corners[:, 0] + corners[:, 2])[:, None] - middles[:, 0]) / tall
    best = np.where(holds, off, np.inf)
    return np.where(holds.any(axis=1), best.argmin(axis=1), -1) if len(tall) else np.full(len(corners), -1)


def spans(corners, camera, level, positions):
    """(N, 3) height of what boxes hold at the true heads' distances, head over its middle, to its left; metres."""
    columns = 0.5 * (corners[:, 0] + corners[:, 2]) - 0.5
    rays = [camera.rays(np.column_stack([columns, corners[:, row] - 0.5])) @ level.T for row in (1, 3)]
    top, bottom = (ray[:, 2] / np.hypot(ray[:, 0], ray[:, 1]) for ray in rays)
    middle = 0.5 * (rays[0] + rays[1])
    azimuth = np.arctan2(middle[:, 1], middle[:, 0])
    head = positions @ level.T
    distance = np.hypot(head[:, 0], head[:, 1])
    aside = distance * np.sin(np.arctan2(head[:, 1], head[:, 0]) - azimuth)
    return np.column_stack([distance * (top - bottom), head[:, 2] - distance * 0.5 * (top + bottom), aside])


def nees(corners, camera, level, positions, box, confidences):
    """(N,) of heads in space."""
    found = heads_of_boxes(corners, camera, level, box, confidences)
    errors = found.positions - positions @ level.T
    return np.einsum("ni,nij,nj->n", errors, np.linalg.inv(found.covariances), errors)


def searched(image, config, box, by_ground):
    """Where to look."""
    if not by_ground:
        return Search.everywhere(image, 20.0, float(image.camera.height))
    cue, height = HeadCueConfig(), config.at[2] + BASE_HEIGHT
    ranges = (cue.min_range, cue.max_range)
    return ground_search(image.camera, config.level_from_camera, height, box, cue.head_heights, ranges)


def measure(name, parameters, pictures, by_ground, least):
    """Print what one detector makes of the pictures."""
    detector = DETECTORS.build(parse(DETECTORS.config_of(name, name), parameters))
    corners, confidences, positions, frontal, everybody, false, busy = [], [], [], [], [], 0, 0.0
    for picture, simulated in pictures:
        image = Image(0, picture.config.frame, picture.pixels, simulated.camera)
        began = time.process_time()
        boxes = detector.detect(image, searched(image, picture.config, detector.box, by_ground))
        busy += time.process_time() - began
        order = np.argsort(-boxes.scores, kind="stable")
        boxes = boxes.take(order)
        rows = owners(boxes.corners, picture.heads)
        again = np.array([row in rows[:number] for number, row in enumerate(rows)], dtype=bool)
        rows[again] = -1  # a head is held by the best of its boxes
        false += int((rows < 0).sum())
        tall = picture.heads.corners[:, 3] - picture.heads.corners[:, 1]
        wanted = (tall >= least) & (picture.heads.visibility >= PLAIN)
        found = np.isin(np.arange(len(tall)), rows)
        everybody.extend(found[wanted])
        frontal.extend(found[wanted & (np.abs(picture.heads.yaws) <= FRONTAL)])
        corners.append(boxes.corners[rows >= 0])
        confidences.append(boxes.confidences[rows >= 0])
        positions.append(picture.heads.positions[rows[rows >= 0]])
    camera, level = simulated.camera, picture.config.level_from_camera
    corners, confidences, positions = (np.concatenate(each) for each in (corners, confidences, positions))
    print(f"{name}: {len(frontal)} frontal heads, {100 * np.mean(frontal):.0f} % found; {len(everybody)} of all, "
          f"{100 * np.mean(everybody):.0f} %; {false / len(pictures):.2f} false an image; "
          f"{1e3 * busy / len(pictures):.0f} ms an image")
    if len(corners) < 5:
        return
    held = spans(corners, camera, level, positions)
    right = np.abs(held[:, 0] / np.median(held[:, 0]) - 1.0) < 0.6  # others hold something else
    corners, confidences, positions, held = (each[right] for each in (corners, confidences, positions, held))
    mean, std = held.mean(axis=0), held.std(axis=0)
    across = np.hypot(mean[2], std[2])
    measured = BoxConfig(*(float(value) for value in (mean[0], std[0], mean[1], std[1], across)))
    print(f"  measured: height {mean[0]:.3f} +- {std[0]:.3f}, head_above {mean[1]:.3f} +- {std[1]:.3f}, "
          f"across {std[2]:.3f} (mean {mean[2]:.3f})")
    for title, box in (("config", detector.box), ("measured", measured)):
        values = nees(corners, camera, level, positions, box, confidences)
        print(f"  NEES of 3 with the box of {title}: mean {np.mean(values):.2f}, median {np.median(values):.2f} "
              f"(honest 2.37), within 95 %: {100 * np.mean(values < ELLIPSE):.0f} %")


def main():
    """Entry."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("detectors", nargs="*", default=["haar_face", "haar_upper_body"])
    parser.add_argument("--camera", default="pinhole",
                        help=f"{', '.join(CAMERAS)}, or a scenario; one without cameras gets the museum's panorama")
    parser.add_argument("--ground", action="store_true", help="look where people on the floor may be seen only")
    parser.add_argument("--least", type=float, default=40.0, help="height of heads that should be found, pixels")
    parser.add_argument("--images", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE", help="parameters of all the detectors")
    options = parser.parse_args()
    parameters = {key: yaml.safe_load(value) for key, value in (each.split("=", 1) for each in options.set)}
    try:
        pictures = list(rendered(options.camera, options.images, options.seed))
    except PeopleFusionError as error:
        parser.error(str(error))
    for name in options.detectors:
        try:
            measure(name, parameters, pictures, options.ground, options.least)
        except PeopleFusionError as error:
            print(f"{name}: {error}")


main()
