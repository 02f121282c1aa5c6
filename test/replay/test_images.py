"""Images in a recording: head cues look at them, and what cannot be looked at is counted."""

import dataclasses
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from bags import LASER_AT, PERIOD_S, BagBuilder, person_at

from people_fusion.core.camera_models import Panorama, PanoramaConfig
from people_fusion.core.config import section
from people_fusion.cues.heads.boxes import BoxConfig, Boxes
from people_fusion.cues.heads.detector import DETECTORS, Detector
from people_fusion.replay.recording import Recording
from people_fusion.replay.replay import Selection, sources_of
from people_fusion.replay.session import Session
from people_fusion.tracking.fusion import load_config

MAST = (0.0, 0.0, 1.7)  # of the panorama, in base_link
HEAD_HEIGHT, HEAD = 1.6, BoxConfig(height=0.25)
PANORAMA = Panorama(PanoramaConfig())


@dataclass(frozen=True)
class WhiteConfig:
    box: BoxConfig = section(lambda: HEAD, "what a box holds")


@DETECTORS.register("white", WhiteConfig)
class White(Detector):
    """Takes what is white for a head."""

    part = "head"

    def __init__(self, config):
        self.box = config.box

    def detect(self, image, search):
        rows, columns = np.nonzero(image.grey > 128)
        if not len(rows):
            return Boxes.none()
        corners = np.array([[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]], dtype=float)
        return Boxes(corners, np.ones(1), np.full(1, 0.9)).take(search.wanted(corners))


@dataclass(frozen=True)
class RestingConfig(WhiteConfig):
    pass


@DETECTORS.register("resting", RestingConfig)
class Resting(White):
    """The same, of a camera that stands."""

    needs_rest = True


def picture(seconds):
    """What the panorama sees: one white head."""
    x, y = np.add(person_at(seconds), LASER_AT[:2])
    ends = np.array([[x, y, HEAD_HEIGHT - MAST[2] + up] for up in (0.125, -0.125)])
    (column, top), (_, bottom) = PANORAMA.project(ends) + 0.5
    pixels = np.zeros((240, 1406, 3), dtype=np.uint8)
    half = 0.5 * (bottom - top)
    pixels[round(top) : round(bottom), round(column - half) : round(column + half)] = 255
    return pixels


def compressed(bag, seconds, pixels, topic="/panorama/image_raw/compressed", frame="panorama", cut=None):
    data = cv2.imencode(".png", pixels)[1].ravel()[:cut]
    bag.add(topic, "sensor_msgs/CompressedImage", seconds + 0.05, bag.header(seconds, frame), "png", data)


def raw(bag, seconds, pixels, topic="/panorama/image_raw", frame="panorama"):
    height, width = pixels.shape[:2]
    shape = (height, width, "bgr8", 0, 3 * width)
    bag.add(topic, "sensor_msgs/Image", seconds + 0.05, bag.header(seconds, frame), *shape, pixels.ravel())


def recorded(path, write, duration_s=4.0):
    with BagBuilder(path) as bag:
        for step in range(int(duration_s / PERIOD_S)):
            seconds = step * PERIOD_S
            for part in range(5):
                moment = seconds + part * PERIOD_S / 5
                bag.link(moment, "odom", "base_link", (0.5 * moment, 0.0, 0.0))
            bag.link(seconds, "base_link", "laser", LASER_AT)
            bag.link(seconds, "base_link", "panorama", MAST)
            bag.scan(seconds)
            write(bag, seconds)
    return path


def run(path, panoramas=("panorama",), detector="white", scans=False):
    head = {"type": "heads", "detector": {"type": detector}, "ranges": {"scans": scans}}
    described = {frame: {} for frame in panoramas}
    config = load_config(None, {"head_cues": {"head": head}, "panoramas": described})
    measurements = []
    with Recording(path) as recording:
        sources = sources_of(recording, config, Selection())
        framed = dataclasses.replace(config, frames=sources.frames)
        session = Session(framed, sources, lambda measurement, _: measurements.append(measurement))
        session.run(recording)
    return session, sources, [each for each in measurements if each.modality == "head"]


