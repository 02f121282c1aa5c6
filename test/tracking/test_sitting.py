"""Whoever sits has his shins a foot before his head: legs and heads are of one person all the same."""

import dataclasses

import numpy as np
import pytest

from people_fusion.core.config import parse
from people_fusion.core.measurements import XY_OBSERVED, XYZ_OBSERVED, Bodies, Measurement
from people_fusion.tracking.tracker import TRACKERS

SECOND = 1_000_000_000
SITTING_STDS = {"legs": 0.25}


def build(**options):
    config = {"sitting_stds": SITTING_STDS, "gate": 13.8, "lifecycle": {"type": "bayes"}, **options}
    return TRACKERS.build(parse(TRACKERS.config_of("kalman", "tracker"), config))


def look(step, modality, place, height=None, bodies=None):
    """One detection, or none where the place is None."""
    count = 0 if place is None else 1
    position = np.zeros((count, 3)) if place is None else np.array([[*place, height or 0.0]])
    return Measurement(
        stamp_ns=step * SECOND // 10,
        cue=modality,
        modality=modality,
        frame_id="map",
        positions=position,
        covariances=np.repeat(np.diag([0.03**2, 0.03**2, 0.03**2])[None], count, axis=0),
        confidences=np.full(count, 0.95),
        observed=XY_OBSERVED if height is None else XYZ_OBSERVED,
        period_s=0.1,
        sequence=step,
        bodies=bodies,
    )


def shape(height):
    return Bodies(np.array([height]), np.array([0.03]), np.array([float(height < 1.4)]))


def watched(tracker, head_height, shins, seconds=20.0):
    """Tracks after a head at (2, 0) and shins were seen in turn."""
    for step in range(int(10 * seconds)):
        if step % 2:
            tracker.process(look(step, "legs", shins))
        else:
            tracker.process(look(step, "rgbd", (2.0, 0.0), head_height, shape(head_height + 0.12)))
    return tracker.tracks()


@pytest.mark.parametrize("away", [0.3, 0.45])
def test_shins_of_who_sits_are_his_and_hardly_move_his_head(away):
    tracks = watched(build(), 1.15, (2.0 - away, 0.0))
    assert len(tracks) == 1 and tracks.confirmed.all()
    assert np.hypot(tracks.means[0, 0] - 2.0, tracks.means[0, 1]) < 0.03


def test_legs_so_far_from_a_head_that_stands_are_another_persons():
    assert len(watched(build(), 1.65, (1.55, 0.0))) == 2


def test_shins_that_no_scanner_sees_do_not_speak_against_who_sits():
    without = watched(build(sitting_stds={}), 1.15, None)
    tracks = watched(build(), 1.15, None)
    assert tracks.confirmed.all() and len(tracks) == 1
    assert tracks.existence[0] > (without.existence[0] if len(without) else 0.0)


def test_whose_head_nobody_saw_is_not_taken_to_sit():
    tracker = build()
    for step in range(20):
        tracker.process(look(step, "legs", (2.0, 0.0)))
    tracker.process(look(20, "legs", (1.6, 0.0)))
    assert len(tracker.tracks()) == 2


def test_a_persons_shape_is_no_furniture_however_long_it_sits():
    patient = watched(build(), 1.15, (1.65, 0.0), seconds=60.0)
    assert patient.confirmed.all()
    tracker = build()
    for step in range(600):  # the same without shapes
        tracker.process(look(step, "rgbd", (2.0, 0.0), 1.15))
    assert not tracker.tracks().confirmed.any()


def test_doubtful_shapes_stay_furniture():
    tracker = build()
    for step in range(600):
        doubtful = look(step, "rgbd", (2.0, 0.0), 1.15, shape(1.27))
        tracker.process(dataclasses.replace(doubtful, confidences=np.array([0.45])))
    assert not tracker.tracks().confirmed.any()
