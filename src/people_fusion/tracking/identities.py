"""Identities of tracks, which stay the same however often what they begin with is processed again."""

from __future__ import annotations

import itertools
from collections import OrderedDict
from typing import Tuple

import numpy as np

from people_fusion.core.measurements import Measurement

REMEMBERED = 4096


class Identities:
    """Gives each detection that begins a track a number of its own, never one that another has had."""

    def __init__(self) -> None:
        self._given: OrderedDict[Tuple[int, str, int, int, int], int] = OrderedDict()
        self._next = 1

    def of(self, measurement: Measurement, row: int, used: np.ndarray) -> int:
        """Identity of the track that a detection begins.

        Args:
            measurement: that holds the detection.
            row: of the detection.
            used: (T,) of the tracks that there are.
        """
        for again in itertools.count():  # a cue that numbers nothing may stamp two messages alike
            key = (*measurement.order, row, again)
            if key not in self._given:
                self._given[key] = self._next
                self._next += 1
                if len(self._given) > REMEMBERED:
                    self._given.popitem(last=False)
            if self._given[key] not in used:
                break
        return self._given[key]

    def reset(self) -> None:
        """Time has jumped: what comes is new, whatever its stamp."""
        self._given.clear()
