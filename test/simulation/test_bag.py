import dataclasses
import hashlib
import shutil
import subprocess
import sys

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import from_seconds, join
from people_fusion.replay.recording import Recording
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.command import main
from people_fusion.simulation.scenario import ScenarioConfig, load_scenario
from people_fusion.simulation.simulator import (
    START_NS,
    Annotation,
    FrameTransform,
    LocalisationFix,
    OdometryReading,
    Simulation,
    simulate,
)

TOPICS = {"/amcl_pose", "/ground_truth", "/map", "/odom", "/scan_front", "/scan_rear", "/tf", "/tf_static"}


def short(name, duration_s=3.0):
    return dataclasses.replace(load_scenario(name), duration_s=duration_s)


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("bag") / "follow.bag"
    write_bag(path, simulate(short("follow", 6.0), seed=5))
    return path


@pytest.fixture(scope="module")
def messages(bag):
    with Recording(bag) as recording:
        found = [(m.topic, m.arrival_ns, m.read()) for m in recording.messages(recording.topics)]
    return {topic: [(arrival, message) for t, arrival, message in found if t == topic] for topic in TOPICS}


def stamp_of(message):
    return join(message.header.stamp.sec, message.header.stamp.nanosec)


def pose_of(message):
    place = message.position if hasattr(message, "position") else message.translation
    turn = message.orientation if hasattr(message, "orientation") else message.rotation
    return Pose.from_quaternion(np.array([place.x, place.y, place.z]), np.array([turn.x, turn.y, turn.z, turn.w]))


def digest(path, seed):
    write_bag(path, simulate(short("museum"), seed))
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_same_seed_gives_same_bytes_and_another_seed_others(tmp_path):
    first, second, other = (digest(tmp_path / f"{n}.bag", seed) for n, seed in enumerate((1, 1, 2)))
    assert first == second
    assert first != other


def test_a_change_to_one_sensor_leaves_the_others_draws_alone():
    scenario = short("museum")
    front, rear = scenario.scanners
    blind = dataclasses.replace(scenario, scanners=(dataclasses.replace(front, noise_std=0.1), rear))
    ranges = [[e.ranges for t, _, e in simulate(s, 1) if t == "/scan_rear"] for s in (scenario, blind)]
    np.testing.assert_array_equal(ranges[0], ranges[1])


def test_bag_has_all_topics_at_their_rates(messages):
    counts = {topic: len(messages[topic]) for topic in TOPICS}
    assert counts == {**counts, "/scan_front": 72, "/scan_rear": 30, "/odom": 150, "/tf": 300, "/ground_truth": 60}
    assert counts["/map"] == counts["/tf_static"] == 1
    assert counts["/amcl_pose"] >= 2


@pytest.mark.skipif(shutil.which("rosbag") is None, reason="ROS's own rosbag is not installed")
def test_ros_reads_the_bag(bag):
    shown = subprocess.run(["rosbag", "info", str(bag)], capture_output=True, text=True, check=True).stdout
    assert "people_fusion/TrackedPersons" in shown
    assert all(topic in shown for topic in TOPICS)
    script = (
        "import sys, rosbag\n"
        "for topic, message, time in rosbag.Bag(sys.argv[1]).read_messages(): print(topic, message._md5sum)\n"
    )
    run = subprocess.run(["/usr/bin/python3", "-c", script, str(bag)], capture_output=True, text=True, check=True)
    sums = dict(line.split() for line in run.stdout.splitlines())
    assert sums["/scan_front"] == "90c7ef2dc6895d81024acba2ac42f369"
    assert sums["/tf"] == "94810edda583a504dfda3829e70d7eec"
    assert sums["/amcl_pose"] == "953b798c0f514ff060a53a3498ce6246"


def test_messages_arrive_in_order_and_after_their_measurement(messages):
    for topic, found in messages.items():
        arrivals = [arrival for arrival, _ in found]
        assert arrivals == sorted(arrivals), topic
    for topic in ("/scan_front", "/odom", "/amcl_pose", "/ground_truth"):
        assert all(arrival >= stamp_of(message) for arrival, message in messages[topic])
    waits = [arrival - stamp_of(message) for arrival, message in messages["/scan_front"]]
    assert np.mean(waits) == pytest.approx(from_seconds(540 * 5.55e-5 + 0.005), rel=0.05)


def test_configured_delay_shifts_the_arrival_of_its_topic_alone():
    room = {"walls": [{"points": [[-1, -1], [1, 1]]}]}
    mapping = {"room": room, "robot": {"start": [0.5, 0.0, 0.0]}, "duration_s": 20.0}
    delays = {"delays": {"/scan_rear": {"mean_s": 0.2, "std_s": 0.05}}}
    late, soon = (
        {topic: [arrival - item.stamp_ns for t, arrival, item in simulate(parse(ScenarioConfig, m), 1) if t == topic]
         for topic in ("/scan_rear", "/scan_front")}
        for m in ({**mapping, **delays}, mapping)
    )  # fmt: skip
    assert late["/scan_front"] == soon["/scan_front"]
    waits = np.array(late["/scan_rear"]) / 1e9 - 540 * 5.55e-5
    assert waits.mean() == pytest.approx(0.2, abs=0.02)
    assert 0.03 < waits.std() < 0.07


