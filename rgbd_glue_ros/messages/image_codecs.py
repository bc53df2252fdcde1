"""Image files <-> arrays; damaged and absurdly large files are refused before decoding.

The format is recognised by the first bytes, since the name may be wrong.

On its own, OpenCV would fill the missing part of a truncated image with grey (before version 4.13)
and report it on stderr, and it would allocate whatever size a header claims.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.types import Float32

# Twice the largest colour image of any RGB-D camera today (Azure Kinect, 4096 x 3072).
MAX_PIXELS = 2**25

PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE = b"\xff\xd8\xff"

_EXR_SIGNATURE = b"\x76\x2f\x31\x01"
_PNM_CHANNELS = {b"P5": 1, b"P6": 3}
# Between the numbers there may be comments, which last to the end of the line
_LONGEST_PNM_HEADER = 4096
_PNM_HEADER = re.compile(rb"(P[56])" + 3 * rb"(?:\s|#[^\n]*\n)+(\d{1,9})" + rb"\s")

# Start-of-frame markers: C0 to CF without C4 (Huffman tables), C8 (reserved), CC (arithmetic)
_JPEG_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_START_OF_SCAN = 0xDA
_JPEG_END = b"\xff\xd9"

# Byte orders by the first bytes; the number types and tags that are read
_TIFF_ORDERS = {b"II*\0": "<", b"MM\0*": ">"}
_TIFF_NUMBERS = {3: "H", 4: "I"}
_WIDTH, _HEIGHT, _STRIP_STARTS, _STRIP_LENGTHS = 256, 257, 273, 279
_TIFF_TAGS = frozenset({_WIDTH, _HEIGHT, _STRIP_STARTS, _STRIP_LENGTHS})


def decode(data: bytes | memoryview, where: str) -> NDArray[Any]:
    """Decodes an image file, with its own channels and bit depth.

    Formats are PNG, JPEG, WebP, TIFF, binary PNM (``P5``, ``P6``), and EXR if OpenCV supports it.

    Args:
        data: content of the file.
        where: source of the file, for errors.

    Returns:
        uint8 or uint16, [H, W] or [H, W, 3] BGR or [H, W, 4] BGRA; TIFF and EXR also other types.

    Raises:
        InputError: the format is another one, or the image is damaged, truncated, or larger than
            ``MAX_PIXELS``.
    """
    view = memoryview(data).cast("B")
    try:
        width, height = _checker(view, where)(view)
    except (struct.error, IndexError, _DamagedError) as error:
        cause = str(error) if isinstance(error, _DamagedError) else "it is truncated"
        raise InputError(
            where,
            f"damaged image of {len(view)} bytes: {cause}",
            "check the recording or the network",
        ) from error
    check_size(width, height, where)
    if view[: len(_EXR_SIGNATURE)] == _EXR_SIGNATURE:
        # OpenCV reads EXR only if this is set before the first one
        os.environ.setdefault("OPENCV_IO_ENABLE_OPENEXR", "1")
    try:
        image = cv2.imdecode(np.frombuffer(view, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    if image is None and view[: len(_EXR_SIGNATURE)] == _EXR_SIGNATURE:
        raise InputError(
            where, "damaged, or OpenCV lacks EXR here", "convert EXR to 16-bit PNG, TIFF or NPY"
        )
    if image is None or image.shape[:2] != (height, width):
        raise InputError(where, "damaged image: it cannot be decoded", "check the recording")
    return np.asarray(image)


def check_size(width: int, height: int, where: str) -> None:
    """Refuses implausible image sizes.

    Raises:
        InputError: there are no pixels, or more than ``MAX_PIXELS``.
    """
    if not 0 < width * height <= MAX_PIXELS:
        raise InputError(
            where,
            f"an image of {width}x{height} pixels",
            f"give one with at least one and at most {MAX_PIXELS} pixels",
        )


def encode_png(image: NDArray[Any]) -> bytes:
    """A grey (uint8 or uint16) or BGR image as PNG."""
    # For depth images, run-length coding compresses like zlib's level 4 in half the time.
    options = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    _, data = cv2.imencode(".png", image, options)
    return data.tobytes()


def encode_jpeg(image: NDArray[Any], quality: int = 95) -> bytes:
    """A grey or BGR image (uint8) as JPEG; ``quality`` is libjpeg's, 1 to 100."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes()


def quantised(depth: Float32, units_per_metre: int) -> NDArray[np.uint16]:
    """Depth [H, W] in metres as 16-bit integers; 0 where it is unknown or too far."""
    with np.errstate(over="ignore"):  # too far all the same
        units = np.nan_to_num(np.rint(depth * units_per_metre), nan=0.0)
    units[(units < 0) | (units > np.iinfo(np.uint16).max)] = 0
    return units.astype(np.uint16)


class _DamagedError(Exception):
    """Says what is wrong with the bytes of an image."""


def _checker(data: memoryview, where: str) -> Callable[[memoryview], tuple[int, int]]:
    """The function that checks a file of this format and returns its width and height."""
    head = bytes(data[:16])
    if head.startswith(PNG_SIGNATURE):
        return _checked_png
    if head.startswith(JPEG_SIGNATURE):
        return _checked_jpeg
    if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
        return _checked_webp
    if head[:4] in _TIFF_ORDERS:
        return _checked_tiff
    if head.startswith(_EXR_SIGNATURE):
        return _checked_exr
    if head[:2] in _PNM_CHANNELS:
        return _checked_pnm
    raise InputError(
        where, "the data are not PNG, JPEG, WebP, TIFF, EXR or PNM", "give one of these"
    )


