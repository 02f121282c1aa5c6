"""Announcements and detections in a recording are cues beside its scans; cues of scans take the time they are told."""

import dataclasses
import heapq

import numpy as np
import pytest
from bags import BagBuilder
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from people_fusion.core.measurements import XY_OBSERVED, Announcement, Bodies, Measurement, Sight
from people_fusion.core.resources import directory
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.replay import conversions
from people_fusion.replay.discovery import discover
from people_fusion.replay.recording import Recording
from people_fusion.replay.session import Session
from people_fusion.replay.track_bag import ANNOUNCEMENTS_TOPIC, DETECTIONS_TOPIC, detection_fields
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.detector import Told
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import START_NS, simulate
from people_fusion.tracking.fusion import load_config

SECONDS = 5.0
NAMES = ["emulated_faces", "emulated_heads", "emulated_upper_bodies", "scan_front", "scan_rear"]


@pytest.fixture(scope="module")
def events():
    return list(simulate(dataclasses.replace(load_scenario("museum_cues"), duration_s=SECONDS), 1))


def measured_at(seconds, cue, frame="camera_link"):
    stamp_ns = START_NS + from_seconds(seconds)
    return Measurement(
        stamp_ns, cue, "head", frame, np.ones((1, 3)), np.eye(3)[None], np.full(1, 0.5), sequence=int(10 * seconds)
    )


def run(path, events, processing_s=None, policy="announced"):
    """Session, the delay of each delivery by cue, and the stamps in the order in which they were processed."""
    write_bag(path, events)
    config = load_config(None, {"buffer": {"type": policy}})
    delays, processed = {}, []

    def measured(measurement, arrival_ns):
        delays.setdefault(measurement.cue, []).append(to_seconds(arrival_ns - measurement.stamp_ns))

    with Recording(path) as recording:
        sources = discover(recording, config.frames)
        session = Session(
            dataclasses.replace(config, frames=sources.frames),
            sources,
            measured,
            after=lambda update: processed.append(update.measurement.stamp_ns),
            processing_s=processing_s,
        )
        session.run(recording)
    return session, delays, processed


def with_more(events, extra):
    return heapq.merge(events, extra, key=lambda event: event[1])


def test_recorded_cues_are_heard_as_they_were_recorded(tmp_path, events):
    session, delays, processed = run(tmp_path / "a.bag", events)
    recorded = [item for topic, _, item in events if topic == DETECTIONS_TOPIC]
    assert sorted(session.fusion.buffer.roster.members) == NAMES == sorted(delays)
    assert session.counters()["recorded measurements"] == len(recorded) > 80
    assert processed == sorted(processed) and len(processed) == len(recorded) + session.processed
    arrivals = {item.order: arrival_ns for topic, arrival_ns, item in events if topic == DETECTIONS_TOPIC}
    faces = [to_seconds(arrival - order[0]) for order, arrival in arrivals.items() if order[1] == "emulated_faces"]
    assert delays["emulated_faces"] == pytest.approx(faces, abs=1e-9)


def test_detections_come_back_as_they_were_written(tmp_path):
    written = dataclasses.replace(
        measured_at(1.0, "camera"),
        positions=np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        covariances=np.array([np.diag([0.1, 0.2, 0.0]), np.diag([0.3, 0.4, 0.0])]),
        confidences=np.array([0.25, 0.75]),
        observed=XY_OBSERVED,
        sight=Sight(np.zeros(2), 0.0, -1.0, 0.5, np.array([1.0, np.nan, 3.0]), 8.0),
        legs=np.array([[1.0, 2.0]]),
        leg_owners=np.array([1]),
        bodies=Bodies(np.array([1.8, 1.2]), np.array([0.02, 0.04]), np.array([0.0, 0.9])),
    )
    told = Told(Announcement(written.stamp_ns, "camera", 10, True), "camera_link")
    write_bag(tmp_path / "a.bag", [
        (ANNOUNCEMENTS_TOPIC, START_NS, told), (DETECTIONS_TOPIC, START_NS + 1, written)
    ])  # fmt: skip
    with Recording(tmp_path / "a.bag") as recording:
        announcement, detections = (recorded.read() for recorded in recording.messages(recording.topics))
    assert conversions.announcement(announcement) == told.announcement
    read = conversions.measurement(detections)
    assert read.order == written.order and read.frame_id == "camera_link" and read.observed == XY_OBSERVED
    for name in ("positions", "covariances", "confidences", "legs", "leg_owners"):
        np.testing.assert_array_equal(getattr(read, name), getattr(written, name))
    np.testing.assert_array_equal(read.sight.ranges, written.sight.ranges)
    np.testing.assert_array_equal(read.bodies, written.bodies)


