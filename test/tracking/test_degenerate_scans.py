"""From scans that are hardly any to tracks: the leg cue and every tracker, with nothing unsaid and nothing invented."""

import warnings

import numpy as np
import pytest

from people_fusion.core.errors import DataError
from people_fusion.core.poses import Pose
from people_fusion.core.scans import Scan
from people_fusion.core.stamps import from_seconds
from people_fusion.core.transforms import FramesConfig, TransformSource
from people_fusion.cues.cue import CUES
from people_fusion.tracking.fusion import Fusion, load_config

BEAMS = 1500
RNG = np.random.default_rng(8)
SCANS = {
    "empty": np.zeros(0),
    "no information": np.full(541, np.nan),
    "too near": np.full(541, -np.inf),
    "nothing within reach": np.full(541, np.inf),
    "one beam": np.array([2.0]),
    "one beam without information": np.array([np.nan]),
    "10,000 beams": RNG.uniform(0.5, 9.0, 10_000),
    "10,000 beams on a wall": np.full(10_000, 2.0),
    "500 segments": np.where(np.arange(BEAMS) // 3 % 2, 2.0, 4.0),
}
PRESETS = ("default", "poschmann_t1", "volkhardt", "leg_mht", "kalman_over_legs")


class Standing(TransformSource):
    """A robot that stands at the world's origin."""

    def lookup(self, target_frame, source_frame, stamp_ns):  # noqa: ARG002
        return Pose.from_xy_yaw(0.0, 0.0, 0.0)


def legs_of_a_walker(time_s):
    """Ranges of two legs that swing in turn, 1 m/s, and nothing else."""
    angles = -np.pi / 2 + np.pi / 540 * np.arange(541)
    ranges = np.full(541, np.inf)
    for side in (-1.0, 1.0):
        x, y = 1.0 + time_s + side * 0.2 * np.sin(5.0 * time_s), 0.12 * side
        ranges[np.abs(angles - np.arctan2(y, x)) < 0.06 / np.hypot(x, y)] = np.hypot(x, y)
    return ranges


@pytest.mark.parametrize("name", SCANS)
@pytest.mark.parametrize("preset", PRESETS)
def test_a_walker_is_found_before_and_after_scans_that_are_hardly_any(preset, name):
    settings = load_config(preset)
    fusion = Fusion(settings, Standing())
    cue = CUES.build(settings.leg_cue, name="scan", frames=FramesConfig())

    def see(time_s, ranges):
        increment = np.pi / max(len(ranges) - 1, 1)
        scan = Scan(from_seconds(time_s), "laser", ranges, -np.pi / 2, increment, 0.05, 30.0)
        if not len(ranges):
            with pytest.raises(DataError):  # the nodes count it and go on
                cue.measure(scan, Standing())
            return fusion.tracks()
        for measurement in fusion.push(cue.measure(scan, Standing()), scan.stamp_ns):
            fusion.process(measurement)
        tracks = fusion.tracks()
        assert np.isfinite(tracks.means).all() and np.isfinite(tracks.covariances).all()
        return tracks

    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for step in range(6):
            see(0.1 * step, SCANS[name])
        for step in range(6, 46):
            tracks = see(0.1 * step, legs_of_a_walker(0.1 * step))
        near = np.hypot(*(tracks.means[:, :2] - [5.5, 0.0]).T) < 0.5
        assert (near & tracks.confirmed).sum() == 1
