"""Legs that other people labelled in their own recordings."""

from __future__ import annotations

import numpy as np
import pytest
from leg_scenes import scan_with
from rosbags.highlevel import AnyReader

from people_fusion.core.transforms import FramesConfig
from people_fusion.cues.legs.legs import LegCue, LegCueConfig


@pytest.mark.parametrize(
    ("parameters", "least_recall"),
    [({}, 0.99), ({"max_segment_width": 0.5, "min_segment_step": 0.1, "segment_gap_beams": 2.5}, 0.88)],
    ids=["paper", "limits"],
)
def test_labelled_legs_are_found(recordings, parameters, least_recall):
    scans, labels = [], []
    with AnyReader([recordings / "laser_legs_mir/front_extracted.bag"]) as reader:
        topics = [link for link in reader.connections if link.topic in ("/training_scan", "/leg_cluster_positions")]
        for connection, _, raw in reader.messages(topics):
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/training_scan":
                names = ("angle_min", "angle_increment", "range_min", "range_max")
                scans.append(scan_with(message.ranges, **{name: getattr(message, name) for name in names}))
            else:
                labels.append(np.array([[pose.position.x, pose.position.y] for pose in message.poses]).reshape(-1, 2))
    cue = LegCue(LegCueConfig(**parameters), name="scan", frames=FramesConfig())
    found = total = 0
    for scan, legs in zip(scans, labels):
        distances = np.linalg.norm(legs[:, None] - cue.measure(scan, None).legs, axis=2)
        found += int((distances.min(axis=1, initial=np.inf) < 0.15).sum())
        total += len(legs)
    assert total == 1285
    assert found >= least_recall * total
