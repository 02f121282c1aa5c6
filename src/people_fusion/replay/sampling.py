"""Tracks and annotated people at the same instants in the same frame, ready for evaluation."""

from __future__ import annotations

from typing import List, Optional, Sequence, Tuple

import numpy as np

from people_fusion.core.errors import TransformUnavailable
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import TransformSource
from people_fusion.evaluation.truth import Estimates, Truth
from people_fusion.replay.ground_truth import Instant
from people_fusion.tracking.fusion import Fusion


class Sampler:
    """Asks the tracker for the people at each annotated instant, once everything older has been processed.

    Instants before the first and after the last measurement are left out.

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
