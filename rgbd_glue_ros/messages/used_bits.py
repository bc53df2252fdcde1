"""How many bits of 16 the images of a camera use: infrared has 10 to 12.

Scaled by the full range of 16 bits to 8, their texture would vanish in a few levels. Scaled by each
image's own range, a surface would change its brightness from image to image. So the range is that
of the first image, to the next power of two, and it only grows.
"""

from __future__ import annotations

from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.images import (
    UINT16,
    AnyImage,
    in_8_bits,
    may_have_16_bits,
    pixels_of_color,
)
from rgbd_glue_ros.types import UInt8

# The range holds all values of the first image but so many: hot pixels, and those that sparkle.
_OUTLIERS = 0.001
# It grows when more values than these are beyond it: they would be white. Growing with the first
# one would halve the brightness against that of the keyframes although the view is as bright as
# before; when this many are white, the view is brighter, and part of that is made up for.
_MOST_WHITE = 0.05
FEWEST_BITS = 8
"""With fewer, 8 bits would hold the values as they are."""
# Every so many rows and columns are looked at.
_STRIDE = 4


class UsedBits:
    """The number of bits that the images of a run use, given in their order.

    Each image is given once: to ``scaled``, or to ``of`` if it is to be decoded elsewhere.

    Attributes:
        bits: of the images so far; 8 before the first image with more.
    """

    def __init__(self) -> None:
        self.bits = FEWEST_BITS
        self._has_seen_any = False

    def scaled(self, pixels: NDArray[Any]) -> UInt8:
        """Scales the next image, uint8 or uint16, by the bits used so far and by itself."""
        if pixels.dtype == UINT16:
            self._look(pixels)
        return in_8_bits(pixels, self.bits)

    def of(self, msg: AnyImage, where: str) -> int:
        """The bits to scale an image by, after a look at it; those of 8 bits are not looked at.

        Args:
            msg: a colour or grey image, the next of the run.
            where: its topic.
        """
        if not may_have_16_bits(msg):
            return self.bits
        with suppress(InputError):  # reported where it becomes a frame
            self._look(pixels_of_color(msg, where))
        return self.bits

    def _look(self, pixels: NDArray[Any]) -> None:
        beyond = _MOST_WHITE if self._has_seen_any else _OUTLIERS
        self._has_seen_any = True
        self.bits = max(self.bits, bits_of(pixels, beyond))


def bits_of(pixels: NDArray[Any], beyond: float = _OUTLIERS) -> int:
    """The number of bits that hold all values but the given share of the largest ones."""
    values = pixels[::_STRIDE, ::_STRIDE].ravel()
    place = int((values.size - 1) * (1 - beyond))
    return int(np.partition(values, place)[place]).bit_length()
