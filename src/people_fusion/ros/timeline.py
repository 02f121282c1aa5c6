"""The timeline of a live node."""

from __future__ import annotations

import time
from typing import Callable

from people_fusion.core import timeline


class Timeline(timeline.Timeline):
    """Stamps of a node's streams, which may jump while the wall's clock does not; see core.timeline."""

    def __init__(self, jumped: Callable[[float], None]) -> None:
        super().__init__(jumped, time.monotonic_ns)
