"""Cues and tracker in one process with no messages between them, for robots that count milliseconds."""

from __future__ import annotations

from dataclasses import dataclass

from people_fusion.ros.leg_cue_node import LegCues, LegCueSettings
from people_fusion.ros.node import Node, run
from people_fusion.ros.people_tracker_node import PeopleTracker, PeopleTrackerSettings
from people_fusion.tracking.fusion import FusionConfig


@dataclass(frozen=True)
class ComposedSettings(PeopleTrackerSettings, LegCueSettings):
    """The parameters of both nodes."""


def _build(settings: ComposedSettings, config: FusionConfig) -> Node:
    node = Node(config, settings.scans)
    tracker = PeopleTracker(node, settings, config)
    cues = LegCues(node, settings, config, deliver=tracker.receive, ears=1)
    tracker.listen(own=cues.names)
    return node


def main() -> int:
    """Entry of scripts/people_fusion; returns the exit status."""
    return run("people_fusion", ComposedSettings, _build)
