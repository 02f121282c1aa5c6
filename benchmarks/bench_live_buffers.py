#!/usr/bin/env python3
"""Delay and rate of the live tracker under every buffer policy, while a recording plays in real time.

A master of its own is started; the leg cue works on the recorded scans, recorded announcements and detections of other
cues come when they came. This program listens to the tracks: their delay is the clock at their arrival less their
stamp. Run it in the built workspace: tools/run benchmarks/bench_live_buffers.py [BAG]
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Dict, List, Optional, Tuple

import numpy as np
import rospy
from bench_live_cpu import SETTLE_S, contents, listens, master, wait_until

from people_fusion.core.resources import directory
from people_fusion.evaluation.tables import Table, number, percent
from people_fusion.msg import TrackedPersons
from people_fusion.replay.compare_buffers import POLICIES, ZERO_DELAY
from people_fusion.replay.evaluate_tracks import read_truth, sample
from people_fusion.replay.replay import Selection, score
from people_fusion.ros.conversions import stamp_from_msg, tracks_from_msg
from people_fusion.simulation.bag import write_bag
from people_fusion.simulation.scenario import load_scenario
from people_fusion.simulation.simulator import simulate

NODES = ("leg_cue", "people_tracker")
FRAMES = {"world": "map", "odom": "odom", "base": "base_link"}
CLOCK_HZ = 200
TOPICS = {"tracks": "/people_fusion/tracks", "preview": "/people_fusion/tracks_preview"}


def main() -> int:
    """Measure, print, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bag", type=Path, nargs="?", help="recording (default: 40 s of the museum with emulated cues)")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--policies", nargs="+", default=[name for name in POLICIES if name != ZERO_DELAY])
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results: Dict[str, Dict[str, Any]] = {}
    with tempfile.TemporaryDirectory() as temporary, master(simulated_time=True):
        bag = options.bag or simulated(Path(temporary))
        scans, _, seconds = contents(bag)
        for name in options.policies:
            heard = measure(bag, list(scans), options.preset, POLICIES[name])
            for topic, messages in heard.items():
                if messages:
                    label = name if topic == "tracks" else f"{name}: preview"
                    results[label] = figures(messages, bag if topic == "tracks" else None, seconds)
                    print(f"{label}: {results[label]}", file=sys.stderr)
    print(table(results).as_text())
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n")
    return 0


def simulated(folder: Path) -> Path:
    """A recording to measure with."""
    bag = folder / "museum_cues.bag"
    write_bag(bag, simulate(dataclasses.replace(load_scenario("museum_cues"), duration_s=40.0), 1))
    return bag


def measure(bag: Path, scans: List[str], preset: str, policy: Dict[str, Any]) -> Dict[str, List[Tuple[float, Any]]]:
    """Delays in seconds, and messages, by topic."""
    heard: Dict[str, List[Tuple[float, Any]]] = {name: [] for name in TOPICS}

    def hear(message: Any, name: str) -> None:
        heard[name].append(((rospy.Time.now() - message.header.stamp).to_sec(), message))

    listeners = [
        rospy.Subscriber(topic, TrackedPersons, hear, name, queue_size=1000, tcp_nodelay=True)
        for name, topic in TOPICS.items()
    ]
    processes = []
    for node in NODES:
        subprocess.check_call(["rosparam", "load", str(directory("config") / f"{preset}.yaml"), f"/{node}"])
        rospy.set_param(f"/{node}/frames", FRAMES)
        (executable,) = subprocess.check_output(
            ["catkin_find", "--first-only", "--libexec", "people_fusion", node], text=True
        ).split()
        rospy.set_param(f"/{node}/buffer", policy)
        if node == "leg_cue":
            rospy.set_param(f"/{node}/scans", scans)
        processes.append(subprocess.Popen([executable]))
    try:
        wait_until(lambda: all(listens(f"/{node}", "/tf") for node in NODES), "the nodes to start")
        time.sleep(SETTLE_S)
        player = ["rosbag", "play", "--quiet", "--delay=1", "--clock", f"--hz={CLOCK_HZ}", str(bag)]
        subprocess.check_call(player, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    finally:
        for process in processes:
            process.send_signal(signal.SIGINT)
            process.wait()
        for listener in listeners:
            listener.unregister()
    return heard


def figures(messages: List[Tuple[float, Any]], bag: Optional[Path], seconds: float) -> Dict[str, Any]:
    """Of one policy's output; scored against the bag's ground truth, each output counting for its stamp."""
    delays = np.array([delay for delay, _ in messages])
    stamps = [stamp_from_msg(message.header.stamp) for _, message in messages]
    result: Dict[str, Any] = {
        "delay_mean_s": float(delays.mean()),
        "delay_p95_s": float(np.percentile(delays, 95)),
        "rate_hz": len(delays) / seconds,
        "in_order": stamps == sorted(stamps),
    }
    if bag is not None:
        tracks = [tracks_from_msg(message) for _, message in messages]
        instants, transforms = read_truth(bag, None, tracks[0].frame_id)
        result.update(score(sample(tracks, instants, transforms), Selection())[2].to_dict())
    return result


def table(results: Dict[str, Dict[str, Any]]) -> Table:
    """One row for each policy."""
    rows = tuple(
        (
            name,
            f"{1e3 * entry['delay_mean_s']:.0f} ms",
            f"{1e3 * entry['delay_p95_s']:.0f} ms",
            f"{entry['rate_hz']:.1f} Hz",
            percent(entry.get("mota")),
            percent(entry.get("idf1")),
            number(entry.get("nees")),
        )
        for name, entry in results.items()
    )
    return Table(("live", "delay", "95 %", "rate", "MOTA", "IDF1", "NEES"), rows)


if __name__ == "__main__":
    sys.exit(main())
