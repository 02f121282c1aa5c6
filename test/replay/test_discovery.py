"""What is taken of a recording that nobody has described."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bags import LASER_AT, BagBuilder, walk

from people_fusion.core.errors import RecordingError
from people_fusion.core.transforms import FramesConfig
from people_fusion.replay.discovery import Sources, discover
from people_fusion.replay.recording import Recording


def sources_of(path: Path, *arguments: Any, **options: Any) -> Sources:
    with Recording(path) as recording:
        return discover(recording, FramesConfig(), *arguments, **options)


@pytest.mark.parametrize("tf_kind", ["tf2_msgs/TFMessage", "tf/tfMessage"])
@pytest.mark.parametrize("slash", ["", "/"])
def test_odometry_is_the_world_where_there_is_no_map(tmp_path: Path, tf_kind: str, slash: str) -> None:
    found = sources_of(walk(tmp_path / "a.bag", 1.0, tf_kind, slash))
    assert found.frames == FramesConfig(world="odom", odom="odom", base="base_link")
    assert found.links == {("odom", "base_link"), ("base_link", "laser")}
    assert [topic.name for topic in found.scans] == ["/scan"]


def test_the_sensor_is_the_world_where_there_is_no_tf(tmp_path: Path) -> None:
    found = sources_of(walk(tmp_path / "a.bag", 1.0, tf_kind=None))
    assert found.frames == FramesConfig(world="laser", odom="", base="laser")
    assert found.transforms == () and found.links == frozenset()


def test_the_map_is_the_world_and_a_base_of_another_name_is_found(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for link in (("map", "odom"), ("odom", "chassis"), ("chassis", "plate"), ("plate", "laser")):
            bag.link(0.0, *link)
        bag.scan(0.1)
    assert sources_of(tmp_path / "a.bag").frames == FramesConfig(world="map", odom="odom", base="chassis")


def test_the_configured_base_is_taken_where_it_is_on_the_way(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for link in (("odom", "base_footprint"), ("base_footprint", "base_link"), ("base_link", "laser")):
            bag.link(0.0, *link)
        bag.scan(0.1)
    assert sources_of(tmp_path / "a.bag").frames.base == "base_link"


def test_of_two_topics_of_one_scanner_the_raw_one_is_taken_and_it_is_said(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for seconds in np.arange(0.0, 1.0, 0.1):
            bag.scan(seconds)
            bag.scan(seconds, topic="/a_filtered_scan", latency_s=0.3)
            bag.scan(seconds, topic="/b_filtered_scan", latency_s=0.35)
    found = sources_of(tmp_path / "a.bag")
    assert [topic.name for topic in found.scans] == ["/scan"]
    assert "scan /a_filtered_scan is left out: it is of the scanner of /scan" in found.notes


@pytest.mark.parametrize("stamped", [True, False])
def test_of_two_topics_of_one_scanner_the_annotated_one_is_taken_and_it_is_said(tmp_path: Path, stamped: bool) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        for step in range(30):
            seconds = 0.1 * step
            bag.scan(seconds, topic="/all_scans")
            if step % 3:
                bag.scan(seconds, topic="/training_scan")
                header = bag.header(seconds if stamped else None, "laser")
                bag.add("/legs", "geometry_msgs/PoseArray", seconds + 0.02, header, [bag.pose(1.0, 0.0)])
    found = sources_of(tmp_path / "a.bag")
    assert [topic.name for topic in found.scans] == ["/training_scan"]
    (note,) = [note for note in found.notes if "left out" in note]
    assert note.startswith("scan /all_scans is left out")
    assert note.endswith("it is of the scanner of /training_scan, to which the annotations belong")


def test_two_scanners_on_one_robot_are_both_taken(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        bag.link(0.0, "odom", "base_link")
        bag.link(0.0, "base_link", "laser", LASER_AT)
        bag.link(0.0, "base_link", "rear_laser")
        bag.scan(0.1)
        bag.scan(0.12, topic="/rear", frame_id="rear_laser", beams=245, field_of_view_deg=190.0)
    found = sources_of(tmp_path / "a.bag")
    assert [topic.name for topic in found.scans] == ["/rear", "/scan"]
    assert any("245 beams in rear_laser" in note for note in found.notes)


def driving(path: Path, tf_has_odometry: bool, mounted: bool = True) -> Path:
    """A robot with Odometry messages, of which tf knows or does not know."""
    with BagBuilder(path) as bag:
        for step in range(60):
            seconds = 0.05 * step
            if mounted:
                bag.link(seconds, "base_link", "laser", LASER_AT)
            if tf_has_odometry:
                bag.link(seconds, "odom", "base_link", (0.5 * seconds, 0.0, 0.0))
            bag.odometry(seconds)
            if step % 2 == 0:
                bag.scan(seconds)
    return path


def test_odometry_stands_in_for_the_transform_that_tf_lacks(tmp_path: Path) -> None:
    found = sources_of(driving(tmp_path / "a.bag", tf_has_odometry=False))
    assert found.frames == FramesConfig(world="odom", odom="odom", base="base_link")
    assert found.odometry is not None and found.odometry.name == "/odom"
    assert "odometry /odom stands in for odom to base_link, which tf lacks" in found.notes
    assert sources_of(tmp_path / "a.bag", odometry="").frames.world == "base_link"


def test_odometry_is_left_out_where_tf_has_it_or_no_scanner_is_on_its_base(tmp_path: Path) -> None:
    assert sources_of(driving(tmp_path / "a.bag", tf_has_odometry=True)).odometry is None
    found = sources_of(driving(tmp_path / "b.bag", tf_has_odometry=False, mounted=False), odometry="/odom")
    assert found.odometry is None and found.frames.world == "laser"
    assert any(note.startswith("odometry /odom is left out") for note in found.notes)
    with pytest.raises(RecordingError, match="/scan is not Odometry"):
        sources_of(tmp_path / "b.bag", odometry="/scan")


def test_a_scanner_that_nothing_connects_is_left_out_or_refused_by_name(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        bag.scan(0.1)
        bag.scan(0.2)
        bag.scan(0.1, topic="/rear", frame_id="rear_laser")
    found = sources_of(tmp_path / "a.bag")
    assert [topic.name for topic in found.scans] == ["/scan"]
    assert "scan /rear is left out: no transform connects rear_laser" in found.notes
    with pytest.raises(RecordingError, match="no transform connects rear_laser of /rear"):
        sources_of(tmp_path / "a.bag", ["/scan", "/rear"])


def test_a_world_frame_that_never_appears_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no frame mars above the scanners; there are base_link, laser, odom"):
        sources_of(walk(tmp_path / "a.bag", 1.0), world_frame="mars")


def test_a_world_frame_can_be_chosen(tmp_path: Path) -> None:
    found = sources_of(walk(tmp_path / "a.bag", 1.0), world_frame="/base_link")
    assert found.frames == FramesConfig(world="base_link", odom="", base="base_link")


def test_a_recording_without_scans_is_refused_with_its_topics(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        bag.link(0.0, "odom", "base_link")
        bag.link(0.1, "odom", "base_link")
    with pytest.raises(RecordingError, match=r"no laser scans in this recording; there are /tf"):
        sources_of(tmp_path / "a.bag")


def test_a_topic_that_is_no_scan_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="/tf is not a LaserScan"):
        sources_of(walk(tmp_path / "a.bag", 1.0), ["/tf"])


@pytest.mark.parametrize("offset_s", [-0.6, 300.0, -4000.0])
def test_clocks_that_differ_are_told_from_latency(tmp_path: Path, offset_s: float) -> None:
    found = sources_of(walk(tmp_path / "a.bag", 1.0, clock_offset_s=offset_s))
    assert found.clock_offset_ns == pytest.approx((offset_s + 0.02) * 1e9, abs=1e3)
    assert any("the bag's clock is" in note for note in found.notes)


def test_latency_is_no_difference_of_clocks(tmp_path: Path) -> None:
    assert sources_of(walk(tmp_path / "a.bag", 1.0, latency_s=0.4)).clock_offset_ns == 0


def test_ground_truth_is_found_by_name_and_own_output_is_not_taken_for_it(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "a.bag") as bag:
        bag.scan(0.1)
        bag.add("/people_fusion/tracks", "people_fusion/TrackedPersons", 0.2, bag.header(0.1, "laser"), [])
        bag.person_array(0.1, topic="/annotated_people")
    found = sources_of(tmp_path / "a.bag")
    assert found.ground_truth is not None and found.ground_truth.name == "/annotated_people"
    with BagBuilder(tmp_path / "b.bag") as bag:
        bag.scan(0.1)
        bag.add("/people_fusion/tracks", "people_fusion/TrackedPersons", 0.2, bag.header(0.1, "laser"), [])
    assert sources_of(tmp_path / "b.bag").ground_truth is None


def grid_in(bag: BagBuilder, frame_id: str, topic: str) -> None:
    info = bag.make("nav_msgs/MapMetaData", bag.time(0.0), 0.05, 2, 2, bag.pose(0.0, 0.0))
    bag.add(topic, "nav_msgs/OccupancyGrid", 0.0, bag.header(0.0, frame_id), info, np.zeros(4, np.int8))


def test_a_map_is_taken_only_where_its_frame_is_connected_and_costmaps_are_not(tmp_path: Path) -> None:
    for name, frame_id, topic in (("a", "map", "/map"), ("b", "odom", "/map"), ("c", "odom", "/local_costmap")):
        with BagBuilder(tmp_path / f"{name}.bag") as bag:
            grid_in(bag, frame_id, topic)
            bag.odometry_links(0.0)
            bag.scan(0.1)
    assert sources_of(tmp_path / "a.bag").map is None
    found = sources_of(tmp_path / "b.bag").map
    assert found is not None and found.name == "/map"
    assert sources_of(tmp_path / "c.bag").map is None
