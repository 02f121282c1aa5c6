"""A recording goes through cues and fusion as through the live graph: late transforms, bad data, odd clocks."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, Callable, List, Tuple

import numpy as np
import pytest
from bags import LASER_AT, BagBuilder, person_at, walk
from rosbags.rosbag1 import Reader, Writer
from rosbags.typesys import get_types_from_msg

from people_fusion.core.errors import RecordingError
from people_fusion.core.measurements import Measurement
from people_fusion.core.tracks import Tracks
from people_fusion.replay.discovery import discover
from people_fusion.replay.recording import Recording
from people_fusion.replay.replay import Outcome, Selection, replay
from people_fusion.replay.session import Session
from people_fusion.replay.typestore import typestore
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import simulate
from people_fusion.tracking.fusion import Fusion, load_config

WALK = Selection(only_annotated=True)


def run(path: Path, **overrides: Any) -> Tuple[Session, List[Tracks]]:
    """Session after the whole recording, and the tracks after each measurement."""
    config = load_config(None, overrides)
    shown: List[Tracks] = []
    with Recording(path) as recording:
        sources = discover(recording, config.frames)
        session = Session(
            dataclasses.replace(config, frames=sources.frames),
            sources,
            after=lambda _: shown.append(session.fusion.tracks()),
        )
        session.run(recording)
    return session, shown


def scored(path: Path, **selection: Any) -> Outcome:
    return replay(path, load_config(), dataclasses.replace(WALK, **selection))


def test_a_person_who_walks_is_tracked_in_the_odometry_frame(tmp_path: Path) -> None:
    session, shown = run(walk(tmp_path / "a.bag", 5.0))
    tracks = shown[-1].select(shown[-1].confirmed)
    seconds = 4.9
    expected = np.array(person_at(seconds)) + [LASER_AT[0] + 0.5 * seconds, LASER_AT[1]]
    assert tracks.frame_id == "odom" and session.processed >= 48
    assert np.linalg.norm(tracks.means[:, :2] - expected, axis=1).min() < 0.2


def test_a_recording_without_tf_is_tracked_in_the_frame_of_the_sensor(tmp_path: Path) -> None:
    _, shown = run(walk(tmp_path / "a.bag", 5.0, tf_kind=None))
    tracks = shown[-1].select(shown[-1].confirmed)
    assert tracks.frame_id == "laser"
    assert np.linalg.norm(tracks.means[:, :2] - person_at(4.9), axis=1).min() < 0.2


@pytest.mark.parametrize("beams, field_of_view_deg", [(245, 190.0), (1440, 359.75)])
def test_any_scanner_will_do(tmp_path: Path, beams: int, field_of_view_deg: float) -> None:
    outcome = scored(walk(tmp_path / "a.bag", 5.0, beams=beams, field_of_view_deg=field_of_view_deg))
    assert outcome.processed >= 48
    assert outcome.evaluation is not None
    assert outcome.evaluation.scores.clear_mot.misses <= 3


@pytest.mark.parametrize("offset_s", [-4000.0, 300.0])
def test_a_clock_that_is_minutes_off_changes_nothing(tmp_path: Path, offset_s: float) -> None:
    _, here = run(walk(tmp_path / "a.bag", 5.0))
    _, there = run(walk(tmp_path / "b.bag", 5.0, clock_offset_s=offset_s))
    assert [tracks.stamp_ns for tracks in here] == [tracks.stamp_ns for tracks in there]
    np.testing.assert_array_equal(here[-1].means, there[-1].means)


def test_scans_wait_for_transforms_that_are_late(tmp_path: Path) -> None:
    prompt, here = run(walk(tmp_path / "a.bag", 5.0))
    late, there = run(walk(tmp_path / "b.bag", 5.0, tf_latency_s=0.2))
    assert late.processed >= prompt.processed - 1
    np.testing.assert_array_equal(here[-1].means, there[-1].means)


def test_scans_whose_transforms_are_too_late_are_given_up_and_counted(tmp_path: Path) -> None:
    session, shown = run(walk(tmp_path / "a.bag", 3.0, tf_latency_s=0.8))
    assert shown == []
    assert session.counters()["transform did not arrive in time"] > 20


def test_a_recording_of_which_no_scan_can_be_used_is_refused_with_the_reason(tmp_path: Path) -> None:
    path = walk(tmp_path / "a.bag", 3.0, tf_latency_s=0.8)
    with pytest.raises(RecordingError, match=r"a\.bag: no scan could be used .*transform did not arrive in time"):
        scored(path)


def test_scans_without_stamp_and_transforms_that_are_not_finite_are_counted_and_left_out(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for step in range(30):
            bag.odometry_links(step * 0.1)
            bag.link(step * 0.1 + 0.05, "odom", "base_link", (np.nan, 0.0, 0.0))
            bag.scan(step * 0.1, stamped=step % 10 != 3)
    session, shown = run(tmp_path / "a.bag")
    counters = session.counters()
    assert counters["scan without stamp"] == 3
    assert sum(count for name, count in counters.items() if name.startswith("transform: ")) == 30
    assert session.processed == 27 and np.isfinite(shown[-1].means).all()


def test_a_scan_that_is_empty_or_re_shaped_harms_no_other(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for step in range(50):
            bag.odometry_links(step * 0.1)
            bag.scan(step * 0.1, beams={10: 0, 20: 1, 30: 2000}.get(step, 541))
            if step % 5 == 0:
                bag.person_array(step * 0.1)
    outcome = scored(tmp_path / "a.bag")
    assert outcome.processed >= 48 and outcome.counters["scan without beams"] == 1
    assert outcome.evaluation is not None and outcome.evaluation.scores.clear_mot.misses <= 3


def test_only_instants_within_the_measurements_are_scored(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for step in range(60):
            if 10 <= step < 40:
                bag.scan(step * 0.1)
            bag.person_array(step * 0.1)
    outcome = scored(tmp_path / "a.bag", ground_truth="/ground_truth")
    assert outcome.truth is not None
    seconds = (outcome.truth.stamps_ns - outcome.truth.stamps_ns[0]) / 1e9
    assert seconds[-1] == pytest.approx(2.8)  # from the first scan to before the last


def test_a_window_of_the_recording_can_be_replayed(tmp_path: Path) -> None:
    outcome = scored(walk(tmp_path / "a.bag", 6.0), start_s=2.0, duration_s=3.0)
    assert outcome.recorded_s == pytest.approx(2.9) and outcome.scans == 30


@pytest.mark.parametrize("offset_s", [-4000.0, 300.0])
def test_the_recording_lasts_as_long_as_its_stamps_say(tmp_path: Path, offset_s: float) -> None:
    with BagBuilder(tmp_path / "a.bag", offset_s) as bag:
        for step in range(30):
            bag.scan(step * 0.1, latency_s=-step * 0.09)  # written to the bag in a hurry
    assert scored(tmp_path / "a.bag").recorded_s == pytest.approx(2.9)


def test_no_scan_is_lost_at_a_later_start(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for seconds in np.arange(0.0, 4.0, 0.02):
            bag.odometry_links(seconds)
        for step in range(30):
            bag.scan(step * 0.1)
    outcome = scored(tmp_path / "a.bag", start_s=2.01)
    assert outcome.processed == outcome.scans == 10


def test_the_last_localisation_before_a_later_start_counts(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        variances = np.diag([0.5, 0.5, 0.0, 0.0, 0.0, 0.0]).ravel()
        pose = bag.make("geometry_msgs/PoseWithCovariance", bag.pose(0.0, 0.0), variances)
        bag.add("/amcl_pose", "geometry_msgs/PoseWithCovarianceStamped", 0.1, bag.header(0.1, "map"), pose)
        for step in range(300):
            bag.link(step * 0.1, "map", "odom")
            bag.link(step * 0.1, "odom", "base_link")
            bag.link(step * 0.1, "base_link", "laser")
            bag.scan(step * 0.1)
    config = load_config()
    with Recording(tmp_path / "a.bag") as recording:
        sources = discover(recording, config.frames)
        session = Session(dataclasses.replace(config, frames=sources.frames), sources)
        session.run(recording, 25.0)
    assert session.fusion.transforms.has_localisation


def test_a_latched_map_and_static_transforms_count_from_a_later_start_on(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        info = bag.make("nav_msgs/MapMetaData", bag.time(0.0), 0.05, 20, 20, bag.pose(50.0, 50.0))
        bag.add("/map", "nav_msgs/OccupancyGrid", 0.0, bag.header(0.0, "odom"), info, np.zeros(400, np.int8))
        bag.link(0.0, "base_link", "laser", LASER_AT, topic="/tf_static")
        for step in range(40):
            bag.link(step * 0.1, "odom", "base_link")
            bag.scan(step * 0.1)
    outcome = scored(tmp_path / "a.bag", start_s=2.0)
    assert outcome.grid is not None and outcome.processed >= 18


def test_people_are_scored_where_they_are_annotated_in_the_frame_of_the_scanner(tmp_path: Path) -> None:
    outcome = scored(walk(tmp_path / "a.bag", 6.0))
    assert outcome.evaluation is not None
    scores = outcome.evaluation.scores.clear_mot
    assert scores.ground_truth_count >= 10 and scores.misses <= 3 and scores.mismatches == 0
    assert scores.motp_m is not None and scores.motp_m < 0.15


def test_without_annotations_nothing_is_scored(tmp_path: Path) -> None:
    outcome = replay(walk(tmp_path / "a.bag", 2.0, truth=False), load_config(), Selection())
    assert outcome.evaluation is None and outcome.truth is None and outcome.processed > 15


def test_annotations_in_a_frame_that_never_appears_are_refused_by_name(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for step in range(20):
            bag.scan(step * 0.1)
            bag.person_array(step * 0.1, frame_id="mars")
    with pytest.raises(RecordingError, match="no transform connects mars of /ground_truth with laser"):
        scored(tmp_path / "a.bag")


@pytest.mark.parametrize("offset_s", [0.0, -4000.0, 300.0])
def test_arrivals_are_told_on_the_clock_of_the_stamps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, offset_s: float
) -> None:
    delays_s: List[float] = []
    push = Fusion.push

    def spy(fusion: Fusion, measurement: Measurement, now_ns: int) -> bool:
        delays_s.append((now_ns - measurement.stamp_ns) / 1e9)
        return push(fusion, measurement, now_ns)

    monkeypatch.setattr(Fusion, "push", spy)
    run(walk(tmp_path / "a.bag", 2.0, clock_offset_s=offset_s))
    assert len(delays_s) > 15 and min(delays_s) >= 0.0 and max(delays_s) < 0.2


def without_odometry_in_tf(source: Path, target: Path) -> Path:
    """A copy of a bag whose tf does not place the robot in odom."""
    with Reader(source) as reader, Writer(target) as writer:
        store = typestore()
        store.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", "tf2_msgs/msg/TFMessage"))
        copies = {
            connection.id: writer.add_connection(
                connection.topic, connection.msgtype, msgdef=connection.msgdef.data, md5sum=connection.digest
            )
            for connection in reader.connections
        }
        for connection, arrival_ns, data in reader.messages():
            if connection.topic == "/tf":
                message = store.deserialize_ros1(data, connection.msgtype)
                kept = [entry for entry in message.transforms if entry.child_frame_id != "base_footprint"]
                data = store.serialize_ros1(dataclasses.replace(message, transforms=kept), connection.msgtype)
            writer.write(copies[connection.id], arrival_ns, data)
    return target


def test_odometry_messages_do_as_well_as_the_transform(tmp_path: Path) -> None:
    scenario = dataclasses.replace(load_scenario("follow"), duration_s=12.0)
    write_bag(tmp_path / "with.bag", simulate(scenario, 1))
    without_odometry_in_tf(tmp_path / "with.bag", tmp_path / "without.bag")
    expected = replay(tmp_path / "with.bag", load_config(), Selection())
    outcome = replay(tmp_path / "without.bag", load_config(), Selection())
    assert outcome.sources.odometry is not None and outcome.sources.frames == expected.sources.frames
    assert outcome.processed >= expected.processed - 3
    assert outcome.evaluation is not None and expected.evaluation is not None
    mota, wanted = outcome.evaluation.scores.clear_mot.mota, expected.evaluation.scores.clear_mot.mota
    assert mota == pytest.approx(wanted, abs=0.05)


def test_a_simulated_museum_is_tracked_in_its_map_with_its_localisation(tmp_path: Path) -> None:
    scenario = dataclasses.replace(load_scenario("museum"), duration_s=10.0)
    write_bag(tmp_path / "museum.bag", simulate(scenario, 1))
    outcome = replay(tmp_path / "museum.bag", load_config(), Selection())
    sources = outcome.sources
    assert [topic.name for topic in sources.scans] == ["/scan_front", "/scan_rear"]
    assert sources.localisation is not None and sources.localisation.name == "/amcl_pose"
    assert sources.map is not None and (sources.frames.world, sources.frames.odom) == ("map", "odom")
    assert outcome.processed >= outcome.scans - 3
    assert outcome.evaluation is not None and outcome.evaluation.scores.clear_mot.matches > 5


def stamped(path: Path, steps: int, stamp_s: Callable[[int], float], static_mount: bool = False) -> Path:
    """Somebody walks past a standing robot; scan and transforms of each step are stamped as told."""
    with BagBuilder(path) as bag:
        if static_mount:
            bag.link(0.0, "base_link", "laser", LASER_AT, topic="/tf_static")
        for step in range(steps):
            seconds = stamp_s(step)
            delay = step * 0.1 - seconds
            bag.link(seconds, "odom", "base_link", latency_s=delay)
            if not static_mount:
                bag.link(seconds, "base_link", "laser", LASER_AT, latency_s=delay)
            bag.scan(seconds, latency_s=delay + 0.02, walked_s=step * 0.06)
    return path


@pytest.mark.parametrize("wrong_by", [3.15e7, -3.15e7, 4.0])
def test_a_scan_whose_stamp_is_wrong_is_counted_and_the_tracks_survive(tmp_path: Path, wrong_by: float) -> None:
    _, expected = run(stamped(tmp_path / "a.bag", 50, lambda step: step * 0.1))
    session, shown = run(stamped(tmp_path / "b.bag", 50, lambda step: step * 0.1 + wrong_by * (step == 30)))
    counters = session.counters()
    assert counters.get("time jumps", 0) == 0 and session.processed >= 48
    assert shown[-1].ids.tolist() == expected[-1].ids.tolist()
    assert sum(count for name, count in counters.items() if "stamp" in name) > 0
    assert session.recorded_s == pytest.approx(4.9)


@pytest.mark.parametrize("jump_s", [-3.0, 3.15e7])
@pytest.mark.parametrize("static_mount", [False, True])
def test_a_clock_that_is_set_begins_anew(tmp_path: Path, jump_s: float, static_mount: bool) -> None:
    path = stamped(tmp_path / "a.bag", 80, lambda step: step * 0.1 + jump_s * (step >= 40), static_mount)
    session, shown = run(path)
    assert session.counters()["time jumps"] == 1
    assert session.processed >= 75
    before = {track for tracks in shown[:39] for track in tracks.ids.tolist()}
    after = {track for tracks in shown[42:] for track in tracks.ids.tolist()}
    assert before and after and not before & after
    assert session.recorded_s == pytest.approx(7.7, abs=0.11)
