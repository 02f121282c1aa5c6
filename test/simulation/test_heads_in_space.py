"""Boxes that detectors find of rendered people, as heads in space: as sure as they are right, and hardly any false.

The seeds are others than those that the defaults were set on.
"""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.images import Image
from people_fusion.cues.heads.boxes import overlaps
from people_fusion.cues.heads.detector import DETECTORS
from people_fusion.cues.heads.heads import HeadCueConfig
from people_fusion.cues.heads.people import ground_search, heads_of_boxes
from people_fusion.simulation.scenario import ScenarioConfig, load_scenario
from people_fusion.simulation.simulator import BASE_HEIGHT, Simulation

ROOM = {"walls": [{"points": [[-3.0, -3.5], [5.0, -3.5], [5.0, 3.5], [-3.0, 3.5]], "closed": True}]}
PINHOLE = {
    "model": "pinhole",
    "topic": "/camera/image_raw",
    "frame": "camera",
    "at": [0.0, 0.0, 1.4],
    "pinhole": {"field": 1.05, "distortion": [0.1, -0.2, 0.0, 0.0, 0.0]},
}
SAME = 0.3  # intersection over union of a head that is found
DIMENSION = 3


def people_near_by(seed, count=24):
    """Pictures of four people each who look at the camera more or less."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        people = []
        for bearing in (-0.4, -0.12, 0.15, 0.42):
            place = rng.uniform(1.0, 3.4) * np.array([np.cos(bearing), np.sin(bearing)])
            people.append({"start": place.tolist(), "facing": rng.normal(0.0, [0.5, 0.7]).tolist()})
        mapping = {"duration_s": 0.5, "room": ROOM, "people": people, "cameras": [PINHOLE], "scanners": []}
        simulation = Simulation(parse(ScenarioConfig, mapping), seed + number)
        yield simulation.cameras[0].picture(simulation.history, 0.1, 0), simulation.cameras[0].camera


def scenario(name, seed, count=4):
    """Pictures 3 s apart; by the museum's panorama where there is no camera."""
    config = load_scenario(name)
    cameras = config.cameras or load_scenario("museum_cameras").cameras
    for number in range(count):
        simulation = Simulation(dataclasses.replace(config, cameras=cameras, duration_s=46.0), seed + number)
        for time_s in np.arange(1.0, 46.0, 3.0).tolist():
            yield simulation.cameras[0].picture(simulation.history, time_s, 0), simulation.cameras[0].camera


def nees_and_false(name, pictures):
    """(N,) of the heads that are found, each once, and other finds an image."""
    detector, cue = DETECTORS.build(parse(DETECTORS.config_of(name, ""), {})), HeadCueConfig()
    ranges = (cue.min_range, cue.max_range)
    values, false, images = [], 0, 0
    for picture, camera in pictures:
        level, truth, height = picture.config.level_from_camera, picture.heads, picture.config.at[2] + BASE_HEIGHT
        search = ground_search(camera, level, height, detector.box, cue.head_heights, ranges)
        boxes = detector.detect(Image(0, "", picture.pixels, camera), search)
        boxes = boxes.take(boxes.confidences >= cue.min_confidence)
        corners = boxes.corners
        holds = (overlaps(corners, truth.corners) > SAME) & (truth.visibility > 0.5)
        first = holds & (holds.cumsum(axis=0) == 1)  # boxes come with the best first
        box, head = np.nonzero(first & (first.cumsum(axis=1) == 1))
        found = heads_of_boxes(corners[box], camera, level, detector.box, boxes.confidences[box])
        errors = found.positions - truth.positions[head] @ level.T
        values.extend(np.einsum("ni,nij,nj->n", errors, np.linalg.inv(found.covariances), errors))
        false, images = false + len(corners) - len(box), images + 1
    assert len(values) > 40
    return np.array(values), false / images


def as_sure_as_they_say_and_hardly_any_false(pictures):
    nees, false = nees_and_false("fhog_head", pictures)
    assert 0.5 * DIMENSION < nees.mean() < 2.0 * DIMENSION
    assert false < 1.0


@pytest.mark.slow
def test_heads_near_by():
    as_sure_as_they_say_and_hardly_any_false(people_near_by(7000))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["museum_cameras", "sitting_camera", "crowd"])
def test_heads_of_people_seen_from_all_sides(name):
    as_sure_as_they_say_and_hardly_any_false(scenario(name, 7000))
