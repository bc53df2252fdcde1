from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.rvl import decode_rvl

Image = NDArray[np.uint16]


def nibbles(number: int) -> Iterator[int]:
    while number >= 8:
        yield number & 7 | 8
        number >>= 3
    yield number


def runs(pixels: list[int]) -> Iterator[int]:
    """The numbers that RVL writes for an image."""
    at = previous = 0
    while at < len(pixels):
        start = at
        while at < len(pixels) and pixels[at] == 0:
            at += 1
        yield at - start
        start = at
        while at < len(pixels) and pixels[at] != 0:
            at += 1
        yield at - start
        for value in pixels[start:at]:
            difference = value - previous
            yield 2 * difference if difference >= 0 else -2 * difference - 1
            previous = value


def encode(image: Image) -> bytes:
    digits = [digit for number in runs(image.ravel().tolist()) for digit in nibbles(number)]
    digits += [0] * (-len(digits) % 8)
    words = [
        int("".join(f"{d:x}" for d in digits[i : i + 8]), 16) for i in range(0, len(digits), 8)
    ]
    return struct.pack(f"<II{len(words)}I", image.shape[1], image.shape[0], *words)


def test_bytes_written_by_compressed_depth_image_transport_are_read() -> None:
    """Its encoder (rvl_codec.cpp) wrote these."""
    data = bytes.fromhex("23f38a35bff38c8ec122f3ff16bf182120abba4800001008")
    image = decode_rvl(struct.pack("<II", 6, 4) + data, "/depth")
    assert image.tolist() == [
        [0, 0, 0, 1000, 1001, 999],
        [65535, 1, 0, 0, 7, 8],
        [0, 500, 0, 0, 0, 0],
        [0, 0, 40000, 40000, 40000, 40004],
    ]


@given(
    npst.arrays(
        np.uint16,
        npst.array_shapes(min_dims=2, max_dims=2, max_side=12),
        elements=st.sampled_from([0, 0, 0, 1, 7, 900, 901, 65535]) | st.integers(0, 65535),
    )
)
def test_output_of_an_encoder_written_from_the_paper_is_read_back(image: Image) -> None:
    assert np.array_equal(decode_rvl(encode(image), "/depth"), image)


def test_a_camera_image_is_read_back() -> None:
    v, u = np.mgrid[:48, :64]
    image = np.where((u - 30) ** 2 + (v - 20) ** 2 < 200, 0, 900 + 3 * u + v).astype(np.uint16)
    assert np.array_equal(decode_rvl(encode(image), "/depth"), image)


@given(st.data())
def test_changed_or_truncated_bytes_are_refused_or_give_an_image_of_that_size(
    data: st.DataObject,
) -> None:
    image = np.arange(60, dtype=np.uint16).reshape(6, 10)
    damaged = bytearray(encode(image))
    for _ in range(data.draw(st.integers(0, 4))):
        at = data.draw(st.integers(8, len(damaged) - 1))
        damaged[at] = data.draw(st.integers(0, 255))
    damaged = damaged[: data.draw(st.integers(0, len(damaged)))]
    with suppress(InputError):
        assert decode_rvl(bytes(damaged), "/depth").shape == (6, 10)


@pytest.mark.parametrize(
    ("data", "cause"),
    [
        (b"", "truncated: 0 bytes"),
        (struct.pack("<II", 60_000, 60_000), "an image of 60000x60000 pixels"),
        (struct.pack("<II", 0, 48), "an image of 0x48 pixels"),
        (struct.pack("<II", 6, 4), "damaged RVL of 8 bytes for 6x4 pixels"),
        # no zeros and no non-zeros, for ever
        (struct.pack("<II", 6, 4) + bytes(64), "damaged RVL"),
        # a number that goes on without end
        (struct.pack("<II", 6, 4) + b"\xff" * 64, "damaged RVL"),
        (encode(np.ones((4, 6), np.uint16))[:-4], "damaged RVL"),
        # more pixels than the image has
        (struct.pack("<II", 2, 2) + encode(np.ones((4, 6), np.uint16))[8:], "damaged RVL"),
    ],
)
def test_invalid_data_are_refused(data: bytes, cause: str) -> None:
    with pytest.raises(InputError, match=f"^/depth: .*{cause}"):
        decode_rvl(data, "/depth")