@pytest.mark.parametrize("write", [compressed, raw])
def test_heads_are_seen_where_they_are(tmp_path, write):
    session, _, found = run(recorded(tmp_path / "a.bag", lambda bag, s: write(bag, s, picture(s))))
    assert session.counters()["images"] == session.counters()["images processed"] == len(found) == 40
    assert {each.cue for each in found} == {"panorama/image_raw/head"}
    for step, each in enumerate(found):
        place = np.add(person_at(step * PERIOD_S), LASER_AT[:2])
        assert np.hypot(*(each.positions[0, :2] - place)) < 0.1 * np.hypot(*place)  # whole pixels
        assert each.positions[0, 2] + MAST[2] == pytest.approx(HEAD_HEIGHT, abs=0.03)
    assert session.fusion.tracks().confirmed.sum() == 1


def test_images_that_cannot_be_read_are_counted_and_no_others_are_lost(tmp_path):
    def write(bag, seconds):
        step = round(seconds / PERIOD_S)
        compressed(bag, seconds, picture(seconds), cut=50 if step % 10 == 5 else None)

    session, _, found = run(recorded(tmp_path / "a.bag", write))
    assert session.counters()["unreadable image"] == 4
    assert session.counters()["images processed"] == len(found) == 36


def test_image_of_another_size_is_counted(tmp_path):
    path = recorded(tmp_path / "a.bag", lambda bag, s: compressed(bag, s, np.zeros((100, 100), np.uint8)), 1.0)
    session, _, found = run(path)
    assert sum(count for reason, count in session.counters().items() if "its camera" in reason) == 10
    assert not found and session.processed == session.scans


def test_of_one_camera_one_stream_is_taken(tmp_path):
    def write(bag, seconds):
        raw(bag, seconds, picture(seconds))
        compressed(bag, seconds, picture(seconds))

    _, sources, found = run(recorded(tmp_path / "a.bag", write, 1.0))
    assert [camera.image.name for camera in sources.cameras] == ["/panorama/image_raw"]
    assert len(found) == 10 and any("left out" in note for note in sources.notes)


def test_camera_that_nothing_describes_or_carries_is_left_out_and_said(tmp_path):
    path = recorded(tmp_path / "a.bag", lambda bag, s: compressed(bag, s, picture(s), frame="elsewhere"), 1.0)
    _, sources, found = run(path)
    assert not found and any("no camera_info" in note for note in sources.notes)
    _, sources, found = run(path, panoramas=("elsewhere",))
    assert not found and any("no transform connects elsewhere" in note for note in sources.notes)


def test_preset_without_head_cues_takes_no_images(tmp_path):
    path = recorded(tmp_path / "a.bag", lambda bag, s: compressed(bag, s, picture(s)), 1.0)
    with Recording(path) as recording:
        assert sources_of(recording, load_config("poschmann_t1"), Selection()).cameras == ()


def test_who_cannot_see_while_driving_says_nothing_and_is_not_waited_for(tmp_path):
    path = recorded(tmp_path / "a.bag", lambda bag, s: compressed(bag, s, picture(s)), 2.0)
    session, _, found = run(path, detector="resting")
    assert not found and session.counters()["images without a look"] == session.counters()["images"] == 20
    assert session.processed == session.scans


def test_scans_tell_how_far_away_heads_are(tmp_path):
    path = recorded(tmp_path / "a.bag", lambda bag, s: compressed(bag, s, picture(s)), 2.0)
    (alone, _, by_size), (session, _, by_legs) = (run(path, scans=scans) for scans in (False, True))
    assert session.counters() == alone.counters()
    for step, (size, legs) in enumerate(zip(by_size, by_legs)):
        place = np.add(person_at(step * PERIOD_S), LASER_AT[:2])
        ahead = np.append(place, 0.0) / np.hypot(*place)
        stds = [np.sqrt(ahead @ each.covariances[0] @ ahead) for each in (size, legs)]
        assert stds[1] < 0.6 * stds[0]
        assert np.hypot(*(legs.positions[0, :2] - place)) < 0.1
