"""Depth images in a recording: RGB-D cues look at them, and what cannot be looked at is counted."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.image_topics import camera_info_of
from people_fusion.cues.rgbd.rgbd import RgbdCue
from people_fusion.replay.recording import Recording
from people_fusion.replay.replay import Selection, replay, sources_of
from people_fusion.replay.session import Session
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.depth_camera import DepthPicture
from people_fusion.simulation.scenario import ScenarioConfig
from people_fusion.simulation.simulator import simulate
from people_fusion.tracking.fusion import load_config

TOPIC = "/kinect/depth_registered/image_raw"
COLOUR = "/kinect/rgb/image_raw"
HEAD = np.array([2.2, 0.3])


def recorded(path, change=lambda event: [event], encoding="compressedDepth", duration_s=1.5):
    """A bag of somebody who stands before a Kinect; `change` makes other events of each."""
    camera = {"pinhole": {"width": 320, "height": 240}, "encoding": encoding, "colour": COLOUR, "topic": TOPIC}
    mapping = {
        "duration_s": duration_s,
        "room": {"walls": [{"points": [[-4, -4], [5, -4], [5, 4], [-4, 4]], "closed": True}]},
        "people": [{"start": HEAD.tolist(), "facing": [0.0, 0.0]}],
        "robot": {"start": [0.0, 0.0, 0.0]},
        "depth_cameras": [camera],
    }
    events = simulate(parse(ScenarioConfig, mapping), 1)
    write_bag(path, (other for event in events for other in change(event)))
    return path


def run(path, **settings):
    config = load_config(None, {"rgbd_cues": {"people": {"type": "rgbd", **settings}}, "modalities": ["rgbd"]})
    measurements = []
    with Recording(path) as recording:
        sources = sources_of(recording, config, Selection())
        framed = dataclasses.replace(config, frames=sources.frames)
        session = Session(framed, sources, lambda measurement, _: measurements.append(measurement))
        session.run(recording)
    return session, sources, [each for each in measurements if each.modality == "rgbd"]


@pytest.mark.parametrize("encoding", ["compressedDepth", "16UC1", "32FC1"])
def test_people_are_seen_where_they_are(tmp_path, encoding):
    session, sources, found = run(recorded(tmp_path / "a.bag", encoding=encoding))
    counts = session.counters()
    assert counts["depth images"] == counts["depth images processed"] == len(found) == 15
    assert {each.cue for each in found} == {"kinect/depth_registered/image_raw/people"}
    assert all(len(each) == 1 and each.bodies.sitting[0] < 0.1 for each in found)
    (tracks,) = [session.fusion.tracks()]
    assert tracks.confirmed.sum() == 1
    assert np.hypot(*(tracks.means[tracks.confirmed][0, :2] - HEAD)) < 0.1
    assert [note for note in sources.notes if note.startswith("depths ")]


def test_colours_are_there_where_the_cue_wants_them(tmp_path, monkeypatch):
    seen = []
    measure = RgbdCue.measure
    monkeypatch.setattr(RgbdCue, "measure", lambda self, data, source: seen.append(data) or measure(self, data, source))
    path = recorded(tmp_path / "a.bag")
    run(path, colour=True)
    assert all(each.colour.shape == (240, 320, 3) for each in seen) and len(seen) == 15
    cameras = {id(each.camera) for each in seen}
    assert len(cameras) == 1  # though each image has its CameraInfo
    seen.clear()
    run(path)
    assert all(each.colour is None for each in seen)


def test_what_cannot_be_read_is_counted_and_nothing_else_is_lost(tmp_path):
    stamps = []

    def change(event):
        topic, arrival_ns, item = event
        if isinstance(item, DepthPicture):
            stamps.append(item.stamp_ns)
            if len(stamps) % 5 == 0:
                item = dataclasses.replace(item, depths=item.depths[:100])
        return [(topic, arrival_ns, item)]

    session, _, found = run(recorded(tmp_path / "a.bag", change))
    assert len(found) == 12
    assert sum(count for reason, count in session.counters().items() if "its camera" in reason) == 3


def test_depths_without_calibration_are_left_out_and_said(tmp_path):
    _, sources, found = run(recorded(tmp_path / "a.bag", lambda e: [] if e[0] == camera_info_of(TOPIC) else [e]))
    assert not found and not sources.depth_cameras
    assert any("no camera_info" in note for note in sources.notes)


def test_of_one_sensor_the_registered_stream_is_taken(tmp_path):
    raw = "/kinect/depth/image_raw/compressedDepth"

    def change(event):
        topic, arrival_ns, item = event
        if isinstance(item, DepthPicture):
            return [event, (raw, arrival_ns, item)]
        return [event, ("/kinect/depth/camera_info", arrival_ns, item)] if topic == camera_info_of(TOPIC) else [event]

    _, sources, _ = run(recorded(tmp_path / "a.bag", change))
    assert [camera.name for camera in sources.depth_cameras] == [TOPIC]
    assert any(raw in note and "left out" in note for note in sources.notes)


@pytest.mark.parametrize(
    "sent, infos, taken",
    [
        (
            ["/kinect2/hd/image_depth_rect", "/kinect2/qhd/image_depth_rect", "/kinect2/sd/image_depth_rect"],
            ["/kinect2/hd/camera_info", "/kinect2/qhd/camera_info", "/kinect2/sd/camera_info"],
            "/kinect2/sd/image_depth_rect",
        ),
        (["/kinect2/sd/image_ir", "/kinect2/sd/image_depth_rect"], ["/kinect2/sd/camera_info"],
         "/kinect2/sd/image_depth_rect"),
        (["/camera/ir/image_raw", "/camera/depth/image_raw"], ["/camera/ir/camera_info", "/camera/depth/camera_info"],
         "/camera/depth/image_raw"),
        (["/camera/depth/image_raw", "/camera/depth_registered/sw_registered/image_rect_raw"],
         ["/camera/depth/camera_info", "/camera/depth_registered/sw_registered/camera_info"],
         "/camera/depth_registered/sw_registered/image_rect_raw"),
    ],
)  # fmt: skip
def test_sensors_that_send_their_depths_more_than_once_are_one(tmp_path, sent, infos, taken):
    def change(event):
        topic, arrival_ns, item = event
        if isinstance(item, DepthPicture):
            return [(name, arrival_ns, item) for name in sent]
        return [(name, arrival_ns, item) for name in infos] if topic == camera_info_of(TOPIC) else [event]

    _, sources, found = run(recorded(tmp_path / "a.bag", change, encoding="16UC1", duration_s=0.5))
    assert [camera.name for camera in sources.depth_cameras] == [taken]
    assert len(found) == 5


def test_preset_without_rgbd_cues_takes_no_depths(tmp_path):
    config = load_config("poschmann_t1")
    with Recording(recorded(tmp_path / "a.bag")) as recording:
        assert not sources_of(recording, config, Selection()).depth_cameras


def test_heights_and_postures_are_recorded(tmp_path):
    path = recorded(tmp_path / "a.bag")
    out = tmp_path / "out.bag"
    replay(path, load_config(None, {"modalities": ["rgbd"]}), Selection(), out)
    with Recording(out) as recording:
        (topic,) = recording.of_kind("DetectedPersons")
        messages = [each.read() for each in recording.messages([topic])]
    people = [person for message in messages if message.modality == "rgbd" for person in message.detections]
    assert len(people) == 15
    assert all(1.4 < person.height < 2.1 and 0.0 < person.height_std < 0.1 for person in people)
