"""A learned model of what a leg looks like in a scan (Arras et al. 2012, 2), from a JSON file."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Dict, Mapping, Tuple, Union

import numpy as np

from people_fusion.core.errors import ConfigError
from people_fusion.core.resources import directory
from people_fusion.cues.legs.adaboost import Stumps
from people_fusion.cues.legs.features import MIN_POINTS, NAMES, features
from people_fusion.cues.legs.segments import Segments

FORMAT = 1
EVIDENCE_LIMIT = 4.0  # natural logarithm: one look at one segment never says more than 50 to 1


@dataclass(frozen=True, eq=False)
class LegModel:
    """Strong classifier, its calibration and what it expects.

    Attributes:
        stumps: on the features of `features.NAMES`.
        slope, offset: of the sigmoid that makes a probability of a score (Platt 1999).
        prior: share of legs among segments for which the probability is calibrated.
        jump, jump_beams: segmentation that it was trained on, see `segments.segment`.
        provenance: what it was made of, with the command.
    """

    stumps: Stumps
    slope: float
    offset: float
    prior: float
    jump: float
    jump_beams: float
    provenance: Mapping[str, Any]

    def scores(self, segments: Segments) -> np.ndarray:
        """(S,) in [-1, 1]; -1 for segments with fewer than `MIN_POINTS` points, which nobody can judge."""
        found = self.stumps.scores(features(segments))
        return np.where(segments.counts < MIN_POINTS, -1.0, found)

    def probabilities(self, segments: Segments) -> np.ndarray:
        """(S,) that a segment is a leg; where it has too few points to be judged, the prior."""
        judged = 1.0 / (1.0 + np.exp(-(self.slope * self.stumps.scores(features(segments)) + self.offset)))
        return np.where(segments.counts < MIN_POINTS, self.prior, judged)

    def evidence(self, segments: Segments) -> np.ndarray:
        """(S,) logarithm of how much likelier each segment looks so if it is a leg; 0 where nobody can judge."""
        log_odds = self.slope * self.stumps.scores(features(segments)) + self.offset
        evidence = np.clip(log_odds - math.log(self.prior / (1.0 - self.prior)), -EVIDENCE_LIMIT, EVIDENCE_LIMIT)
        return np.where(segments.counts < MIN_POINTS, 0.0, evidence)

    def save(self, path: Union[str, Path]) -> None:
        """Write as JSON; the same model gives the same bytes."""
        stumps = [
            {"feature": NAMES[feature], "below": parity > 0, "threshold": threshold, "weight": weight}
            for feature, parity, threshold, weight in zip(
                self.stumps.features.tolist(),
                self.stumps.parities.tolist(),
                self.stumps.thresholds.tolist(),
                self.stumps.weights.tolist(),
            )
        ]
        content = {
            "format": FORMAT,
            "provenance": dict(self.provenance),
            "segmentation": {"jump": self.jump, "jump_beams": self.jump_beams},
            "calibration": {"slope": self.slope, "offset": self.offset, "prior": self.prior},
            "stumps": stumps,
        }
        Path(path).write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def load_leg_model(name: Union[str, Path]) -> LegModel:
    """Read what `LegModel.save` wrote.

    Args:
        name: of a model in config/models, e.g. "legs", or of a JSON file.

    Raises:
        ConfigError: the file is missing or is not such a model; the message names it.
    """
    path = Path(name)
    if path.suffix == "" and len(path.parts) == 1:
        path = directory("config") / "models" / f"{name}.json"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    except ValueError as error:
        raise ConfigError(f"{path}: not JSON: {error}") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ConfigError(f"{path}: not a leg model of format {FORMAT}")
    try:
        slope, offset, prior = _numbers(content["calibration"], ("slope", "offset", "prior"))
        jump, jump_beams = _numbers(content["segmentation"], ("jump", "jump_beams"))
        stumps, provenance = _stumps(content["stumps"]), dict(content["provenance"])
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{path}: damaged leg model: {error!r}") from error
    return LegModel(stumps, slope, offset, prior, jump, jump_beams, provenance)


def _stumps(entries: Any) -> Stumps:
    if not entries:
        raise ValueError("no stumps")
    numbers = np.array([_numbers(entry, ("threshold", "weight")) for entry in entries])
    return Stumps(
        features=np.array([NAMES.index(entry["feature"]) for entry in entries]),
        thresholds=numbers[:, 0],
        parities=np.array([1.0 if entry["below"] else -1.0 for entry in entries]),
        weights=numbers[:, 1],
    )


def _numbers(entry: Dict[str, Any], names: Tuple[str, ...]) -> Tuple[float, ...]:
    values = tuple(float(entry[name]) for name in names)
    if not np.isfinite(values).all():
        raise ValueError(f"{names}: not finite")
    return values
