"""A track is a person once it was detected again, and ends when nothing shows it for a second (Poschmann 2018, 7.3)."""

from __future__ import annotations

import math
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
    way_m: float = parameter(
        math.inf, "way from where a track began or was doubted that makes it a person, metres; .inf: no", 0.0, math.inf
    )


@LIFECYCLES.register("second_look", SecondLookConfig)
class SecondLook(Lifecycle):
    """Remembers how often a track was detected by a cue that may confirm it, for how long it was looked for in vain,
    and from where its way is measured."""

    memory = (4,)

    def __init__(self, config: SecondLookConfig) -> None:
        self.config = config
        self._longest_ns = from_seconds(config.longest_unseen_s)

    def judge(self, table: TrackTable, evidence: Evidence) -> Verdict:
        """See Lifecycle."""
        confirming = evidence.matched if evidence.confirming is None else evidence.confirming
        looks, in_vain_s, begins = table.memory[:, 0] + confirming, table.memory[:, 1], evidence.new
        if evidence.testimony is not None and self.config.doubt_after_s > 0.0:
            in_vain_s = np.maximum(in_vain_s - evidence.measurement.period_s * evidence.testimony, 0.0)
            in_vain_s = np.where(confirming, 0.0, in_vain_s)
            doubted = in_vain_s >= self.config.doubt_after_s
            looks = np.where(doubted, 0.0, looks)
            in_vain_s, begins = np.where(doubted, 0.0, in_vain_s), begins | doubted
        places = table.means[:, :2]
        starts = np.where(begins[:, None], places, table.memory[:, 2:])
        looks = np.where(np.hypot(*(places - starts).T) > self.config.way_m, self.config.looks, looks)
        memory = np.column_stack([looks, in_vain_s, starts])
        alive = evidence.stamp_ns - table.seen_ns < self._longest_ns
        existence = np.minimum(looks / self.config.looks, 1.0)
        return Verdict(existence, memory, (looks >= self.config.looks) & alive, alive, table.still)
