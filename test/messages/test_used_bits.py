"""Images of 16 bits are scaled by the bits that they use, for a whole run alike."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from rigs.messages import HEAD, RGB, flat, raw, smooth

from rgbd_glue_ros.messages.fields import CompressedImage
from rgbd_glue_ros.messages.images import color_from_message
from rgbd_glue_ros.messages.used_bits import UsedBits

VIEW = smooth(RGB)
GREY = VIEW[..., 0]
GREY[0, :40] = 255  # so that the view has a range of its own


def counts(of_8_bits: NDArray[np.uint8], bits: int) -> NDArray[np.uint16]:
    """The same view in the values of a sensor with more bits."""
    full = of_8_bits.astype(np.float64) / 255 * (2**bits - 1)
    return np.asarray(np.round(full), np.uint16)


def png(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    return flat(cv2.imencode(".png", pixels)[1].tobytes())


@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_infrared_of_any_number_of_bits_has_the_texture_of_8_bits(bits: int) -> None:
    pixels = counts(GREY, bits)
    for message in (
        raw(pixels, "mono16"),
        raw(pixels, "mono16", is_bigendian=True, padding=6),
        CompressedImage(HEAD, "mono16; png compressed mono16", png(pixels)),
    ):
        assert UsedBits().of(message, "/ir") == bits
        used = UsedBits()
        image = color_from_message(message, "/ir", used.scaled)
        assert used.bits == bits
        assert np.abs(image.astype(int) - GREY).max() <= 1


@pytest.mark.parametrize("encoding", ["rgb16", "rgba16"])
def test_colour_of_12_bits_is_scaled_alike_in_all_channels_whatever_the_opacity(
    encoding: str,
) -> None:
    pixels = counts(VIEW, 12)
    pixels[0, :40] = 4095
    if encoding == "rgba16":
        pixels = np.dstack([pixels, np.full(pixels.shape[:2], 65535, np.uint16)])
    message = raw(pixels, encoding)
    image = color_from_message(message, "/color", UsedBits().scaled)
    assert np.abs(image[1:].astype(int) - VIEW[1:]).max() <= 1
    # the name of the format need not tell how many bits there are
    named = CompressedImage(HEAD, "png", png(pixels[..., [2, 1, 0]]))
    assert UsedBits().of(named, "/color") == 12


def test_bayer_images_of_10_bits_are_scaled_as_grey_ones() -> None:
    pixels = np.full((48, 64), 500, np.uint16)
    assert UsedBits().of(raw(pixels, "bayer_rggb16"), "/color") == 9


def test_the_range_holds_while_a_view_becomes_darker_or_a_light_enters_it() -> None:
    used = UsedBits()
    pixels = counts(GREY, 10)
    assert used.of(raw(pixels, "mono16"), "/ir") == 10
    assert used.of(raw(pixels // 20, "mono16"), "/ir") == 10
    pixels[:6, :12] = 9000  # a fortieth of the view
    assert used.of(raw(pixels, "mono16"), "/ir") == 10
    assert used.scaled(pixels)[0, 0] == 255
    assert used.bits == 10


def test_the_range_grows_when_much_of_a_view_would_be_white() -> None:
    used = UsedBits()
    pixels = counts(GREY, 10)
    used.of(raw(pixels, "mono16"), "/ir")
    assert used.of(raw(2 * pixels, "mono16"), "/ir") == 11
    assert used.of(raw(pixels, "mono16"), "/ir") == 11


def test_a_hot_pixel_does_not_set_the_range() -> None:
    pixels = np.full((480, 640), 900, np.uint16)
    rows, columns = np.random.default_rng(0).integers(0, 480, (2, 150))
    pixels[rows, columns] = 65535
    assert UsedBits().of(raw(pixels, "mono16"), "/ir") == 10


def test_images_of_8_bits_and_unusable_ones_change_nothing() -> None:
    used = UsedBits()
    assert used.of(raw(RGB, "rgb8"), "/color") == 8
    np.testing.assert_array_equal(used.scaled(RGB), RGB)
    assert used.of(raw(RGB[..., 0], "mono16"), "/color") == 8  # half of its bytes are missing
    assert used.of(CompressedImage(HEAD, "mono16; png compressed", flat(b"")), "/color") == 8
    assert used.of(raw(counts(GREY, 12), "mono16"), "/color") == 12
