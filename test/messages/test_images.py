"""Images of every encoding and transport are the same pixels and metres."""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray
from rigs.messages import DEPTH, HEAD, RGB, flat, raw, smooth

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import CompressedImage
from rgbd_glue_ros.messages.image_codecs import encode_png
from rgbd_glue_ros.messages.images import color_from_message, depth_from_message
from rgbd_glue_ros.messages.making import compressed_color_image, compressed_depth_image


@pytest.mark.parametrize("padding", [0, 3, 64])
@pytest.mark.parametrize(
    ("encoding", "channels"),
    [
        ("rgb8", "rgb"),
        ("bgr8", "bgr"),
        ("rgba8", "rgba"),
        ("bgra8", "bgra"),
        ("8UC3", "bgr"),
        ("8UC4", "bgra"),
    ],
)
def test_every_colour_encoding_gives_the_same_rgb(
    encoding: str, channels: str, padding: int
) -> None:
    alpha = np.full((48, 64, 1), 77, np.uint8)
    pixels = np.concatenate([RGB, alpha], axis=2)[..., ["rgba".index(c) for c in channels]]
    image = color_from_message(raw(pixels, encoding, padding=padding), "/color")
    assert np.array_equal(image, RGB)
    assert image.flags.c_contiguous


@pytest.mark.parametrize("padding", [0, 5])
@pytest.mark.parametrize("encoding", ["mono8", "8UC1"])
def test_grey_stays_grey(encoding: str, padding: int) -> None:
    image = color_from_message(raw(RGB[..., 0], encoding, padding=padding), "/color")
    assert np.array_equal(image, RGB[..., 0])


def test_rgb_without_padding_is_not_copied() -> None:
    message = raw(RGB, "rgb8")
    assert np.shares_memory(color_from_message(message, "/color"), message.data)


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 1, 6])
@given(units=npst.arrays(np.uint16, (3, 5)))
@settings(max_examples=20, deadline=None)
def test_sixteen_bit_depth_is_in_millimetres_with_0_and_overflow_for_unknown(
    units: NDArray[np.uint16], padding: int, is_bigendian: bool
) -> None:
    for encoding in ("16UC1", "mono16"):
        message = raw(units, encoding, is_bigendian=is_bigendian, padding=padding)
        depth = depth_from_message(message, "/depth")
        assert depth.dtype == np.float32
        is_known = (units > 0) & (units < 65535)
        expected = np.where(is_known, units / 1000, np.nan).astype(np.float32)
        assert np.array_equal(depth, expected, equal_nan=True)


@pytest.mark.parametrize("is_bigendian", [False, True])
@pytest.mark.parametrize("padding", [0, 2])
def test_float_depth_is_in_metres_and_invalid_depth_becomes_nan(
    padding: int, is_bigendian: bool
) -> None:
    values = np.array([[1.5, 0.0, -1.0], [np.nan, np.inf, -np.inf]], np.float32)
    message = raw(values, "32FC1", is_bigendian=is_bigendian, padding=padding)
    nan = np.nan
    expected = [[1.5, nan, nan], [nan, nan, nan]]
    assert np.array_equal(depth_from_message(message, "/depth"), expected, equal_nan=True)


def test_a_truncated_image_is_refused_with_its_topic_and_size() -> None:
    message = raw(RGB, "rgb8")
    with pytest.raises(InputError) as caught:
        color_from_message(replace(message, data=message.data[:-1]), "/camera/color")
    assert str(caught.value) == (
        "/camera/color: data are truncated: 9215 bytes instead of 9216 for 64x48 rgb8; "
        "check the publisher or the recording"
    )


def test_the_padding_of_the_last_row_may_be_missing() -> None:
    message = raw(RGB, "rgb8", padding=64)
    message = replace(message, data=message.data[:-64])
    assert np.array_equal(color_from_message(message, "/color"), RGB)


@pytest.mark.parametrize(
    ("changes", "cause"),
    [
        ({"encoding": "h264"}, "encoding 'h264' is not supported for colour"),
        ({"encoding": "16UC1"}, "encoding '16UC1' is not supported for colour"),
        ({"step": 0}, "step is 0 bytes, but a row of 64 pixels rgb8 has 192"),
        ({"width": 0}, "an image of 0x48 pixels"),
        ({"width": 2**31, "height": 2**31}, "pixels"),
    ],
)
def test_an_image_with_invalid_fields_is_refused(changes: dict[str, Any], cause: str) -> None:
    with pytest.raises(InputError, match=r"^/color: ") as caught:
        color_from_message(replace(raw(RGB, "rgb8"), **changes), "/color")
    assert cause in str(caught.value)


def test_colour_on_the_depth_topic_is_refused() -> None:
    with pytest.raises(InputError, match="encoding 'rgb8' is not supported for depth"):
        depth_from_message(raw(RGB, "rgb8"), "/depth")
    with pytest.raises(InputError, match="which is not depth"):
        depth_from_message(compressed_color_image(RGB, HEAD), "/depth")


