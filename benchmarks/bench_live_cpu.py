#!/usr/bin/env python3
"""Processor time a scan of the live graph, composed and as separate nodes, while a recording plays in real time.

A master of its own is started, the clock is the wall's as on a robot, and this program listens to the tracks. Counted
is all that the nodes' processes spend while the recording plays: reception of scans and tf, cue, tracker, publication
and the diagnostics. Start-up is not in it. Run it in the built workspace: tools/run benchmarks/bench_live_cpu.py [BAG]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path
from typing import Callable, Dict, Iterator, List, Tuple

import rosbag
import rosgraph
import rospy

from people_fusion.core.resources import directory
from people_fusion.msg import TrackedPersons
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import simulate

PEERS_MS = {245: 2.4, 541: 6.3, 768: 6.9}  # C++ leg detector and tracker by number of beams, measured on such a machine
GRAPHS: Dict[str, Tuple[str, ...]] = {"composed": ("people_fusion",), "separate": ("leg_cue", "people_tracker")}
PATIENCE_S = 30.0
SETTLE_S = 1.0


def main() -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bag", type=Path, nargs="?", help="recording (default: 40 s of the simulated hallway)")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--frames", nargs=3, metavar=("WORLD", "ODOM", "BASE"), default=("map", "odom", "base_link"))
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        bag = options.bag or simulated(Path(temporary))
        scans, beams, seconds = contents(bag)
        count = sum(scans.values())
        print(f"{bag.name}: {count} scans of {beams} beams in {seconds:.0f} s on {', '.join(scans)}")
        results = {}
        with master():
            for name, nodes in GRAPHS.items():
                spent, heard = measure(nodes, bag, list(scans), options.preset, options.frames)
                results[name] = {"cpu_ms_per_scan": 1e3 * spent / count, "processor_share": spent / seconds}
                print(
                    f"{name:9s} {1e3 * spent / count:6.2f} ms a scan, {100 * spent / seconds:5.1f} % of a core, "
                    f"{heard} messages with tracks"
                )
    print("peers     " + ", ".join(f"{ms} ms ({size} beams)" for size, ms in PEERS_MS.items()))
    if options.json:
        options.json.write_text(json.dumps({"beams": beams, "scans": count, **results}, indent=2) + "\n")
    return 0


def simulated(folder: Path) -> Path:
    """A recording to measure with."""
    bag = folder / "hallway.bag"
    write_bag(bag, simulate(dataclasses.replace(load_scenario("hallway"), duration_s=40.0), 1))
    return bag


def contents(path: Path) -> Tuple[Dict[str, int], int, float]:
    """Scans by topic, their largest number of beams and the duration of a bag."""
    with rosbag.Bag(str(path)) as bag:
        topics = {
            name: info.message_count
            for name, info in bag.get_type_and_topic_info().topics.items()
            if info.msg_type == "sensor_msgs/LaserScan"
        }
        firsts = [next(bag.read_messages([name]))[1] for name in topics]
        return topics, max(len(scan.ranges) for scan in firsts), bag.get_end_time() - bag.get_start_time()


def measure(
    nodes: Tuple[str, ...], bag: Path, scans: List[str], preset: str, frames: Tuple[str, str, str]
) -> Tuple[float, int]:
    """Seconds of processor time that the nodes spend while the bag plays, and messages with tracks that came."""
    heard = []
    listener = rospy.Subscriber("/people_fusion/tracks", TrackedPersons, heard.append, queue_size=100)
    processes = []
    for node in nodes:
        subprocess.check_call(["rosparam", "load", str(directory("config") / f"{preset}.yaml"), f"/{node}"])
        rospy.set_param(f"/{node}/frames", dict(zip(("world", "odom", "base"), frames)))
        if node != "people_tracker":
            rospy.set_param(f"/{node}/scans", scans)
        # The executable itself, not rosrun's shell, so that its processor time can be read.
        (executable,) = subprocess.check_output(
            ["catkin_find", "--first-only", "--libexec", "people_fusion", node], text=True
        ).split()
        processes.append(subprocess.Popen([executable]))
    wait_until(lambda: all(listens(f"/{node}", "/tf") for node in nodes), "the nodes to start")
    time.sleep(SETTLE_S)
    try:
        before = sum(processor_seconds(process.pid) for process in processes)
        player = ["rosbag", "play", "--quiet", "--delay=1", str(bag)]
        subprocess.check_call(player, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        return sum(processor_seconds(process.pid) for process in processes) - before, len(heard)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
            process.wait()
        listener.unregister()


def processor_seconds(pid: int) -> float:
    """User and system time of a process with all its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def listens(node: str, topic: str) -> bool:
    """Whether a node has subscribed to a topic."""
    return node in dict(rosgraph.Master(rospy.get_name()).getSystemState()[1]).get(topic, [])


def wait_until(condition: Callable[[], bool], what: str) -> None:
    """Wait for what should take much less than the patience."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"waited {PATIENCE_S} s in vain for {what}")
        time.sleep(0.1)


@contextmanager
def master(simulated_time: bool = False) -> Iterator[None]:
    """A master on a free port, and this program as a node of it, on the clock of a player if so wanted."""
    with socket.socket() as free:
        free.bind(("", 0))
        port = free.getsockname()[1]
    os.environ["ROS_MASTER_URI"] = f"http://localhost:{port}"
    core = subprocess.Popen(["roscore", "-p", str(port)], stdout=subprocess.DEVNULL)
    try:
        wait_until(rosgraph.is_master_online, "the master")
        rosgraph.Master("/benchmark").setParam("/use_sim_time", simulated_time)
        rospy.init_node("benchmark", disable_signals=True)
        yield
    finally:
        rospy.signal_shutdown("done")
        core.send_signal(signal.SIGINT)
        core.wait()


if __name__ == "__main__":
    sys.exit(main())
