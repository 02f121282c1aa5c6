"""Tracks and annotated people at the same instants in the same frame, ready for evaluation."""

from __future__ import annotations

from contextlib import suppress
from typing import List, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.errors import TransformUnavailable
from people_fusion.core.measurements import Sight
from people_fusion.core.stamps import from_seconds
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import TransformSource
from people_fusion.evaluation.truth import Estimates, Truth
from people_fusion.replay.ground_truth import Instant
from people_fusion.replay.session import Session, Update
from people_fusion.tracking.fusion import Fusion

HITS_EVERY_NS = from_seconds(0.5)


class Sampler:
    """Asks the tracker for the people at each annotated instant, once everything older has been processed.

    Instants before the first and after the last measurement are left out; where stamps go back, all that were passed.

    Attributes:
        skipped: instants within the measurements where a transform was missing.
    """

    def __init__(self, instants: Sequence[Instant]) -> None:
        self._instants = list(instants)
        self._next = 0
        self._started = False
        self._samples: List[Tuple[Instant, Tracks]] = []
        self.skipped = 0

    def until(self, stamp_ns: int, fusion: Fusion, transforms: TransformSource) -> None:
        """A measurement of this stamp comes next: sample the instants before it."""
        while self._next < len(self._instants) and self._instants[self._next].stamp_ns < stamp_ns:
            if self._started:
                self._sample(self._instants[self._next], fusion, transforms)
            self._next += 1
        self._started = True

    def result(self) -> Tuple[Truth, Estimates]:
        """The annotated people and the reported ones, frame by frame."""
        return together(self._samples)

    @property
    def samples(self) -> Sequence[Tuple[Instant, Tracks]]:
        """Instants in the world frame with all tracks."""
        return self._samples

    def _sample(self, instant: Instant, fusion: Fusion, transforms: TransformSource) -> None:
        world = fusion.config.frames.world
        tracks = fusion.tracks(instant.stamp_ns)
        try:
            there = instant.into(world, transforms)
        except TransformUnavailable:
            self.skipped += 1
            return
        if tracks.frame_id == world:
            self._samples.append((there, tracks))
        else:
            self.skipped += 1


class Sightings:
    """The reported people, and what the scanners hit now and then: what can be shown where nobody is annotated."""

    def __init__(self) -> None:
        self._tracks: List[Tracks] = []
        self._hits: List[np.ndarray] = [np.zeros((0, 2))]
        self._next_ns = 0

    def watch(self, session: Session, update: Update) -> None:
        """The tracker has processed a measurement."""
        tracks = session.fusion.tracks()
        if tracks.frame_id != session.fusion.config.frames.world:
            return
        if not self._tracks or tracks.stamp_ns > self._tracks[-1].stamp_ns:
            self._tracks.append(tracks.select(tracks.confirmed))
        measurement = update.measurement
        if measurement.sight is not None and measurement.stamp_ns >= self._next_ns:
            self._next_ns = measurement.stamp_ns + HITS_EVERY_NS
            with suppress(TransformUnavailable):
                pose = session.transforms.lookup(tracks.frame_id, measurement.frame_id, measurement.stamp_ns)
                self._hits.append(pose.apply(hits_of(measurement.sight))[:, :2])

    def result(self) -> Tuple[Truth, Estimates, np.ndarray]:
        """Frames without people, the reported people at these, and (N, 2) hits in the world frame, metres."""
        nobody = [np.zeros(0)] * len(self._tracks)
        frames = Truth.from_frames([tracks.stamp_ns for tracks in self._tracks], nobody, nobody)
        return frames, Estimates.from_tracks(self._tracks), np.concatenate(self._hits)


def hits_of(sight: Sight) -> np.ndarray:
    """(N, 3) where the scanner's view ended."""
    ended = np.flatnonzero(sight.ranges < sight.range_max)  # false for NaN
    angles = sight.yaw + sight.angle_min + sight.angle_increment * ended
    ways = sight.ranges[ended, None] * np.column_stack([np.cos(angles), np.sin(angles), np.zeros(len(ended))])
    return np.append(sight.position, 0.0) + ways


def together(samples: Sequence[Tuple[Instant, Tracks]]) -> Tuple[Truth, Estimates]:
    """Evaluation's arrays of instants with the tracks at the same stamps."""
    velocities: Optional[List[np.ndarray]] = [instant.velocities for instant, _ in samples]
    truth = Truth.from_frames(
        [instant.stamp_ns for instant, _ in samples],
        [instant.ids for instant, _ in samples],
        [instant.positions for instant, _ in samples],
        velocities,
    )
    return truth, Estimates.from_tracks([tracks for _, tracks in samples])
