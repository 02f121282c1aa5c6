"""Pixels of images as they are sent, good and broken."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from people_fusion.core.errors import DataError
from people_fusion.core.pixels import MISFIT, UNKNOWN, UNREADABLE, compressed_pixels, raw_pixels

RNG = np.random.default_rng(4)
COLOUR = RNG.integers(0, 256, (6, 8, 3)).astype(np.uint8)
GREY = COLOUR[..., 0]


def raw(pixels, encoding, step=None, big_endian=False):
    height, width = pixels.shape[:2]
    data = pixels.tobytes()
    return raw_pixels(height, width, step or len(data) // height, encoding, big_endian, data)


@pytest.mark.parametrize(
    "encoding, sent",
    [
        ("bgr8", COLOUR), ("8UC3", COLOUR), ("rgb8", COLOUR[..., ::-1]),
        ("bgra8", np.dstack([COLOUR, GREY])), ("rgba8", np.dstack([COLOUR[..., ::-1], GREY])),
    ],
)  # fmt: skip
def test_colours_are_blue_green_red(encoding, sent):
    np.testing.assert_array_equal(raw(np.ascontiguousarray(sent), encoding), COLOUR)


def test_grey_stays_grey():
    np.testing.assert_array_equal(raw(GREY, "mono8"), GREY)
    for kind, big_endian in (("<u2", False), (">u2", True)):
        deep = (GREY.astype(int) * 256 + 17).astype(kind)
        np.testing.assert_array_equal(raw(deep, "mono16", big_endian=big_endian), GREY)


@pytest.mark.parametrize("encoding, red_at", [("rggb", (0, 0)), ("bggr", (1, 1)), ("gbrg", (1, 0)), ("grbg", (0, 1))])
def test_mosaic_of_a_red_wall_is_red(encoding, red_at):
    mosaic = np.zeros((8, 8), dtype=np.uint8)
    mosaic[red_at[0] :: 2, red_at[1] :: 2] = 200
    blue, green, red = raw(mosaic, f"bayer_{encoding}8")[2:-2, 2:-2].reshape(-1, 3).mean(axis=0)
    assert red > 150 and blue < 50 and green < 50


@pytest.mark.parametrize("encoding, order", [("yuv422", (1, 0, 1, 0)), ("yuv422_yuy2", (0, 1, 0, 1))])
def test_luminance_of_pairs_of_pixels(encoding, order):
    pairs = np.full((4, 4, 2), 128, dtype=np.uint8)  # no colour
    pairs[..., order[0]] = 180
    assert np.ptp(raw(pairs, encoding)) <= 1 and raw(pairs, encoding).mean() > 150


def test_rows_may_be_padded_but_for_the_last():
    padded = np.zeros((6, 30), dtype=np.uint8)
    padded[:, :24] = COLOUR.reshape(6, 24)
    data = padded.tobytes()
    for end in (len(data), len(data) - 6):
        np.testing.assert_array_equal(raw_pixels(6, 8, 30, "bgr8", False, data[:end]), COLOUR)


@pytest.mark.parametrize(
    "height, width, step, encoding, size, reason",
    [
        (6, 8, 24, "bgr8", 143, MISFIT), (6, 8, 23, "bgr8", 144, MISFIT), (0, 8, 24, "bgr8", 144, MISFIT),
        (6, 0, 0, "bgr8", 0, MISFIT), (1 << 20, 1 << 20, 1 << 20, "mono8", 10, MISFIT), (6, 8, 24, "", 144, UNKNOWN),
        (6, 8, 24, "16UC1", 144, UNKNOWN), (1, 1, 1, "bayer_rggb8", 1, None), (1, 1, 2, "yuv422", 2, MISFIT),
    ],
)  # fmt: skip
def test_what_cannot_be_an_image_is_refused(height, width, step, encoding, size, reason):
    try:
        pixels = raw_pixels(height, width, step, encoding, False, bytes(size))
    except DataError as error:
        assert error.reason in (reason, MISFIT)
    else:
        assert reason is None and pixels.shape[:2] == (height, width)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 5), st.integers(0, 5), st.integers(0, 20), st.binary(max_size=80), st.sampled_from(
    ["mono8", "bgr8", "rgba8", "mono16", "bayer_gbrg8", "yuv422", "nonsense"]))  # fmt: skip
def test_any_header_with_any_data_is_an_image_or_refused(height, width, step, data, encoding):
    try:
        pixels = raw_pixels(height, width, step, encoding, False, data)
    except DataError:
        return
    assert pixels.dtype == np.uint8 and pixels.shape[:2] == (height, width)


def test_compressed_images_keep_their_colours():
    for pixels in (COLOUR, GREY):
        _, data = cv2.imencode(".png", pixels)
        np.testing.assert_array_equal(compressed_pixels(data.tobytes()), pixels)


@pytest.mark.parametrize("data", [b"", b"no image", bytes(1000)])
def test_what_is_no_jpeg_is_refused(data):
    with pytest.raises(DataError) as raised:
        compressed_pixels(data)
    assert raised.value.reason == UNREADABLE


def test_truncated_jpeg_is_an_image_of_its_size_or_refused():
    _, data = cv2.imencode(".jpg", np.tile(COLOUR, (10, 10, 1)))
    for end in range(0, len(data), 7):
        try:
            assert compressed_pixels(data.tobytes()[:end]).shape == (60, 80, 3)
        except DataError:
            continue