def test_detections_that_were_recorded_before_there_were_heights_are_read(tmp_path):
    person, persons = (directory("msg") / f"{name}.msg" for name in ("DetectedPerson", "DetectedPersons"))
    older = person.read_text(encoding="utf-8").split("# Of a cue that sees whole people")[0]

    def make(kind, *fields):
        return store.types[kind](*(fields[:4] if kind.endswith("DetectedPerson") else fields))

    with BagBuilder(tmp_path / "a.bag") as bag:
        bag.store = store = get_typestore(Stores.ROS1_NOETIC)
        store.register(get_types_from_msg(older, "people_fusion/msg/DetectedPerson"))
        store.register(get_types_from_msg(persons.read_text(encoding="utf-8"), "people_fusion/msg/DetectedPersons"))
        fields = detection_fields(measured_at(1.0, "camera"), make).values()
        for seconds in (1.0, 2.0):
            header = bag.header(seconds, "camera_link")
            bag.add(DETECTIONS_TOPIC, "people_fusion/DetectedPersons", seconds, header, *fields)
    with Recording(tmp_path / "a.bag") as recording:
        message = next(recording.messages(recording.topics)).read()
    assert not hasattr(message.detections[0], "height")
    read = conversions.measurement(message)
    assert len(read) == 1 and read.bodies is None


def test_what_the_cues_of_these_scans_said_live_is_not_counted_twice(tmp_path, events):
    _, _, expected = run(tmp_path / "a.bag", events)
    own = [
        (DETECTIONS_TOPIC, START_NS + from_seconds(0.5 * k + 0.03), measured_at(0.5 * k + 0.03, "scan_front"))
        for k in range(1, 8)
    ]
    _, _, processed = run(tmp_path / "b.bag", with_more(events, own))
    assert processed == expected


def test_recorded_detections_in_a_frame_without_transform_are_given_up_and_no_others_are(tmp_path, events):
    _, _, expected = run(tmp_path / "a.bag", events)
    lost = []
    for k in range(1, 8):
        measurement = measured_at(0.5 * k, "lost", "nowhere")
        told = Told(Announcement(measurement.stamp_ns, "lost", measurement.sequence), "nowhere")
        lost.append((ANNOUNCEMENTS_TOPIC, measurement.stamp_ns, told))
        lost.append((DETECTIONS_TOPIC, measurement.stamp_ns + 1, measurement))
    session, _, processed = run(tmp_path / "b.bag", with_more(events, lost))
    counters = session.counters()
    given_up = sum(count for name, count in counters.items() if name.startswith("transform"))
    assert processed == expected and given_up == 7


def test_recorded_detections_that_cannot_be_are_counted_and_left_out(tmp_path, events):
    stampless = dataclasses.replace(measured_at(1.0, "camera"), stamp_ns=0)
    nameless = measured_at(2.0, "")
    bad = [(DETECTIONS_TOPIC, START_NS + from_seconds(2.0), item) for item in (stampless, nameless)]
    session, delays, _ = run(tmp_path / "a.bag", with_more(events, bad))
    counters = session.counters()
    assert counters["detections without a stamp"] == counters["detections without a cue's name"] == 1
    assert sorted(delays) == NAMES


def test_cues_of_scans_deliver_when_their_work_is_done(tmp_path, events):
    _, at_once, _ = run(tmp_path / "a.bag", events)
    session, delays, processed = run(tmp_path / "b.bag", events, {"scan_front": 0.02})
    assert np.array(delays["scan_front"]) - at_once["scan_front"] == pytest.approx(0.02, abs=1e-6)
    assert delays["scan_rear"] == at_once["scan_rear"]
    assert session.processed == session.scans and processed == sorted(processed)


def test_a_cue_that_is_too_slow_skips_scans_and_says_so(tmp_path, events):
    session, delays, processed = run(tmp_path / "a.bag", events, {"scan_front": 0.1})
    skipped = session.counters()["scans skipped: the cue is busy"]
    assert session.processed == session.scans - skipped and 5 <= skipped <= 15
    assert max(delays["scan_front"]) <= 2 * 0.1 + 0.09
    assert processed == sorted(processed)


def test_nothing_that_a_cue_works_on_is_lost_at_the_end(tmp_path, events):
    session, _, processed = run(tmp_path / "a.bag", events, {"scan_front": 0.07, "scan_rear": 0.07}, "reprocess")
    assert len(processed) == session.scans + session.counters()["recorded measurements"]
