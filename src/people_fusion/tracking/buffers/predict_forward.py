"""Late measurements are predicted to the tracker's stamp (Volkhardt 2013, III-C 3)."""

from __future__ import annotations

from dataclasses import dataclass

from people_fusion.core.config import parameter
from people_fusion.tracking.buffer import BUFFERS, BufferConfig, BufferPolicy


@dataclass(frozen=True)
class PredictForwardConfig(BufferConfig):
    """Nothing waits."""

    late: str = parameter("predict_forward", "the tracker predicts what is late", choices=("predict_forward",))


@BUFFERS.register("predict_forward", PredictForwardConfig)
class PredictForward(BufferPolicy):
    """Everything goes at once; the tracker predicts what is late."""
