#!/usr/bin/env python3
"""Time of the buffer alone: ten cues of 10 to 30 Hz announce, work for 5 to 150 ms and deliver; the driver sleeps.

Prints for every policy the microseconds that one measurement costs, all calls of `push`, `poll` and `sleep_ns` that it
causes included, with the ratio to `drop` in the same run; how many waited on average; and how often the driver woke.
Times are those of the process, so that a busy machine disturbs them little. Exits with 1 where a policy takes longer
than `--limit`.
"""

import argparse
import heapq
import json
import sys
import time
from pathlib import Path

import numpy as np

from people_fusion.core.config import parse
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.stamps import NANOSECONDS, from_seconds
from people_fusion.tracking.buffer import BUFFERS

START_NS = 1_700_000_000 * NANOSECONDS
RATES = np.linspace(10.0, 30.0, 10)
WORK_S = np.geomspace(0.005, 0.15, 10)[[0, 9, 1, 8, 2, 7, 3, 6, 4, 5]]  # slow ones at all rates
JITTER = 0.2  # of the time that work takes, standard deviation


def life(duration_s, seed):
    """(arrival, item) of all cues, in order of arrival."""
    rng, events, none = np.random.default_rng(seed), [], np.zeros((0, 3))
    for index, (rate, work_s) in enumerate(zip(RATES, WORK_S)):
        cue, free_ns = f"cue_{index}", 0
        for sequence in range(int(duration_s * rate)):
            stamp_ns = START_NS + from_seconds((sequence + rng.random() * 0.02 + index / 10) / rate)
            done_ns = max(stamp_ns, free_ns) + from_seconds(work_s * max(0.2, 1.0 + JITTER * rng.standard_normal()))
            announcement = Announcement(stamp_ns, cue, sequence)
            events.append((stamp_ns, len(events), announcement))
            if free_ns > stamp_ns:  # still at work on an older one
                events.append((stamp_ns, len(events), announcement._replace(withdrawn=True)))
                continue
            free_ns = done_ns
            measurement = Measurement(
                stamp_ns, cue, "legs", "odom", none, np.zeros((0, 3, 3)), np.zeros(0), sequence=sequence
            )
            events.append((done_ns, len(events), measurement))
    heapq.heapify(events)
    return [heapq.heappop(events)[::2] for _ in range(len(events))]


def drive(name, events):
    """Runs a policy as a node does. Returns seconds of the process, mean number held, wakes and measurements out."""
    buffer = BUFFERS.build(parse(BUFFERS.config_of(name, "buffer"), {}))
    held = wakes = out = 0
    now_ns = START_NS
    began = time.process_time()
    for arrival_ns, item in events:
        sleep_ns = buffer.sleep_ns(now_ns)
        while sleep_ns is not None and now_ns + sleep_ns <= arrival_ns:
            now_ns += sleep_ns
            wakes += 1
            out += len(buffer.poll(now_ns))
            sleep_ns = buffer.sleep_ns(now_ns)
        now_ns = arrival_ns
        out += len(buffer.push(item, now_ns))
        held += len(buffer.held)
    return time.process_time() - began, held / len(events), wakes, out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--duration", type=float, default=30.0, help="of the cues' lives, seconds")
    parser.add_argument("--repeats", type=int, default=5, help="the fastest counts")
    parser.add_argument("--limit", type=float, default=50.0, help="microseconds a measurement")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    events = life(options.duration, 0)
    measurements = sum(isinstance(item, Measurement) for _, item in events)
    print(f"{len(RATES)} cues, {measurements / options.duration:.0f} measurements a second")
    print("policy            us a measurement   of drop   waiting   wakes a second   out")
    rows, drop_us = {}, None
    for name in ("drop", *(name for name in BUFFERS.names() if name != "drop")):
        runs = [drive(name, events) for _ in range(options.repeats)]
        seconds, held, wakes, out = min(runs)
        cost_us = 1e6 * seconds / measurements
        drop_us = drop_us or cost_us
        rows[name] = {"us": cost_us, "ratio_to_drop": cost_us / drop_us, "waiting": held, "wakes": wakes, "out": out}
        print(
            f"{name:16} {cost_us:17.1f} {cost_us / drop_us:9.2f} {held:9.1f}"
            f" {wakes / options.duration:16.1f} {out / measurements:5.1%}"
        )
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2))
    return int(any(row["us"] > options.limit for row in rows.values()))


if __name__ == "__main__":
    sys.exit(main())
