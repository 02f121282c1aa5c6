"""`announced` for output in order, and at once a guess that is made of all that waits.

A recorder takes the first, which is never revised; a controller takes the second, which has no delay.
"""

from __future__ import annotations

from dataclasses import dataclass

from people_fusion.tracking.buffer import BUFFERS
from people_fusion.tracking.buffers.announced import Announced, AnnouncedConfig


@dataclass(frozen=True)
class RevisableConfig(AnnouncedConfig):
    """As `announced`."""


@BUFFERS.register("revisable", RevisableConfig)
class Revisable(Announced):
    """`Fusion.preview` gives the guess."""

    revisable = True
