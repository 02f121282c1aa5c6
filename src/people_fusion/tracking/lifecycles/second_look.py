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
    doubt_after_s: float = parameter(
        0.0,
        "time in which a cue that confirms people looks and sees none, after which it has to do so anew; 0: never",
        0.0,
    )


@LIFECYCLES.register("second_look", SecondLookConfig)
class SecondLook(Lifecycle):
    """Remembers how often a track was detected by a cue that may confirm it, and for how long in vain looked for."""

    memory = (2,)

    def __init__(self, config: SecondLookConfig) -> None:
        self.config = config
        self._longest_ns = from_seconds(config.longest_unseen_s)

    def judge(self, table: TrackTable, evidence: Evidence) -> Verdict:
        """See Lifecycle."""
        confirming = evidence.matched if evidence.confirming is None else evidence.confirming
        looks, in_vain_s = table.memory[:, 0] + confirming, table.memory[:, 1]
        if evidence.testimony is not None and self.config.doubt_after_s > 0.0:
            in_vain_s = in_vain_s + evidence.measurement.period_s * (evidence.testimony < 0)
            in_vain_s = np.where((evidence.testimony > 0) | confirming, 0.0, in_vain_s)
            looks = np.where(in_vain_s >= self.config.doubt_after_s, 0.0, looks)
        memory = np.column_stack([looks, in_vain_s])
        alive = evidence.stamp_ns - table.seen_ns < self._longest_ns
        existence = np.minimum(looks / self.config.looks, 1.0)
        return Verdict(existence, memory, (looks >= self.config.looks) & alive, alive, table.still)
