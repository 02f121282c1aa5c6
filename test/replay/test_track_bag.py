"""Tracks and detections are written as the live nodes publish them, and read back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from bags import BagBuilder, walk

from people_fusion.core.errors import RecordingError
from people_fusion.core.measurements import XY_OBSERVED, Measurement, Sight
from people_fusion.core.tracks import Tracks
from people_fusion.core.wire import UNOBSERVED_VARIANCE
from people_fusion.replay.recording import Recording
from people_fusion.replay.track_bag import (
    DETECTIONS_TOPIC,
    TRACKS_TOPIC,
    TrackWriter,
    predicted,
    read_tracks,
)

STAMP_NS = 1_500_000_000_123_456_789


def some_tracks(size: int = 5) -> Tracks:
    rng = np.random.default_rng(size)
    roots = rng.normal(size=(3, size, size))
    return Tracks(
        stamp_ns=STAMP_NS,
        frame_id="map",
        ids=np.array([3, 5, 2**40]),
        means=rng.normal(size=(3, size)),
        covariances=roots @ roots.transpose(0, 2, 1),
        existence=np.array([0.9, 0.1, 1.0]),
        confirmed=np.array([True, False, True]),
        matched=np.array([True, False, False]),
        occluded=np.array([False, False, True]),
        ages_s=np.array([1.5, 0.0, 2.25]),
    )


@pytest.mark.parametrize("size", [5, 6])
def test_confirmed_tracks_come_back_but_for_what_the_message_does_not_hold(tmp_path: Path, size: int) -> None:
    tracks = some_tracks(size)
    with TrackWriter(tmp_path / "out.bag") as writer:
        writer.write_tracks(tracks, STAMP_NS + 10**7)
    with Recording(tmp_path / "out.bag") as recording:
        (back,) = read_tracks(recording, recording.topic(TRACKS_TOPIC))
    shown = tracks.select(tracks.confirmed)
    assert (back.stamp_ns, back.frame_id, back.ids.tolist()) == (STAMP_NS, "map", [3, 2**40])
    np.testing.assert_array_equal(back.means, shown.means[:, :5])
    np.testing.assert_array_equal(back.covariances[:, :3, :3], shown.covariances[:, :3, :3])
    np.testing.assert_array_equal(back.covariances[:, 3:, 3:], shown.covariances[:, 3:5, 3:5])
    for name in ("existence", "matched", "occluded", "ages_s"):
        np.testing.assert_array_equal(getattr(back, name), getattr(shown, name))


def test_what_a_laser_does_not_observe_has_the_large_variance(tmp_path: Path) -> None:
    covariance = np.diag([0.01, 0.02, 0.0])
    measurement = Measurement(
        stamp_ns=STAMP_NS,
        cue="scan",
        modality="legs",
        frame_id="laser",
        positions=np.array([[1.0, 2.0, 1.5]]),
        covariances=covariance[None],
        confidences=np.array([0.7]),
        observed=XY_OBSERVED,
        sequence=4,
        sight=Sight(np.zeros(2), 0.0, -1.0, 0.5, np.array([1.0, np.nan, 3.0]), 10.0),
        legs=np.array([[1.0, 1.9], [1.0, 2.1]]),
        leg_owners=np.array([0, 0]),
    )
    with TrackWriter(tmp_path / "out.bag") as writer:
        writer.write_measurement(measurement, STAMP_NS)
    with Recording(tmp_path / "out.bag") as recording:
        message = next(recording.messages([recording.topic(DETECTIONS_TOPIC)])).read()
    assert (message.cue, message.modality, message.sequence, len(message.legs)) == ("scan", "legs", 4, 2)
    np.testing.assert_array_equal(message.sight_ranges, np.array([1.0, np.nan, 3.0], np.float32))
    variances = np.diag(message.detections[0].pose.covariance.reshape(6, 6))
    assert variances.tolist() == [0.01, 0.02, *[UNOBSERVED_VARIANCE] * 4]


def test_prediction_moves_with_the_velocity_and_grows_the_covariance() -> None:
    tracks = some_tracks()
    later = predicted(tracks, STAMP_NS + 500_000_000)
    np.testing.assert_allclose(later.means[:, :2], tracks.means[:, :2] + 0.5 * tracks.means[:, 3:])
    step = np.eye(5)
    step[0, 3] = step[1, 4] = 0.5
    np.testing.assert_allclose(later.covariances[1], step @ tracks.covariances[1] @ step.T)


def test_a_failure_leaves_the_former_bag_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "out.bag"
    path.write_bytes(b"precious")
    with pytest.raises(RuntimeError), TrackWriter(path) as writer:
        writer.write_tracks(some_tracks(), STAMP_NS)
        raise RuntimeError
    assert path.read_bytes() == b"precious" and list(tmp_path.iterdir()) == [path]


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="nowhere"):
        TrackWriter(tmp_path / "nowhere" / "out.bag")


def test_another_type_is_not_read_as_tracks(tmp_path: Path) -> None:
    expected = "/scan is not people_fusion/TrackedPersons"
    with Recording(walk(tmp_path / "a.bag", 1.0)) as recording, pytest.raises(RecordingError, match=expected):
        read_tracks(recording, recording.topic("/scan"))


def test_a_message_without_tracks_is_an_instant_too(tmp_path: Path) -> None:
    with BagBuilder(tmp_path / "b.bag") as bag:
        bag.add("/tracks", "people_fusion/TrackedPersons", 0.1, bag.header(0.1, "map"), [])
    with Recording(tmp_path / "b.bag") as recording:
        assert len(read_tracks(recording, recording.topic("/tracks"))[0]) == 0
