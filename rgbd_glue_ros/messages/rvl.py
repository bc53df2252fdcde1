"""RVL, a lossless compression of depth images in compressed_depth_image_transport.

A. D. Wilson, "Fast Lossless Depth Image Compression", ISS 2017. The image is a sequence of runs:
the number of zeros, the number of non-zeros, and for each of these the difference from the previous
one. Numbers are written three bits at a time, lowest first, each with a fourth bit that says
whether more follow; these nibbles fill 32-bit words from the top.
"""

from __future__ import annotations

import struct

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.image_codecs import check_size

# Before the runs: columns and rows, as written by compressed_depth_image_transport
_SIZE = struct.Struct("<II")

_NIBBLES_PER_WORD = 8
# The longest number is a count of pixels or a difference of 17 bits.
_MAX_BITS = 33


def decode_rvl(data: bytes | memoryview, where: str) -> NDArray[np.uint16]:
    """Decodes a depth image from RVL data, which start with columns and rows.

    Args:
        data: content of a compressedDepth message after its quantisation header.
        where: source of the data, for errors.

    Returns:
        uint16 [H, W].

    Raises:
        InputError: the data are truncated or damaged, or the image is larger than any camera's.
    """
    if len(data) < _SIZE.size:
        raise InputError(
            where, f"data are truncated: {len(data)} bytes of RVL", "check the network"
        )
    width, height = _SIZE.unpack_from(data)
    check_size(width, height, where)
    usable = (len(data) - _SIZE.size) // 4
    words = np.frombuffer(data, "<u4", usable, _SIZE.size).astype(np.uint32)
    pixels = np.zeros(width * height, np.uint16)
    if not _decode(words, pixels):
        raise InputError(
            where,
            f"damaged RVL of {len(data)} bytes for {width}x{height} pixels",
            "check the recording or the network",
        )
    return pixels.reshape(height, width)


@compiled
def _number(words: NDArray[np.uint32], nibble: int) -> tuple[int, int]:
    """The number that starts at a nibble, and the start of the next; -1 if there is none."""
    number, bits = 0, 0
    while nibble < _NIBBLES_PER_WORD * len(words) and bits < _MAX_BITS:
        word = np.int64(words[nibble // _NIBBLES_PER_WORD])
        value = (word >> (28 - 4 * (nibble % _NIBBLES_PER_WORD))) & 0xF
        nibble += 1
        number |= (value & 0x7) << bits
        bits += 3
        if value < 0x8:
            return number, nibble
    return -1, nibble


@compiled
def _decode(words: NDArray[np.uint32], pixels: NDArray[np.uint16]) -> bool:
    """Fills ``pixels``, which must be zero; returns whether the words encode exactly as many."""
    pixel = nibble = previous = 0
    while pixel < len(pixels):
        zeros, nibble = _number(words, nibble)
        nonzeros, nibble = _number(words, nibble)
        if zeros < 0 or nonzeros < 0 or zeros + nonzeros == 0:
            return False
        pixel += zeros
        if pixel + nonzeros > len(pixels):
            return False
        for _ in range(nonzeros):
            # differences alternate in sign: 0, -1, 1, -2, 2 ...
            folded, nibble = _number(words, nibble)
            if folded < 0:
                return False
            previous += (folded >> 1) ^ -(folded & 1)
            pixels[pixel] = previous & 0xFFFF
            pixel += 1
    return pixel == len(pixels)