def test_jpeg_colours_are_in_the_right_order() -> None:
    image = smooth(RGB)
    decoded = color_from_message(compressed_color_image(image, HEAD, 98), "/color")
    assert np.abs(decoded.astype(int) - image).max() < 12
    grey = color_from_message(compressed_color_image(image[..., 0], HEAD, 98), "/color")
    assert grey.shape == (48, 64)
    assert np.abs(grey.astype(int) - image[..., 0]).max() < 12


@pytest.mark.parametrize(
    ("text", "in_file"),
    [
        ("png", "bgr"),
        ("bgr8; png compressed bgr8", "bgr"),
        ("rgb8; png compressed bgr8", "bgr"),
        ("rgb8; png compressed rgb8", "rgb"),
    ],
)
def test_the_order_of_colours_follows_the_format_text(text: str, in_file: str) -> None:
    pixels = RGB[..., ["rgb".index(c) for c in in_file]]
    message = CompressedImage(HEAD, text, np.frombuffer(encode_png(pixels), np.uint8))
    assert np.array_equal(color_from_message(message, "/color"), RGB)


def test_a_png_loses_its_alpha_channel() -> None:
    pixels = np.concatenate([RGB[..., ::-1], np.full((48, 64, 1), 9, np.uint8)], axis=2)
    message = CompressedImage(HEAD, "png", np.frombuffer(encode_png(pixels), np.uint8))
    assert np.array_equal(color_from_message(message, "/color"), RGB)


def test_compressed_depth_is_exact_to_half_a_millimetre() -> None:
    depth = DEPTH.copy()
    depth[0, :3] = np.nan, 70.0, np.inf
    decoded = depth_from_message(compressed_depth_image(depth, HEAD), "/depth")
    assert np.isnan(decoded[0, :3]).all()
    assert np.nanmax(np.abs(decoded - depth)[1:]) <= 0.0005 + 1e-6


def test_depth_as_plain_compressed_png_is_read_too() -> None:
    units = np.rint(DEPTH * 1000).astype(np.uint16)
    message = CompressedImage(HEAD, "16UC1; png compressed ", flat(encode_png(units)))
    assert np.allclose(depth_from_message(message, "/depth"), units / 1000)


def test_quantised_float_depth_follows_its_formula() -> None:
    """As compressed_depth_image_transport writes it: v = A / z + B."""
    a, b = 100.0 * 101.0, 1.0 - 100.0 * 101.0 / 10.0
    units = np.where(DEPTH > 0.5, a / DEPTH + b, 0).astype(np.uint16)
    data = struct.pack("<iff", 0, a, b) + encode_png(units)
    depth = depth_from_message(
        CompressedImage(HEAD, "32FC1; compressedDepth png", flat(data)), "/depth"
    )
    assert np.array_equal(np.isnan(depth), units == 0)
    assert np.nanmax(np.abs(depth - DEPTH) / DEPTH**2) < 1 / a + 1e-6


def test_depth_as_rvl_is_read_in_millimetres_and_as_quantised_floats() -> None:
    # 3 zeros, 3 others: 1000, then 1 more, then 2 less
    data = struct.pack("<iffIII", 0, 10.0, -1.0, 3, 2, 0x338AF323)
    nan = np.nan
    for text, expected in (
        ("16UC1; compressedDepth rvl", [[nan, nan, nan], [1.0, 1.001, 0.999]]),
        ("32FC1; compressedDepth rvl", [[nan, nan, nan], [10 / 1001, 10 / 1002, 10 / 1000]]),
    ):
        depth = depth_from_message(CompressedImage(HEAD, text, flat(data)), "/depth")
        np.testing.assert_allclose(depth, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("text", "data", "cause"),
    [
        ("16UC1; compressedDepth rvl", bytes(12), "truncated"),
        ("16UC1; compressedDepth png", b"1234", "truncated"),
        ("16UC1; compressedDepth png", bytes(12), "not PNG, JPEG"),
        ("16UC1; compressedDepth png", bytes(12) + encode_png(RGB), "uint8 and shape"),
        (
            "32FC1; compressedDepth png",
            bytes(12) + encode_png(np.ones((4, 4), np.uint16)),
            r"quantisation \(0.0, 0.0\) is invalid",
        ),
    ],
)
def test_compressed_depth_that_cannot_be_read_is_refused(
    text: str, data: bytes, cause: str
) -> None:
    with pytest.raises(InputError, match=f"^/depth: .*{cause}"):
        depth_from_message(CompressedImage(HEAD, text, flat(data)), "/depth")


def test_compressed_depth_on_the_colour_topic_is_refused() -> None:
    with pytest.raises(InputError, match="is depth"):
        color_from_message(compressed_depth_image(DEPTH, HEAD), "/color")


@pytest.mark.parametrize("kind", ["h264", "H.265", "hevc", "vp9"])
def test_video_instead_of_images_is_refused_with_what_to_send(kind: str) -> None:
    """As depthai-ros sends it (depthai-ros#653)."""
    message = CompressedImage(HEAD, kind, flat(b"\0\0\0\1" + bytes(50)))
    with pytest.raises(InputError, match=r"is video .*; make the driver send JPEG or raw images"):
        color_from_message(message, "/color/compressed")
