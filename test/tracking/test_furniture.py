"""What stands still for so long that it is furniture, and what moves after all."""

import numpy as np

from people_fusion.core.config import parse
from people_fusion.tracking.tracker import TRACKERS


def test_who_stood_like_furniture_and_walks_on_has_a_velocity_again(detect):
    lifecycle = {"type": "bayes", "furniture_after_s": 3.0, "furniture_unmoved_after_s": 3.0}
    tracker = TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), {"lifecycle": lifecycle}))
    for step in range(60):
        tracker.process(detect(0.1 * step, (0.0, 0.0), sequence=step))
    resting = tracker.tracks()
    assert len(resting) == 1 and not resting.confirmed[0] and resting.covariances[0, 3, 3] == 0.0
    shown = []
    for step in range(60, 140):
        tracker.process(detect(0.1 * step, (0.012 * (step - 60), 0.0), sequence=step))
        shown += [tracker.tracks().covariances[row] for row in np.flatnonzero(tracker.tracks().confirmed)]
    assert shown and tracker.tracks().ids.tolist() == resting.ids.tolist()
    assert min(np.linalg.eigvalsh(covariance).min() for covariance in shown) > 1e-6
    assert abs(tracker.tracks().means[0, 3] - 0.12) < 0.1
