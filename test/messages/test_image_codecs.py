from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.image_codecs import (
    MAX_PIXELS,
    decode,
    encode_jpeg,
    encode_png,
    quantised,
)

GREY = np.arange(48 * 64, dtype=np.uint16).reshape(48, 64) * 20
BGR = np.stack([np.tile(np.arange(64, dtype=np.uint8) * k, (48, 1)) for k in (1, 2, 3)], axis=2)


def png_claiming(width: int, height: int) -> bytes:
    """A PNG whose header claims a size, with a right checksum."""
    png = bytearray(encode_png(GREY))
    png[16:24] = struct.pack(">II", width, height)
    png[29:33] = struct.pack(">I", zlib.crc32(png[12:29]))
    return bytes(png)


def jpeg_claiming(width: int, height: int) -> bytes:
    jpeg = bytearray(encode_jpeg(BGR))
    start = jpeg.index(b"\xff\xc0")
    jpeg[start + 5 : start + 9] = struct.pack(">HH", height, width)
    return bytes(jpeg)


def test_png_is_lossless_in_16_bits_and_in_colour() -> None:
    assert np.array_equal(decode(encode_png(GREY), "here"), GREY)
    assert np.array_equal(decode(encode_png(BGR), "here"), BGR)


def test_jpeg_is_decoded_as_by_opencv() -> None:
    data = encode_jpeg(BGR)
    expected = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR))
    assert np.array_equal(decode(data, "here"), expected)
    assert np.abs(expected.astype(int) - BGR).mean() < 4


def test_jpeg_of_every_kind_of_scan_is_read() -> None:
    for options in (
        [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
        [cv2.IMWRITE_JPEG_OPTIMIZE, 1],
        [cv2.IMWRITE_JPEG_RST_INTERVAL, 2],
    ):
        _, data = cv2.imencode(".jpg", BGR, options)
        assert decode(data.tobytes(), "here").shape == BGR.shape
        assert decode(data.tobytes() + bytes(100), "here").shape == BGR.shape


@pytest.mark.parametrize("data", [encode_png(GREY), encode_jpeg(BGR)], ids=["png", "jpeg"])
@given(fraction=st.floats(0, 1, exclude_max=True))
@settings(max_examples=60, deadline=None)
def test_an_image_truncated_anywhere_is_refused(data: bytes, fraction: float) -> None:
    with pytest.raises(InputError, match=r"^/topic: "):
        decode(data[: int(fraction * len(data))], "/topic")


@given(position=st.integers(0, len(encode_png(GREY)) - 1), flip=st.integers(1, 255))
@settings(max_examples=100, deadline=None)
def test_a_png_with_one_wrong_byte_is_refused(position: int, flip: int) -> None:
    data = bytearray(encode_png(GREY))
    data[position] ^= flip
    with pytest.raises(InputError):
        decode(bytes(data), "/topic")


@pytest.mark.parametrize("claiming", [png_claiming, jpeg_claiming])
def test_a_header_with_an_absurd_size_is_refused_before_memory_is_allocated(
    claiming: Callable[[int, int], bytes],
) -> None:
    with pytest.raises(InputError, match=re.escape("65000x65000 pixels; give one with at least")):
        decode(claiming(65000, 65000), "/topic")
    with pytest.raises(InputError, match=f"at most {MAX_PIXELS} pixels"):
        decode(claiming(0, 480), "/topic")


def test_a_png_with_fewer_pixels_than_its_header_says_is_refused() -> None:
    with pytest.raises(InputError, match="cannot be decoded"):
        decode(png_claiming(64, 96), "/topic")


@pytest.mark.parametrize("data", [b"", b"GIF89a" + bytes(100), bytes(1000)])
def test_bytes_that_are_not_an_image_are_refused(data: bytes) -> None:
    with pytest.raises(InputError, match="not PNG, JPEG"):
        decode(data, "/topic")


def test_refusals_write_nothing_to_stderr(capfd: pytest.CaptureFixture[str]) -> None:
    for data in (encode_png(GREY)[:-1], encode_jpeg(BGR)[:-1], png_claiming(65000, 65000)):
        with pytest.raises(InputError):
            decode(data, "/topic")
    assert capfd.readouterr().err == ""


@pytest.mark.filterwarnings("error")
def test_depth_of_any_number_is_quantised_without_a_warning() -> None:
    depth = np.array([[1.5, np.nan, -1.0, 70.0, 3e38, np.inf]], np.float32)
    np.testing.assert_array_equal(quantised(depth, 1000), [[1500, 0, 0, 0, 0, 0]])
