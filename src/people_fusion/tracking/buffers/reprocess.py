"""Late measurements are put in their place and all later ones are processed again (Poschmann 2018, 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

from people_fusion.core.config import parameter
from people_fusion.tracking.buffer import BUFFERS, BufferConfig, BufferPolicy


@dataclass(frozen=True)
class ReprocessConfig(BufferConfig):
    """Nothing waits."""

    late: str = parameter("reprocess", "back to the state before it, and all later ones again", choices=("reprocess",))


@BUFFERS.register("reprocess", ReprocessConfig)
class Reprocess(BufferPolicy):
    """Everything goes at once; tracks are revised when something late comes in."""