def test_map_odom_and_base_make_the_published_pose_at_each_fix(messages):
    chain = {}
    for _, message in messages["/tf"]:
        for link in message.transforms:
            key = (link.header.frame_id, link.child_frame_id, stamp_of(link))
            chain[key] = pose_of(link.transform)
    for _, fix in messages["/amcl_pose"]:
        stamp = stamp_of(fix)
        estimate = chain["map", "odom", stamp] @ chain["odom", "base_footprint", stamp]
        published = pose_of(fix.pose.pose)
        np.testing.assert_allclose(estimate.translation, published.translation, atol=1e-9)
        np.testing.assert_allclose(estimate.rotation, published.rotation, atol=1e-9)
        assert fix.header.frame_id == "map"
        assert np.count_nonzero(fix.pose.covariance) == 3


def test_map_from_odom_is_published_at_20_hz_at_least(messages):
    links = [link for _, message in messages["/tf"] for link in message.transforms]
    stamps = [stamp_of(link) for link in links if link.child_frame_id == "odom"]
    assert np.diff(stamps).max() <= from_seconds(0.05)


def test_scanners_hang_on_the_robot_by_their_names(messages):
    links = {link.child_frame_id: link for link in messages["/tf_static"][0][1].transforms}
    assert set(links) == {"base_link", "base_laser_link", "rear_laser_link"}
    place = links["base_laser_link"].transform.translation
    assert (place.x, place.y, place.z) == (0.109, 0.0, 0.385)
    assert links["base_laser_link"].header.frame_id == "base_link"
    assert links["base_link"].header.frame_id == "base_footprint"


def test_latched_topics_say_so(bag):
    from rosbags.rosbag1 import Reader

    with Reader(bag) as reader:
        latched = {connection.topic for connection in reader.connections if connection.ext.latching}
    assert latched == {"/map", "/tf_static"}


def test_scan_in_the_bag_is_the_simulated_scan(messages):
    scans = [item for topic, _, item in simulate(short("follow", 6.0), seed=5) if topic == "/scan_front"]
    for scan, (_, message) in zip(scans, messages["/scan_front"]):
        np.testing.assert_array_equal(message.ranges, scan.ranges.astype(np.float32))
        assert stamp_of(message) == scan.stamp_ns
        assert message.angle_min + 540 * message.angle_increment == pytest.approx(message.angle_max, abs=1e-6)


def test_ground_truth_is_the_history_within_reach(messages):
    simulation = Simulation(short("follow", 6.0), seed=5)
    for _, message in messages["/ground_truth"][::10]:
        time = np.array([(stamp_of(message) - START_NS) / 1e9])
        heads, robot = simulation.history.at("heads", time)[0], simulation.history.at("robot", time)[0]
        near = np.flatnonzero(np.linalg.norm(heads[:, :2] - robot[:2], axis=1) <= 6.0) + 1
        assert [person.track_id for person in message.tracks] == near.tolist()
        for person in message.tracks:
            place = person.pose.pose.position
            np.testing.assert_allclose([place.x, place.y, place.z], heads[person.track_id - 1], atol=1e-9)
        assert message.header.frame_id == "map"


def test_annotation_error_is_as_configured():
    scenario = short("museum", 60.0)
    simulation = Simulation(scenario, 1)
    errors = []
    for topic, _, item in simulation.events():
        if topic == "/ground_truth":
            time = np.array([(item.stamp_ns - START_NS) / 1e9])
            errors.append(item.positions[:, :2] - simulation.history.at("heads", time)[0, :, :2])
    assert np.std(errors) == pytest.approx(scenario.ground_truth.annotation_std, rel=0.1)
    assert len(errors) == 60


def test_events_are_core_objects():
    kinds = {topic: type(item) for topic, _, item in simulate(short("museum", 1.0), 1)}
    assert kinds == {
        "/map": OccupancyGrid,
        "/tf_static": tuple,
        "/tf": FrameTransform,
        "/odom": OdometryReading,
        "/amcl_pose": LocalisationFix,
        "/scan_front": Scan,
        "/scan_rear": Scan,
        "/ground_truth": Annotation,
    }


def test_command_writes_a_bag_and_replaces_an_old_one(tmp_path, capsys):
    out = tmp_path / "short.bag"
    out.write_text("old")
    assert main(["hallway", "--seed", "4", "--out", str(out), "--duration", "1"]) == 0
    assert capsys.readouterr().out.strip() == str(out)
    with Recording(out) as recording:
        assert recording.topic("/scan_front").count == 12
    assert list(tmp_path.iterdir()) == [out]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["mars"], "mars"),
        (["nowhere.yaml"], "nowhere.yaml: No such file"),
        (["hallway", "--seed", "-1"], "--seed"),
        (["hallway", "--duration", "nan"], "--duration"),
        (["hallway", "--duration", "1", "--out", "/proc/nowhere/x.bag"], "/proc/nowhere/x.bag"),
    ],
)
def test_command_names_what_is_wrong_in_one_line_and_fails(arguments, named, capsys):
    assert main(arguments) == 1
    shown = capsys.readouterr().err
    assert named in shown.splitlines()[-1]
    assert "Traceback" not in shown


def test_script_runs():
    from people_fusion.core.resources import directory

    script = directory("config").parent / "scripts" / "simulate"
    run = subprocess.run([sys.executable, str(script), "--help"], capture_output=True, text=True, check=False)
    assert run.returncode == 0
    assert "--seed" in run.stdout
