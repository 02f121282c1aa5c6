"""A track is a person once it was detected again, and ends when nothing shows it for a second (Poschmann 2018, 7.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.core.stamps import from_seconds
from people_fusion.tracking.lifecycle import LIFECYCLES, Evidence, Lifecycle, Verdict
from people_fusion.tracking.table import TrackTable


@dataclass(frozen=True)
class SecondLookConfig:
    """Section 7.3."""

    looks: int = parameter(2, "detections that make a track a person, the first of them its beginning", low=1)
    longest_unseen_s: float = parameter(1.0, "time in which nothing shows a track that ends it, seconds", low=0.01)


@LIFECYCLES.register("second_look", SecondLookConfig)
class SecondLook(Lifecycle):
    """Remembers how often a track was detected by a cue that may confirm it."""

    memory = (1,)

    def __init__(self, config: SecondLookConfig) -> None:
        self.config = config
        self._longest_ns = from_seconds(config.longest_unseen_s)

    def judge(self, table: TrackTable, evidence: Evidence) -> Verdict:
        """See Lifecycle."""
        confirming = evidence.matched if evidence.confirming is None else evidence.confirming
        memory = table.memory + confirming[:, None]
        looks = memory[:, 0]
        alive = evidence.stamp_ns - table.seen_ns < self._longest_ns
        existence = np.minimum(looks / self.config.looks, 1.0)
        return Verdict(existence, memory, (looks >= self.config.looks) & alive, alive, table.still)
