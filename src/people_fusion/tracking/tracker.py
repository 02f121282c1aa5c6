"""The contract of all trackers."""

from __future__ import annotations

import abc
from typing import Any, Dict, Optional

from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.head_scores import NO_SCORES
from people_fusion.core.measurements import Measurement
from people_fusion.core.registry import Registry
from people_fusion.core.tracks import Legs, Particles, Tracks


class Tracker(abc.ABC):
    """Turns measurements into tracks.

    A buffer policy calls `process` in order of stamps, from one thread. A tracker reads no clock and waits for nothing.

    Attributes:
        scores: what it wants head cues to give beside detections: NO_SCORES, SCORES or FEATURES of core.head_scores.
    """

    scores: str = NO_SCORES

    @property
    @abc.abstractmethod
    def stamp_ns(self) -> Optional[int]:
        """Stamp of the newest processed measurement; None before the first."""

    @abc.abstractmethod
    def process(self, measurement: Measurement) -> None:
        """Predict to the measurement's stamp and update.

        Args:
            measurement: in the tracking frame. If it is older than `stamp_ns`, it is predicted forward (Volkhardt
                III-C 3), never the tracks backward.
        """

    @abc.abstractmethod
    def tracks(self, stamp_ns: Optional[int] = None) -> Tracks:
        """All tracks, confirmed or not, at the tracker's own stamp or predicted to a later one; the state stays."""

    @abc.abstractmethod
    def snapshot(self) -> Any:
        """The whole state, cheap to keep and never altered afterwards."""

    @abc.abstractmethod
    def restore(self, snapshot: Any) -> None:
        """Go back to a state that `snapshot` gave. Identities that were given away since are not given again."""

    @abc.abstractmethod
    def reset(self) -> None:
        """Forget everything but which identities are used up."""

    def set_map(self, grid: Optional[OccupancyGrid]) -> None:
        """A new map of the static surroundings in the tracking frame, or none."""

    def legs(self) -> Optional[Legs]:
        """The legs that it follows, at the tracker's own stamp; None of a tracker that follows none."""
        return None

    def particles(self) -> Optional[Particles]:
        """The particles of its tracks, at the tracker's own stamp; None of a tracker that has none."""
        return None

    def counters(self) -> Dict[str, int]:
        """Events since the start, by name, for diagnostics."""
        return {}


TRACKERS: Registry[Tracker] = Registry("tracker", "people_fusion.tracking.trackers")
