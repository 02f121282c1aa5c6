"""Confidence that grows with each detection, up to a cap per cue (Volkhardt 2013, III-C 1 eq. 3, 4 and 5)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Dict

import numpy as np

from people_fusion.core.config import parameter
from people_fusion.tracking.lifecycle import LIFECYCLES, Evidence, Lifecycle, Verdict
from people_fusion.tracking.table import TrackTable


@dataclass(frozen=True)
class CappedConfig:
    """The paper gives eq. 3 but no constants; these are ours."""

    gains: Dict[str, float] = parameter(
        {"legs": 0.1, "face": 0.5, "upper_body": 0.4, "head": 0.5, "body": 0.4, "motion": 0.2},
        "c_d by modality: confidence of a detection",
        low=0.0,
        high=1.0,
    )
    caps: Dict[str, float] = parameter(
        {"legs": 0.5, "face": 0.6, "upper_body": 0.6, "head": 0.6, "body": 0.6, "motion": 0.3},
        "most that one modality can add to a track's confidence",
        low=0.0,
        high=1.0,
    )
    decay_per_s: float = parameter(0.2, "confidence lost in a second", low=0.0)
    validate_above: float = parameter(0.6, "confidence from which a track is reported", low=0.0, high=1.0)
    prune_below: float = parameter(0.05, "a weaker track ends if its position is also uncertain", low=0.0, high=1.0)
    prune_position_std: float = parameter(0.5, "uncertain means more than this deviation, metres", low=0.0)


@LIFECYCLES.register("capped", CappedConfig)
class Capped(Lifecycle):
    """Memory of a track: what each modality has added to its confidence."""

    def __init__(self, config: CappedConfig) -> None:
        self.config = config
        self._modalities = sorted(config.caps)
        self.memory = (len(self._modalities),)

    def judge(self, table: TrackTable, evidence: Evidence) -> Verdict:
        """See Lifecycle."""
        config, modality = self.config, evidence.measurement.modality
        confidence = np.maximum(table.existence - config.decay_per_s * evidence.duration_s, 0.0)
        kept = np.divide(confidence, table.existence, out=np.zeros(len(table)), where=table.existence > 0)
        memory = table.memory * kept[:, None]
        if modality in self._modalities:
            column = self._modalities.index(modality)
            gain = (1.0 - confidence) * config.gains.get(modality, 0.0)  # eq. 3
            gain = np.clip(config.caps[modality] - memory[:, column], 0.0, gain)
            gain = np.where(evidence.matched, gain, 0.0)
            confidence = confidence + gain
            memory[:, column] += gain
        position_std = np.sqrt(table.covariances[:, 0, 0] + table.covariances[:, 1, 1])
        alive = (confidence > config.prune_below) | (position_std < config.prune_position_std)
        return Verdict(confidence, memory, (confidence >= config.validate_above) & alive, alive, table.still)
