"""PNG and JPEG bytes <-> arrays: damaged and absurdly large ones are refused before decoding.

OpenCV alone would fill the missing part of a truncated image with grey (as versions before 4.13
do) and write about it to stderr, and it would allocate whatever size a header claims.
"""

from __future__ import annotations

import struct
import zlib
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

# Start-of-frame markers: C0 to CF without C4 (Huffman tables), C8 (reserved), CC (arithmetic)
_JPEG_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_JPEG_START_OF_SCAN = 0xDA
_JPEG_END = b"\xff\xd9"


def decode(data: bytes | memoryview, where: str) -> NDArray[Any]:
    """The image in PNG or JPEG bytes, of the channels and depth it has.

    Args:
        data: the file's content.
        where: what to name in an error.

    Returns:
        uint8 or uint16, [H, W] or [H, W, 3] BGR or [H, W, 4] BGRA.

    Raises:
        InputError: neither PNG nor JPEG, damaged, cut off, or larger than ``MAX_PIXELS``.
    """
    view = memoryview(data).cast("B")
    try:
        if view[: len(PNG_SIGNATURE)] == PNG_SIGNATURE:
            width, height = _checked_png(view)
        elif view[: len(JPEG_SIGNATURE)] == JPEG_SIGNATURE:
            width, height = _checked_jpeg(view)
        else:
            raise InputError(where, "the data are neither PNG nor JPEG", "publish one of these")
    except (struct.error, IndexError, _DamagedError) as error:
        cause = str(error) if isinstance(error, _DamagedError) else "it is cut off"
        raise InputError(
            where,
            f"damaged image of {len(view)} bytes: {cause}",
            "check the recording or the network",
        ) from error
    check_size(width, height, where)
    image = cv2.imdecode(np.frombuffer(view, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape[:2] != (height, width):
        raise InputError(where, "damaged image: it cannot be decoded", "check the recording")
    return np.asarray(image)


def check_size(width: int, height: int, where: str) -> None:
    """Refuses sizes that no camera has.

    Raises:
        InputError: no pixels, or more than ``MAX_PIXELS``.
    """
    if not 0 < width * height <= MAX_PIXELS:
        raise InputError(
            where,
            f"an image of {width}x{height} pixels",
            f"give one of at least one and at most {MAX_PIXELS} pixels",
        )


def encode_png(image: NDArray[Any]) -> bytes:
    """A grey (uint8 or uint16) or BGR image as PNG."""
    # For depth images, run-length coding is as small as zlib's level 4 in half the time.
    options = [cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    _, data = cv2.imencode(".png", image, options)
    return data.tobytes()


def encode_jpeg(image: NDArray[Any], quality: int = 95) -> bytes:
    """A grey or BGR image (uint8) as JPEG; ``quality`` is libjpeg's, 1 to 100."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return data.tobytes()


def quantised(depth: Float32, units_per_metre: int) -> NDArray[np.uint16]:
    """Depth [H, W] in metres as whole units of 16 bits; 0 where it is unknown or too far."""
    units = np.nan_to_num(np.rint(depth * units_per_metre), nan=0.0)
    units[(units < 0) | (units > np.iinfo(np.uint16).max)] = 0
    return units.astype(np.uint16)


class _DamagedError(Exception):
    """What is wrong with the bytes of an image."""


def _checked_png(data: memoryview) -> tuple[int, int]:
    """Width and height of a PNG whose chunks are all there and have the right checksums."""
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
    """Width and height of a JPEG that has a header, a scan and an end."""
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
    # 0xFF inside a scan is always followed by 0 or a restart marker: any other end is the end
    if bytes(data).rfind(_JPEG_END, position) < 0:
        raise _DamagedError("the JPEG is cut off")
    return width, height
