"""The contract of all cues: sensor data in, Measurement out."""

from __future__ import annotations

import abc
from typing import Any, NamedTuple, Optional, Tuple

import numpy as np

from people_fusion.core.grids import OccupancyGrid
from people_fusion.core.measurements import Announcement, Measurement
from people_fusion.core.registry import Registry
from people_fusion.core.tracks import Tracks
from people_fusion.core.transforms import TransformSource


class TransformRequest(NamedTuple):
    """Arguments of TransformSource.lookup."""

    target_frame: str
    source_frame: str
    stamp_ns: int


class Cue(abc.ABC):
    """Turns one sensor's messages into measurements.

    A cue is called from one thread, message by message, never blocks and reads no clock. Whoever feeds it (a node, a
    replay) has waited until the transforms that `measure` asks for are there.

    Attributes:
        takes: core type of the sensor's messages, e.g. Scan.
        modality: of its measurements.
        notes: core types of other sensors' messages that it wants to be told of.
        name: unique name of this instance, becomes Measurement.cue.

    Args (of every cue's constructor):
        config: its frozen config dataclass.
        name: unique name of this instance, becomes Measurement.cue.
        frames: names of the robot's frames.
    """

    takes: type
    modality: str
    name: str
    notes: Tuple[type, ...] = ()
    _announced = 0

    def wants(self, stamp_ns: int) -> bool:  # noqa: ARG002
        """Whether the message of this stamp is to be announced and measured at all; to be asked once."""
        return True

    def announce(self, stamp_ns: int) -> Announcement:
        """The announcement of a sensor message that has just arrived, to be told before any work is done on it.

        Whoever feeds the cue gives its sequence to the measurement, or withdraws it if none is made.
        """
        self._announced += 1
        return Announcement(stamp_ns, self.name, self._announced)

    def transforms_needed(self, data: Any) -> Tuple[TransformRequest, ...]:  # noqa: ARG002
        """What `measure` will look up for this message, so that whoever feeds the cue can wait for it.

        Raises:
            DataError: the message is unusable.
        """
        return ()

    @abc.abstractmethod
    def measure(self, data: Any, transforms: Optional[TransformSource]) -> Measurement:
        """Measurement of one sensor message, in the sensor's frame at the message's stamp.

        Args:
            data: core type of the sensor, e.g. Scan.
            transforms: for background subtraction and de-skewing; None where the recording has none.

        Raises:
            DataError: the message is unusable; the caller counts it and goes on. The cue's state is unharmed.
            TransformUnavailable: a transform that is needed for this message is not there.
            NotLooked: nobody could be seen in this message; it says nothing of who is there.
        """

    def note(self, data: Any) -> None:
        """A message of another sensor, of a type in `notes`, that may help with those to come.

        Raises:
            DataError: the message is unusable.
        """

    def set_map(self, grid: Optional[OccupancyGrid]) -> None:
        """A new map of the static surroundings, or none."""

    def set_localisation(self, covariance: np.ndarray) -> None:
        """How uncertain the robot's pose in the map is from now on: (6, 6), see core.poses. Zero as long as untold."""

    def set_tracks(self, tracks: Tracks) -> None:
        """Whom the tracker believes in; a cue may look there first."""

    def set_scores(self, wanted: str) -> None:
        """What measurements are to carry beside detections: NO_SCORES, SCORES or FEATURES of core.head_scores."""

    def reset(self) -> None:
        """Forget all that was measured: time has jumped."""


CUES: Registry[Cue] = Registry("cue", "people_fusion.cues")
