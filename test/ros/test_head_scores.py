from __future__ import annotations

import io
from typing import Any, Callable, Optional

import numpy as np
import pytest

pytest.importorskip("people_fusion.msg", reason="the messages are not built; tools/test builds them")

from rospy.numpy_msg import numpy_msg
from sensor_msgs.msg import CameraInfo

from people_fusion.core.camera_models import Panorama, PanoramaConfig
from people_fusion.core.errors import DataError
from people_fusion.core.head_scores import FEATURES, NO_SCORES, SCORES
from people_fusion.core.images import Image
from people_fusion.core.measurements import XYZ_OBSERVED, Measurement
from people_fusion.cues.heads.detector import Search
from people_fusion.cues.heads.detectors.fhog_head import FhogHead, FhogHeadConfig
from people_fusion.cues.heads.places import scores_at
from people_fusion.msg import HeadScores
from people_fusion.ros.head_scores import scored_from_msg, scores_to_msg
from people_fusion.ros.images import camera_from_msg

PANORAMA = Panorama(PanoramaConfig(width=480, height=160))
PINHOLE = CameraInfo(width=480, height=160, distortion_model="plumb_bob", D=[0.0] * 5,
                     K=[400.0, 0.0, 240.0, 0.0, 400.0, 80.0, 0.0, 0.0, 1.0])  # fmt: skip


def seen(wanted: str = FEATURES, info: Optional[Any] = None) -> Measurement:
    """Noise, in which some windows look like heads."""
    camera = PANORAMA if info is None else camera_from_msg(info, rectified=False)
    pixels = np.random.default_rng(1).integers(0, 256, (160, 480, 3)).astype(np.uint8)
    pixels = pixels.repeat(4, axis=0).repeat(4, axis=1)[:160, :480]
    image = Image(5_000_000_007, "panorama", pixels, camera)
    detector = FhogHead(FhogHeadConfig(threshold=-4.0, enlarge=1.3))
    detector.wanted_scores = wanted
    boxes = detector.detect(image, Search.everywhere(image, 20.0, 100.0))
    scores = detector.scores(image, boxes)
    if scores is not None:
        rows = np.arange(min(2, len(boxes.scores)))
        scores = scores.select(rows)
    count = 0 if scores is None else len(scores.box_scores)
    places = np.arange(3.0 * count).reshape(count, 3)
    covariances = np.tile(0.01 * np.eye(3), (count, 1, 1))
    return Measurement(
        image.stamp_ns, "camera/head", "head", "panorama", places, covariances, np.full(count, 0.5), XYZ_OBSERVED, 0.1,
        sequence=3, scores=scores,
    )  # fmt: skip


def sent(measurement: Measurement, info: Optional[Any] = None) -> Any:
    """The message as it comes out of the wire."""
    buffer = io.BytesIO()
    kind = numpy_msg(HeadScores)
    message = scores_to_msg(measurement, info, rectified=False)
    wired = kind(*(getattr(message, name) for name in HeadScores.__slots__))
    wired.serialize(buffer)
    return kind().deserialize(buffer.getvalue())


@pytest.mark.parametrize("info", [None, PINHOLE], ids=["panorama", "pinhole"])
@pytest.mark.parametrize("wanted", [SCORES, FEATURES])
def test_scores_come_back_as_they_went(wanted: str, info: Optional[Any]) -> None:
    measurement = seen(wanted, info)
    message = sent(measurement, info)
    assert message.detections.scored
    back = scored_from_msg(message, {"panorama": PANORAMA} if info is None else {})
    there, here = measurement.scores, back.scores
    assert there is not None and here is not None and len(there.layers) > 3
    assert back.cue == "camera/head" and back.stamp_ns == measurement.stamp_ns and back.sequence == 3
    np.testing.assert_array_equal(back.positions, measurement.positions)
    np.testing.assert_array_equal(here.corners, there.corners)
    assert here.window == there.window and here.beyond == there.beyond and here.has_features == (wanted == FEATURES)
    assert (here.height, here.head_above, here.platt_slope) == (there.height, there.head_above, there.platt_slope)
    points = np.array([[0.0, 0.1, 1.0], [0.2, 0.0, 3.0]]) @ (np.eye(3) if info is not None else np.eye(3)[[2, 0, 1]])
    np.testing.assert_allclose(here.camera.project(points), there.camera.project(points))
    for before, after in zip(there.layers, here.layers):
        np.testing.assert_array_equal(after.scores, before.scores)
        np.testing.assert_array_equal(after.scale, before.scale)
        assert (after.row, after.col) == (before.row, before.col)
        if wanted == FEATURES:
            step = float(before.features.max() - before.features.min()) / 255.0
            assert np.abs(after.features - before.features).max() < 0.51 * step


def test_scores_of_quantised_features_are_nearly_those_of_the_features_themselves() -> None:
    """What a person's own model will be off by: less than a fiftieth of what tells a head from what is none."""
    measurement = seen()
    back = scored_from_msg(sent(measurement), {"panorama": PANORAMA})
    weights = FhogHead(FhogHeadConfig()).model.weights
    rows, cols = weights.shape[:2]
    for before, after in zip(measurement.scores.layers, back.scores.layers):  # type: ignore[union-attr]
        first, second = ((layer.features[:rows, :cols] * weights).sum() for layer in (before, after))
        assert abs(first - second) < 0.02


def test_a_find_scores_in_the_layers_what_it_scored_when_found() -> None:
    scores = seen(SCORES).scores
    assert scores is not None and len(scores.box_scores) > 0
    low, high = scores.corners[:, :2], scores.corners[:, 2:]
    middles, heights = 0.5 * (low + high), (high - low)[:, 1]
    around = scores_at(scores, middles, heights)
    np.testing.assert_allclose(around, scores.box_scores, atol=0.35)  # between the cells; boxes are refined
    turned = scores_at(scores, middles + [PANORAMA.width, 0.0], heights)
    np.testing.assert_allclose(turned, around)


def test_a_detector_that_is_not_asked_has_no_scores() -> None:
    assert seen(NO_SCORES).scores is None


def spoilt(part: str, value: Any) -> Callable[[Any], None]:
    def spoil(message: Any) -> None:
        *path, name = part.split(".")
        for step in path:
            message = message[int(step)] if step.isdigit() else getattr(message, step)
        setattr(message, name, value(getattr(message, name)) if callable(value) else value)

    return spoil


@pytest.mark.parametrize(
    "spoil",
    [
        spoilt("corners", lambda values: values[:-1]),
        spoilt("box_scores", lambda values: values * np.nan),
        spoilt("window_rows", 0), spoilt("window_cell", 1 << 31), spoilt("window_box", np.zeros(4)),
        spoilt("platt_slope", 1.0), spoilt("head_height", 0.0), spoilt("width", 17),
        spoilt("layers.0.scores", lambda values: values[:-1]),
        spoilt("layers.0.scores", lambda values: values * np.nan),
        spoilt("layers.0.rows", 1 << 31), spoilt("layers.0.scale_x", -1.0), spoilt("layers.0.step", float("inf")),
        spoilt("layers.0.features", lambda values: values[:-1]), spoilt("layers.0.dimensions", 1 << 31),
        spoilt("detections.header.frame_id", "elsewhere"), spoilt("detections.cue", ""),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(spoil: Callable[[Any], None]) -> None:
    message = sent(seen())
    spoil(message)
    with pytest.raises(DataError):
        scored_from_msg(message, {"panorama": PANORAMA})
