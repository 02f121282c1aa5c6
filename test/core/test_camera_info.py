"""Cameras as drivers describe them."""

from __future__ import annotations

import numpy as np
import pytest

from people_fusion.core.camera_info import camera_of
from people_fusion.core.camera_models import Fisheye, Pinhole
from people_fusion.core.errors import DataError
from people_fusion.core.image_topics import camera_info_of, is_rectified, without_transport

K = (500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0)
P = (480.0, 0.0, 310.0, 0.0, 0.0, 480.0, 230.0, 0.0, 0.0, 0.0, 1.0, 0.0)
EYE = tuple(np.eye(3).ravel())
POINT = np.array([[0.4, -0.3, 2.0]])


def test_raw_images_are_distorted_and_rectified_ones_are_not():
    raw = camera_of(640, 480, "plumb_bob", (0.1, 0.0, 0.0, 0.0, 0.0), K, EYE, P, rectified=False)
    rectified = camera_of(640, 480, "plumb_bob", (0.1, 0.0, 0.0, 0.0, 0.0), K, EYE, P, rectified=True)
    assert np.allclose(rectified.project(POINT), [[310.0 + 96.0, 230.0 - 72.0]])
    assert np.allclose(raw.project(POINT), [[320.0 + 100.0 * 1.00625, 240.0 - 76.5 * 1.00625]])


@pytest.mark.parametrize("model, kind", [("equidistant", Fisheye), ("fisheye", Fisheye), ("", Pinhole),
                                         ("rational_polynomial", Pinhole)])  # fmt: skip
def test_lens_is_the_models(model, kind):
    coefficients = (0.0,) * (4 if kind is Fisheye else 8)
    assert type(camera_of(640, 480, model, coefficients, K, (0.0,) * 9, P, rectified=False)) is kind


@pytest.mark.parametrize("changes", [{"model": "thin_prism"}, {"K": (0.0,) * 9}, {"K": (np.nan,) * 9}, {"width": 0}])
def test_driver_that_is_not_calibrated_describes_no_camera(changes):
    fields = {"width": 640, "height": 480, "model": "", "D": (), "K": K, "R": EYE, "P": P, "rectified": False}
    with pytest.raises(DataError):
        camera_of(**{**fields, **changes})


def test_topics_tell_transport_and_rectification():
    assert without_transport("/head/rgb/image_raw/compressed") == "/head/rgb/image_raw"
    assert camera_info_of("/head/rgb/image_raw/compressed") == "/head/rgb/camera_info"
    assert without_transport("/kinect/depth/image_rect/compressedDepth") == "/kinect/depth/image_rect"
    assert camera_info_of("image_raw") == "camera_info"
    assert is_rectified("/head/rgb/image_rect_color/compressed") and not is_rectified("/head/rgb/image_raw")
    assert is_rectified("/kinect2/sd/image_depth_rect") and not is_rectified("/rect/sd/image_depth")
