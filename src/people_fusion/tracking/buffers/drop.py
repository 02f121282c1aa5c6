"""Late measurements are dropped."""

from __future__ import annotations

from dataclasses import dataclass

from people_fusion.core.config import parameter
from people_fusion.tracking.buffer import BUFFERS, BufferConfig, BufferPolicy


@dataclass(frozen=True)
class DropConfig(BufferConfig):
    """Nothing waits."""

    late: str = parameter("drop", "what is older than the newest is counted and lost", choices=("drop",))


@BUFFERS.register("drop", DropConfig)
class Drop(BufferPolicy):
    """Everything goes at once, and only forward."""
