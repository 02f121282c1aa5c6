"""The picture docs/images/buffer_timing.png: five cues over a second, under three buffer policies.

    python3 -m people_fusion.simulation.buffer_timing docs/images/buffer_timing.png

The cues are those of config/scenarios/museum_cues.yaml, without any jitter: rates and times of Poschmann 2018, 7.5.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Dict, List, NamedTuple, Tuple, Union

import numpy as np

from people_fusion.core.config import parse
from people_fusion.core.measurements import Announcement, Measurement, Order
from people_fusion.core.stamps import from_seconds, to_seconds
from people_fusion.evaluation.delay_plots import Life, plot_timing
from people_fusion.evaluation.plots import png
from people_fusion.simulation.detector import work
from people_fusion.tracking.buffer import BUFFERS, BufferPolicy

SHOWN = ("reprocess", "dynamic", "announced")
START_S, END_S = 5.0, 6.0  # of the picture; before it the policies learn the cues' periods
AFTERWARDS_S = 0.5


class Timing(NamedTuple):
    """One cue: messages a second, the first one's exposure, from exposure to arrival, and from that to delivery."""

    rate: float
    offset_s: float
    readout_s: float
    processing_s: float


CUES: Dict[str, Timing] = {
    "front laser": Timing(12.0, 0.0, 0.035, 0.007),
    "rear laser": Timing(5.0, 0.013, 0.035, 0.007),
    "faces": Timing(4.5, 0.0, 0.009, 0.101),
    "upper bodies": Timing(4.5, 1.0 / 9.0, 0.009, 0.101),
    "heads": Timing(9.0, 0.0, 0.009, 0.069),
}


def lives(policy: str) -> Dict[str, List[Life]]:
    """What becomes of each cue's messages under a policy, those that are exposed or released in the picture."""
    buffer: BufferPolicy = BUFFERS.build(parse(BUFFERS.config_of(policy, "buffer"), {}))
    events, messages = _events()
    released: Dict[Order, int] = {}
    now_ns = 0
    for event_ns, _, item in events:
        now_ns = _wake(buffer, released, now_ns, event_ns)
        _note(released, buffer.push(item, now_ns), now_ns)
    found: Dict[str, List[Life]] = {cue: [] for cue in CUES}
    for order, times_ns in messages.items():
        if order in released:
            life = Life(*(to_seconds(time_ns) for time_ns in (*times_ns, released[order])))
            if life.released_s > START_S and life.exposed_s < END_S:
                found[order[1]].append(life)
    return found


def main() -> int:
    """Write the picture to the path that is given."""
    Path(sys.argv[1]).write_bytes(png(plot_timing({policy: lives(policy) for policy in SHOWN}, START_S, END_S)))
    return 0


def _events() -> Tuple[List[Tuple[int, int, Union[Announcement, Measurement]]], Dict[Order, Tuple[int, int, int, int]]]:
    """What is told when, and when each message was exposed, announced, begun and delivered."""
    events: List[Tuple[int, int, Union[Announcement, Measurement]]] = []
    messages: Dict[Order, Tuple[int, int, int, int]] = {}
    for cue, timing in CUES.items():
        exposures = np.arange(timing.offset_s, END_S + AFTERWARDS_S, 1.0 / timing.rate)
        stamps_ns = [from_seconds(float(second)) for second in exposures]
        arrivals_ns = [stamp_ns + from_seconds(timing.readout_s) for stamp_ns in stamps_ns]
        jobs = work(arrivals_ns, [from_seconds(timing.processing_s)] * len(arrivals_ns))
        for sequence, (stamp_ns, arrival_ns, job) in enumerate(zip(stamps_ns, arrivals_ns, jobs)):
            announcement = Announcement(stamp_ns, cue, sequence)
            events.append((arrival_ns, len(events), announcement))
            if job.begin_ns is None:
                events.append((job.end_ns, len(events), announcement._replace(withdrawn=True)))
                continue
            messages[announcement.order] = (stamp_ns, arrival_ns, job.begin_ns, job.end_ns)
            events.append((job.end_ns, len(events), _empty(announcement)))
    return sorted(events, key=lambda event: event[:2]), messages


def _empty(announcement: Announcement) -> Measurement:
    return Measurement(
        announcement.stamp_ns,
        announcement.cue,
        "any",
        "map",
        np.zeros((0, 3)),
        np.zeros((0, 3, 3)),
        np.zeros(0),
        sequence=announcement.sequence,
    )


def _wake(buffer: BufferPolicy, released: Dict[Order, int], now_ns: int, until_ns: int) -> int:
    """Let time pass; returns the new time."""
    sleep_ns = buffer.sleep_ns(now_ns)
    while sleep_ns is not None and now_ns + sleep_ns <= until_ns:
        now_ns += sleep_ns
        _note(released, buffer.poll(now_ns), now_ns)
        sleep_ns = buffer.sleep_ns(now_ns)
    return max(now_ns, until_ns)


def _note(released: Dict[Order, int], measurements: List[Measurement], now_ns: int) -> None:
    for measurement in measurements:
        released[measurement.order] = now_ns


if __name__ == "__main__":
    sys.exit(main())
