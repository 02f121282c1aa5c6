"""Depths of images as they are sent, good and broken."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.core.errors import DataError
from people_fusion.core.pixels import MISFIT, NO_DEPTHS, UNREADABLE, compressed_depths, raw_depths

RNG = np.random.default_rng(4)
MILLIMETRES = RNG.integers(400, 9000, (6, 8)).astype(np.uint16)
MILLIMETRES[2, 3] = 0
METRES = np.where(MILLIMETRES > 0, MILLIMETRES / 1000.0, np.nan).astype(np.float32)


def png(pixels):
    return cv2.imencode(".png", pixels)[1].tobytes()


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("encoding, kind, sent", [
    ("16UC1", "u2", MILLIMETRES), ("mono16", "u2", MILLIMETRES), ("32FC1", "f4", METRES),
])  # fmt: skip
def test_raw_depths_are_metres_with_nan_for_none(order, encoding, kind, sent):
    rows = np.zeros((6, 60), dtype=np.uint8)
    packed = sent.astype(order + kind)
    rows[:, : packed.strides[0]] = packed.view(np.uint8).reshape(6, -1)
    for data in (rows.tobytes(), rows.tobytes()[: 60 * 5 + packed.strides[0]]):  # the last row filled up or not
        depths = raw_depths(6, 8, 60, encoding, order == ">", data)
        assert depths.dtype == np.float32
        np.testing.assert_allclose(depths, METRES, rtol=1e-6)


def test_floats_that_are_no_depths_are_none():
    sent = np.array([[np.inf, -np.inf, -1.0, 0.0, 2.5, np.nan]], dtype="<f4")
    found = raw_depths(1, 6, 24, "32FC1", False, sent.tobytes())
    np.testing.assert_array_equal(found, [[np.nan] * 4 + [2.5, np.nan]])


@pytest.mark.parametrize("header", [b"", bytes(12)])
def test_compressed_millimetres(header):
    for encoding in ("16UC1; compressedDepth", "16UC1; compressedDepth png", "16UC1; png compressed "):
        found = compressed_depths(encoding, header + png(MILLIMETRES))
        np.testing.assert_allclose(found, METRES, rtol=1e-6)


def test_a_kinect_2_sends_tiff():
    tiff = cv2.imencode(".tif", MILLIMETRES)[1].tobytes()
    np.testing.assert_allclose(compressed_depths("16UC1; tiff compressed", tiff), METRES, rtol=1e-6)


def test_compressed_floats_are_undone_as_they_were_made():
    quantisation, farthest = 100.0, 10.0  # as compressed_depth_image_transport's encoder
    a, b = quantisation * (quantisation + 1.0), 1.0 - quantisation * (quantisation + 1.0) / farthest
    inverse = np.nan_to_num(a / METRES + b).astype(np.uint16)
    found = compressed_depths("32FC1; compressedDepth", struct.pack("<iff", 0, a, b) + png(inverse))
    assert np.isnan(found[2, 3])
    np.testing.assert_allclose(found, METRES, atol=METRES[~np.isnan(METRES)].max() ** 2 / a)


@pytest.mark.parametrize(
    "arguments, reason",
    [
        ((0, 8, 16, "16UC1", False, bytes(96)), MISFIT),
        ((6, 8, 15, "16UC1", False, bytes(96)), MISFIT),
        ((6, 8, 16, "16UC1", False, bytes(95)), MISFIT),
        ((1 << 20, 1 << 20, 16, "16UC1", False, bytes(96)), MISFIT),
        ((6, 8, 24, "bgr8", False, bytes(144)), NO_DEPTHS),
        ((6, 8, 16, "nonsense", False, bytes(96)), NO_DEPTHS),
    ],
)
def test_raw_depths_that_cannot_be_are_refused(arguments, reason):
    with pytest.raises(DataError, match=reason):
        raw_depths(*arguments)


@pytest.mark.parametrize(
    "encoding, data, reason",
    [
        ("16UC1; compressedDepth", b"", UNREADABLE),
        ("16UC1; compressedDepth", bytes(12), UNREADABLE),
        ("16UC1; compressedDepth", bytes(12) + png(MILLIMETRES)[:40], UNREADABLE),
        ("16UC1; compressedDepth rvl", bytes(12) + bytes(range(100)), UNREADABLE),
        ("32FC1; compressedDepth", png(MILLIMETRES), NO_DEPTHS),
        ("bgr8; jpeg compressed bgr8", png(np.zeros((6, 8, 3), np.uint8)), NO_DEPTHS),
        ("mono8; png compressed ", png(np.zeros((6, 8), np.uint8)), NO_DEPTHS),
    ],
)
def test_compressed_depths_that_cannot_be_are_refused(encoding, data, reason):
    with pytest.raises(DataError, match=reason):
        compressed_depths(encoding, data)


@settings(max_examples=50, deadline=None)
@given(st.binary(max_size=300), st.sampled_from(["16UC1; compressedDepth", "32FC1; compressedDepth", ""]))
def test_anything_else_is_refused_and_breaks_nothing(data, encoding):
    with pytest.raises(DataError):
        compressed_depths(encoding, data)
