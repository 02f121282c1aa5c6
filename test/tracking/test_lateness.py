"""The tracker alone, with every tenth measurement arriving after the next one, against the run without lateness."""

import pytest

from people_fusion.core.config import parse
from people_fusion.core.measurements import Announcement
from people_fusion.core.stamps import from_seconds
from people_fusion.evaluation.evaluate import Scores, evaluate
from people_fusion.evaluation.truth import Estimates, Truth
from people_fusion.simulation.detections import DetectionsConfig, detections
from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.fusion import load_config
from people_fusion.tracking.rewind import Rewind
from people_fusion.tracking.tracker import TRACKERS

SEEDS = range(2)
WORK_NS = from_seconds(0.005)
LATE_BY_NS = from_seconds(0.12)  # at ten a second: after the next one
DRAWN = DetectionsConfig(people=5, duration_s=60.0)


@pytest.fixture(scope="module")
def draws():
    return [detections(DRAWN, seed) for seed in SEEDS]


def arrivals(measurements, lateness_ns):
    """(arrival, item) of announcements and measurements; every tenth measurement is late."""
    events = []
    for index, entry in enumerate(measurements):
        work_ns = lateness_ns if index % 10 == 5 else WORK_NS
        events.append((entry.stamp_ns, Announcement(entry.stamp_ns, entry.cue, entry.sequence)))
        events.append((entry.stamp_ns + work_ns, entry))
    return sorted(events, key=lambda event: event[0])


class Listener:
    """What a user has at each stamp: the last that was published of it, or else the last before it, predicted."""

    def __init__(self, name, stamps_ns):
        self._buffer = BUFFERS.build(parse(BUFFERS.config_of(name, "buffer"), {}))
        self._past = Rewind(TRACKERS.build(load_config("default").tracker), self._buffer.config)
        self._stamps_ns, self._next = stamps_ns, 0
        self._heard = {}

    def listen(self, events):
        now_ns = events[0][0]
        for arrival_ns, item in events:
            self._wake(now_ns, arrival_ns)
            self._take(self._buffer.push(item, arrival_ns))
            now_ns = arrival_ns
        self._wake(now_ns, now_ns + from_seconds(1.0))
        self._predict(self._stamps_ns[-1] + 1)
        return [self._heard[stamp_ns] for stamp_ns in self._stamps_ns]

    def _wake(self, now_ns, until_ns):
        sleep_ns = self._buffer.sleep_ns(now_ns)
        while sleep_ns is not None and now_ns + sleep_ns <= until_ns:
            now_ns += sleep_ns
            self._take(self._buffer.poll(now_ns))
            sleep_ns = self._buffer.sleep_ns(now_ns)

    def _take(self, released):
        for entry in released:
            self._predict(entry.stamp_ns)
            if self._past.process(entry):
                tracks = self._past.tracker.tracks()
                self._heard[tracks.stamp_ns] = tracks

    def _predict(self, stamp_ns):
        """Something newer comes: from now on it is too late for what lies before it."""
        while self._next < len(self._stamps_ns) and self._stamps_ns[self._next] < stamp_ns:
            passed_ns = self._stamps_ns[self._next]
            self._heard.setdefault(passed_ns, self._past.tracker.tracks(passed_ns))
            self._next += 1


def scores(name, draws, lateness_ns):
    total = Scores()
    for measurements, truths in draws:
        truth = Truth.from_frames(*zip(*truths))
        heard = Listener(name, [entry.stamp_ns for entry in measurements]).listen(arrivals(measurements, lateness_ns))
        seen = []
        for tracks, entry in zip(heard, measurements):
            inside = entry.sight.visible(tracks.means[:, :2], 0.05, 0.0) > 0.5
            seen.append(tracks.select(inside & tracks.confirmed))
        total = total + evaluate(truth, Estimates.from_tracks(seen)).scores
    return total


@pytest.fixture(scope="module")
def in_time(draws):
    return scores("drop", draws, WORK_NS).to_dict()


@pytest.mark.parametrize("name", BUFFERS.names())
def test_lateness_costs_no_accuracy(name, draws, in_time):
    late = scores(name, draws, LATE_BY_NS).to_dict()
    print(
        f"\n{name:16} IDF1 {late['idf1']:.4f} ({late['idf1'] - in_time['idf1']:+.4f})"
        f"  MOTA {late['mota']:.4f} ({late['mota'] - in_time['mota']:+.4f})"
    )
    if name in ("announced", "fixed_lag", "revisable"):  # the others revise, or know but one cue to wait for
        assert late == in_time
    if name != "drop":
        assert abs(late["idf1"] - in_time["idf1"]) <= 0.01
        assert abs(late["mota"] - in_time["mota"]) <= 0.01