def _checked_png(data: memoryview) -> tuple[int, int]:
    """Width and height of a PNG; checks that all chunks are complete, with correct checksums."""
    width = height = 0
    position = len(PNG_SIGNATURE)
    kind = b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", data, position)
        (checksum,) = struct.unpack_from(">I", data, position + 8 + length)
        if zlib.crc32(data[position + 4 : position + 8 + length]) != checksum:
            raise _DamagedError(f"wrong checksum in PNG chunk {kind!r}")
        if position == len(PNG_SIGNATURE):
            if kind != b"IHDR":
                raise _DamagedError("the PNG does not start with its header")
            width, height = struct.unpack_from(">II", data, position + 8)
        position += 12 + length
    return width, height


def _checked_jpeg(data: memoryview) -> tuple[int, int]:
    """Width and height of a JPEG; checks that it has a header, a scan and an end."""
    width = height = 0
    position = 2
    marker = -1
    while marker != _JPEG_START_OF_SCAN:
        if data[position] != 0xFF:
            raise _DamagedError("a JPEG marker is missing")
        while data[position] == 0xFF:
            position += 1
        marker = data[position]
        (length,) = struct.unpack_from(">H", data, position + 1)
        if marker in _JPEG_START_OF_FRAME:
            height, width = struct.unpack_from(">HH", data, position + 4)
        position += 1 + length
    # inside a scan, 0xFF is always followed by 0 or a restart marker, so this is the real end
    if bytes(data).rfind(_JPEG_END, position) < 0:
        raise _DamagedError("the JPEG is truncated")
    return width, height


def _checked_webp(data: memoryview) -> tuple[int, int]:
    """Width and height of a WebP (RFC 9649); checks its length."""
    (length,) = struct.unpack_from("<I", data, 4)
    if len(data) < 8 + length:
        raise _DamagedError("it is truncated")
    kind = bytes(data[12:16])
    if kind == b"VP8X":
        sides = (int.from_bytes(data[at : at + 3], "little") + 1 for at in (24, 27))
    elif kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        sides = ((bits >> shift & 0x3FFF) + 1 for shift in (0, 14))
    else:
        sides = (side & 0x3FFF for side in struct.unpack_from("<HH", data, 26))
    width, height = sides
    return width, height


def _checked_exr(data: memoryview) -> tuple[int, int]:
    """Width and height of the data window in the header of an OpenEXR file."""
    position = 8
    while data[position]:
        name, position = _terminated(data, position)
        _, position = _terminated(data, position)
        (size,) = struct.unpack_from("<i", data, position)
        if name == b"dataWindow":
            left, top, right, bottom = struct.unpack_from("<4i", data, position + 4)
            return right - left + 1, bottom - top + 1
        position += 4 + max(size, 0)
    raise _DamagedError("the EXR has no size")


def _terminated(data: memoryview, start: int) -> tuple[bytes, int]:
    """The text up to the next zero byte, at most 255 bytes, and the position after it."""
    text, zero, _ = bytes(data[start : start + 256]).partition(b"\0")
    if not zero:
        raise _DamagedError("a name in the EXR has no end")
    return text, start + len(text) + 1


def _checked_pnm(data: memoryview) -> tuple[int, int]:
    """Width and height of a binary PGM or PPM; checks that no pixels are missing."""
    found = _PNM_HEADER.match(bytes(data[:_LONGEST_PNM_HEADER]))
    if found is None:
        raise _DamagedError("the PNM has no header")
    width, height, most = map(int, found.groups()[1:])
    needed = width * height * _PNM_CHANNELS[found[1]] * (2 if most > 255 else 1)
    if len(data) < found.end() + needed:
        raise _DamagedError("the PNM is truncated")
    return width, height


def _checked_tiff(data: memoryview) -> tuple[int, int]:
    """Width and height of the first image of a TIFF 6.0 file; checks that no pixels are missing."""
    order = _TIFF_ORDERS[bytes(data[:4])]
    (directory,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, directory)
    tags: dict[int, tuple[int, ...]] = {}
    for at in range(directory + 2, directory + 2 + 12 * count, 12):
        tag, kind, values = struct.unpack_from(f"{order}HHI", data, at)
        letter = _TIFF_NUMBERS.get(kind)
        if letter is None or tag not in _TIFF_TAGS:
            continue
        form = f"{order}{min(values, MAX_PIXELS)}{letter}"
        # values that do not fit into four bytes are stored elsewhere
        if struct.calcsize(form) > 4:
            (place,) = struct.unpack_from(f"{order}I", data, at + 8)
        else:
            place = at + 8
        tags[tag] = struct.unpack_from(form, data, place)
    if not {_WIDTH, _HEIGHT} <= tags.keys():
        raise _DamagedError("the TIFF has no size")
    starts, lengths = tags.get(_STRIP_STARTS, ()), tags.get(_STRIP_LENGTHS, ())
    if any(a + n > len(data) for a, n in zip(starts, lengths, strict=False)):
        raise _DamagedError("the TIFF is truncated")
    return tags[_WIDTH][0], tags[_HEIGHT][0]
