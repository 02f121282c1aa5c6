"""What every registered cue of a laser scan must do with any scan."""

from __future__ import annotations

import math

import numpy as np
import pytest
from leg_scenes import Motion, scan_of, scan_with

from people_fusion.core.errors import DataError
from people_fusion.core.scans import Scan
from people_fusion.core.transforms import FramesConfig
from people_fusion.cues.cue import CUES


def cues_of_scans():
    return [name for name in CUES.names() if CUES.class_of(name).takes is Scan]


@pytest.fixture(params=cues_of_scans())
def build(request):
    config = CUES.config_of(request.param, "type")
    return lambda: CUES.build(config(), name="scan", frames=FramesConfig())


def crowd(beams=541, **fields):
    rng = np.random.default_rng(7)
    legs = rng.uniform(-4.0, 4.0, (20, 2))
    return scan_of(legs[np.hypot(*legs.T) > 0.5], room=5.0, beams=beams, **fields)


SCANS = {
    "all NaN": scan_with([np.nan] * 50),
    "all zero": scan_with([0.0] * 50),
    "all inf": scan_with([np.inf] * 50),
    "all -inf": scan_with([-np.inf] * 50),
    "one beam": scan_with([1.0]),
    "one beam of no width": scan_with([1.0], angle_increment=0.0),
    "two beams": scan_with([1.0, 1.0]),
    "all at one place": scan_with([1e-9] * 100, range_min=0.0),
    "no upper limit": scan_with([1e300, 1e30, np.inf, 2.0, 2.0, 2.0], range_max=np.inf),
    "crowd": crowd(),
    "negative increment": crowd(angle_min=math.radians(135.0), increment=-math.radians(0.5)),
    "full circle": crowd(beams=720, angle_min=-math.pi),
    "several turns": crowd(beams=1500),
    "10,000 beams": scan_with(np.random.default_rng(8).uniform(0.5, 9.0, 10_000), angle_increment=0.0006),
    "10,000 beams on a wall": scan_with(np.full(10_000, 2.0), angle_min=-3.0, angle_increment=0.0006),
    "10,000 beams in a box": scan_with(np.full(10_000, 0.2), angle_min=-3.0, angle_increment=0.0006),
}


@pytest.mark.parametrize("scan", SCANS.values(), ids=SCANS.keys())
def test_measurement_is_whole(build, scan):
    cue = build()
    found = cue.measure(scan, Motion())
    count, legs = len(found), len(found.legs)
    assert (found.cue, found.frame_id, found.stamp_ns) == ("scan", scan.frame_id, scan.stamp_ns)
    assert found.modality == cue.modality
    assert found.positions.shape == (count, 3) and found.covariances.shape == (count, 3, 3)
    assert np.isfinite(found.positions).all()
    observed = np.array(found.observed)
    assert not found.covariances[:, ~observed].any() and not found.covariances[:, :, ~observed].any()
    assert np.array_equal(found.covariances, np.swapaxes(found.covariances, 1, 2))
    assert (np.linalg.eigvalsh(found.covariances[:, observed][:, :, observed]) > 0.0).all()
    assert found.confidences.shape == (count,) and ((found.confidences >= 0.0) & (found.confidences <= 1.0)).all()
    assert found.period_s > 0.0
    assert found.points.shape == (len(found.point_labels), 2) and set(found.point_labels) == set(range(legs))
    assert found.legs.shape == (legs, 2) and found.leg_owners.shape == (legs,)
    assert set(found.leg_owners) == set(range(count))
    if found.sight is not None:
        assert found.sight.ranges.shape == scan.ranges.shape and math.isfinite(found.sight.range_max)
        assert not (found.sight.ranges > found.sight.range_max).any()


@pytest.mark.parametrize("scan", SCANS.values(), ids=SCANS.keys())
def test_same_scan_gives_the_same_people(build, scan):
    cue = build()
    first, second = cue.measure(scan, None), cue.measure(scan, None)
    for name in ("positions", "covariances", "confidences", "points", "point_labels", "legs", "leg_owners"):
        assert np.array_equal(getattr(first, name), getattr(second, name))


def test_scan_without_beams_is_refused(build):
    with pytest.raises(DataError):
        build().measure(scan_with([]), None)


def test_scans_may_change_their_shape(build):
    cue = build()
    for name in ("crowd", "one beam", "full circle", "negative increment", "10,000 beams", "crowd"):
        alone = build().measure(SCANS[name], None)
        assert np.array_equal(cue.measure(SCANS[name], None).positions, alone.positions)


def test_scan_is_not_written_to(build):
    scan = crowd()
    scan.ranges.setflags(write=False)
    build().measure(scan, Motion())
