"""Image messages -> NumPy: colour as RGB or grey, depth in metres.

Unusable messages are refused with an ``InputError`` that names the topic, what is wrong and what to
do.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry.depth import metres_of_16_bits
from rgbd_glue_ros.messages.fields import DEPTH_UNITS_PER_METRE, CompressedImage, Image
from rgbd_glue_ros.messages.image_codecs import PNG_SIGNATURE, check_size, decode
from rgbd_glue_ros.messages.reading import reader_of
from rgbd_glue_ros.messages.rvl import decode_rvl
from rgbd_glue_ros.types import Float32, UInt8

AnyImage = Image | CompressedImage
ToEightBits = Callable[[NDArray[Any]], UInt8]
Found = TypeVar("Found")

# image_transport appends these to the image's topic
COLOR_SUFFIX, DEPTH_SUFFIX = "/compressed", "/compressedDepth"

UINT8, UINT16 = np.dtype(np.uint8), np.dtype(np.uint16)


@dataclass(frozen=True)
class _ColorEncoding:
    """The memory layout of an image.

    Attributes:
        channels: channels of a pixel, each of ``dtype``.
        to_rgb: OpenCV's code of the conversion to RGB; None if none is needed.
        dtype: uint8 or uint16.
        planes_rows: rows of data for two rows of the image; 3 if planes of colour follow the
            brightness.
        is_subsampled: whether neighbours share their colour, so that width and height must be even.
    """

    channels: int
    to_rgb: int | None
    dtype: np.dtype[Any] = UINT8
    planes_rows: int = 2
    is_subsampled: bool = False


_COLOR_ENCODINGS: Mapping[str, _ColorEncoding] = {
    "rgb8": _ColorEncoding(3, None),
    "bgr8": _ColorEncoding(3, cv2.COLOR_BGR2RGB),
    "rgba8": _ColorEncoding(4, cv2.COLOR_RGBA2RGB),
    "bgra8": _ColorEncoding(4, cv2.COLOR_BGRA2RGB),
    "mono8": _ColorEncoding(1, None),
    # OpenCV's names leave the order open; publishers that use them have OpenCV's order
    "8UC1": _ColorEncoding(1, None),
    "8UC3": _ColorEncoding(3, cv2.COLOR_BGR2RGB),
    "8UC4": _ColorEncoding(4, cv2.COLOR_BGRA2RGB),
    "rgb16": _ColorEncoding(3, None, UINT16),
    "bgr16": _ColorEncoding(3, cv2.COLOR_BGR2RGB, UINT16),
    "rgba16": _ColorEncoding(4, cv2.COLOR_RGBA2RGB, UINT16),
    "bgra16": _ColorEncoding(4, cv2.COLOR_BGRA2RGB, UINT16),
    "mono16": _ColorEncoding(1, None, UINT16),
    # ROS names a Bayer pattern by its first four pixels, OpenCV by the four that start at (1, 1)
    **{
        f"bayer_{pattern}{bits}": _ColorEncoding(1, code, dtype)
        for pattern, code in (
            ("rggb", cv2.COLOR_BayerBG2RGB),
            ("bggr", cv2.COLOR_BayerRG2RGB),
            ("gbrg", cv2.COLOR_BayerGR2RGB),
            ("grbg", cv2.COLOR_BayerGB2RGB),
        )
        for bits, dtype in ((8, UINT8), (16, UINT16))
    },
    # yuv422 of ROS is UYVY
    **{
        name: _ColorEncoding(2, cv2.COLOR_YUV2RGB_UYVY, is_subsampled=True)
        for name in ("yuv422", "uyvy")
    },
    **{
        name: _ColorEncoding(2, cv2.COLOR_YUV2RGB_YUY2, is_subsampled=True)
        for name in ("yuv422_yuy2", "yuy2", "yuyv")
    },
    "nv12": _ColorEncoding(1, cv2.COLOR_YUV2RGB_NV12, planes_rows=3, is_subsampled=True),
    "nv21": _ColorEncoding(1, cv2.COLOR_YUV2RGB_NV21, planes_rows=3, is_subsampled=True),
}

# Pixel type and units per metre (REP-118)
_DEPTH_ENCODINGS: Mapping[str, tuple[type[np.generic], int]] = {
    "16UC1": (np.uint16, DEPTH_UNITS_PER_METRE),
    "mono16": (np.uint16, DEPTH_UNITS_PER_METRE),
    "16SC1": (np.int16, DEPTH_UNITS_PER_METRE),
    "Z16": (np.uint16, DEPTH_UNITS_PER_METRE),
    "32FC1": (np.float32, 1),
    "64FC1": (np.float64, 1),
}

# Header before the PNG in a compressedDepth message: an enumerator and two quantisation parameters
_QUANTISATION = struct.Struct("<iff")

_VIDEO = re.compile(r"h\.?26[45]|hevc|vp[89]|av1", re.IGNORECASE)

# Where a PNG has its bits per channel: in its first chunk, after width and height
_PNG_BITS = len(PNG_SIGNATURE) + 16


def in_8_bits(pixels: NDArray[Any], bits: int = 16) -> UInt8:
    """Scales an image of 16 bits; one of 8 bits is returned as it is.

    Args:
        pixels: uint8 or uint16, of any shape.
        bits: how many of 16 are used: the largest value of so many is white, as are values beyond.
    """
    if pixels.dtype == UINT8:
        return pixels
    return np.asarray(cv2.convertScaleAbs(pixels, alpha=255 / (2**bits - 1)), np.uint8)


def color_from_message(msg: AnyImage, where: str, to_8_bits: ToEightBits = in_8_bits) -> UInt8:
    """The pixels of a colour or grey image.

    Args:
        msg: sensor_msgs/msg/Image or CompressedImage.
        where: its topic, for errors.
        to_8_bits: scales the pixels, uint8 or uint16.

    Returns:
        uint8 [H, W, 3] RGB or [H, W]. It shares the message's memory if no conversion is needed.

    Raises:
        InputError: it has another type or encoding, or is truncated or damaged.
    """
    return to_8_bits(pixels_of_color(msg, where))


def pixels_of_color(msg: AnyImage, where: str) -> NDArray[Any]:
    """As ``color_from_message``, but uint16 if the image has 16 bits."""
    return reader_of(_COLOR_READERS, msg, where)(msg, where)


def may_have_16_bits(msg: AnyImage) -> bool:
    """Whether a colour image has more than 8 bits, as far as that shows without decoding."""
    if hasattr(msg, "encoding"):
        return "16" in msg.encoding
    data = _bytes(msg)
    is_long_enough = len(data) > _PNG_BITS
    return "16" in msg.format or (_is_png(data) and is_long_enough and data[_PNG_BITS] == 16)


def depth_from_message(msg: AnyImage, where: str, metres_per_unit: float | None = None) -> Float32:
    """The depth of every pixel.

    Args:
        msg: sensor_msgs/msg/Image or CompressedImage (``compressedDepth`` as PNG or RVL, or a PNG).
        where: its topic, for errors.
        metres_per_unit: of the image; None follows REP-118: integers are millimetres,
            floating-point values are metres.

    Returns:
        float32 [H, W], metres, NaN where unknown.

    Raises:
        InputError: it has another type or encoding, or is truncated or damaged.
    """
    return reader_of(_DEPTH_READERS, msg, where)(msg, where, metres_per_unit)


def metres(depth: NDArray[Any], units_per_metre: float, metres_per_unit: float | None) -> Float32:
    """Depth [H, W] in metres, float32; NaN where it is not positive and finite, or overflowed.

    Args:
        depth: depth in units, any real dtype.
        units_per_metre: units per metre of the format.
        metres_per_unit: of the image, which overrides that; None for the unit of the format.
    """
    units = units_per_metre if metres_per_unit is None else 1 / metres_per_unit
    if (depth.dtype.kind, depth.dtype.itemsize) == ("u", 2):
        return metres_of_16_bits(depth, units)
    with np.errstate(invalid="ignore", over="ignore"):
        values: Float32 = np.divide(depth, np.float32(units), dtype=np.float32)
    values[~((values > 0) & (values < np.inf))] = np.nan
    return values


def holds_whole_numbers(depth: AnyImage) -> bool:
    """Whether a depth image contains integers of some unit instead of metres."""
    encoding = depth.format if hasattr(depth, "format") else depth.encoding
    return re.match("(32|64)F", encoding, re.IGNORECASE) is None


def base_name(topic: str) -> str:
    """The image's topic without what image_transport appended."""
    return topic.removesuffix(DEPTH_SUFFIX).removesuffix(COLOR_SUFFIX)


def is_named_registered(topic: str) -> bool:
    """Whether a depth topic has a name that drivers use for depth registered to colour."""
    return re.search("align|regist|_to_", topic, re.IGNORECASE) is not None


def is_rectified(topic: str) -> bool:
    """Whether an image topic has a name that image_proc uses for rectified images."""
    return re.search(r"(^|[/_])rect[^/]*$", base_name(topic)) is not None


def _color_from_image(msg: Image, where: str) -> NDArray[Any]:
    name, encoding = _encoding(msg, _COLOR_ENCODINGS, "colour", where)
    if encoding.is_subsampled and (msg.width % 2 or msg.height % 2):
        raise InputError(
            where,
            f"an image of {msg.width}x{msg.height} pixels cannot be {name}: sides must be even",
            "correct the publisher",
        )
    rows = msg.height * encoding.planes_rows // 2
    pixels = _pixels(msg, _ordered(encoding.dtype, msg), encoding.channels, rows, where)
    pixels = np.ascontiguousarray(pixels, encoding.dtype)
    if encoding.to_rgb is not None:
        pixels = np.asarray(cv2.cvtColor(pixels, encoding.to_rgb))
    return pixels


def _depth_from_image(msg: Image, where: str, metres_per_unit: float | None) -> Float32:
    _, (kind, units) = _encoding(msg, _DEPTH_ENCODINGS, "depth", where)
    pixels = _pixels(msg, _ordered(np.dtype(kind), msg), 1, msg.height, where)
    return metres(pixels, units, metres_per_unit)


def _ordered(dtype: np.dtype[Any], msg: Image) -> np.dtype[Any]:
    ordered: np.dtype[Any] = dtype.newbyteorder(">" if msg.is_bigendian else "<")
    return ordered


def _encoding(msg: Image, known: Mapping[str, Found], kind: str, where: str) -> tuple[str, Found]:
    """The name of an image's encoding, and its entry in ``known``; case is ignored."""
    wanted = msg.encoding.lower()
    for name, encoding in known.items():
        if name.lower() == wanted:
            return name, encoding
    raise InputError(
        where,
        f"encoding {msg.encoding!r} is not supported for {kind} ({', '.join(known)})",
        "choose another topic, or another format in the driver",
    )


def _pixels(msg: Image, dtype: np.dtype[Any], channels: int, rows: int, where: str) -> NDArray[Any]:
    """[rows, W] or [rows, W, channels], in the message's memory."""
    check_size(msg.width, msg.height, where)
    row = msg.width * channels * dtype.itemsize
    if msg.step < row:
        raise InputError(
            where,
            f"step is {msg.step} bytes, but a row of {msg.width} pixels {msg.encoding} has {row}",
            "correct the publisher",
        )
    # the padding of the last row may be missing
    needed = (rows - 1) * msg.step + row
    if len(msg.data) < needed:
        raise InputError(
            where,
            f"data are truncated: {len(msg.data)} bytes instead of {needed} for "
            f"{msg.width}x{msg.height} {msg.encoding}",
            "check the publisher or the recording",
        )
    shape: tuple[int, ...] = (rows, msg.width)
    strides: tuple[int, ...] = (msg.step, channels * dtype.itemsize)
    if channels > 1:
        shape, strides = (*shape, channels), (*strides, dtype.itemsize)
    pixels: NDArray[Any] = np.ndarray(shape, dtype, msg.data, strides=strides)
    return pixels


def _color_from_compressed(msg: CompressedImage, where: str) -> NDArray[Any]:
    if "compressedDepth" in msg.format:
        raise InputError(where, f"is depth ({msg.format})", "give the topic of the colour image")
    if _VIDEO.search(msg.format):
        raise InputError(
            where,
            f"is video ({msg.format}), whose images depend on earlier ones",
            "make the driver send JPEG or raw images, or republish it as those",
        )
    image = decode(_bytes(msg), where)
    is_grey, is_16_bit = image.ndim == 2, image.dtype == np.uint16
    if is_grey and is_16_bit and "mono16" not in msg.format:
        raise InputError(
            where, f"is an image of {image.dtype} ({msg.format})", "give a colour image of 8 bits"
        )
    if image.dtype not in {UINT8, UINT16}:
        raise InputError(where, f"is an image of {image.dtype}", "give a colour image of 8 bits")
    if is_grey:
        return image
    if image.shape[2] == 4:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGRA2RGB))
    # image_transport's format says this if it gave RGB to an encoder that expects BGR
    if "compressed rgb" in msg.format:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB))


def _depth_from_compressed(
    msg: CompressedImage, where: str, metres_per_unit: float | None
) -> Float32:
    data = _bytes(msg)
    is_quantised = "compressedDepth" in msg.format or _is_png(data[_QUANTISATION.size :])
    # some publishers of compressedDepth leave out the header before the PNG
    if not is_quantised or _is_png(data):
        return _decoded_depth(data, msg.format, where, metres_per_unit)
    if len(data) < _QUANTISATION.size:
        raise InputError(where, f"data are truncated: {len(data)} bytes", "check the recording")
    _, a, b = _QUANTISATION.unpack_from(data)
    coded = data[_QUANTISATION.size :]
    is_rvl = "compressedDepth rvl" in msg.format
    image = decode_rvl(coded, where) if is_rvl else _decoded(coded, msg.format, where)
    if not msg.format.startswith("32FC1"):
        return metres(image, DEPTH_UNITS_PER_METRE, metres_per_unit)
    if not (np.isfinite(a) and np.isfinite(b) and a > 0):
        raise InputError(where, f"the quantisation ({a}, {b}) is invalid", "check the publisher")
    with np.errstate(divide="ignore"):
        depth = np.float32(a) / (image.astype(np.float32) - np.float32(b))
    depth[image == 0] = np.nan
    return metres(depth, 1, metres_per_unit)


def _is_png(data: memoryview) -> bool:
    return data[: len(PNG_SIGNATURE)] == PNG_SIGNATURE


def _bytes(msg: CompressedImage) -> memoryview:
    buffer: Any = msg.data
    return memoryview(buffer)


def _decoded_depth(
    data: memoryview, image_format: str, where: str, metres_per_unit: float | None
) -> Float32:
    """The depth in an image file without quantisation."""
    image = decode(data, where)
    if image.ndim == 2 and image.dtype == np.uint16:
        return metres(image, DEPTH_UNITS_PER_METRE, metres_per_unit)
    if image.ndim == 2 and image.dtype == np.float32:
        return metres(image, 1, metres_per_unit)
    raise InputError(
        where,
        f"is a {image_format} image of {image.dtype} and shape {image.shape}, which is not depth",
        "record compressedDepth, or one channel of 16 bits",
    )


def _decoded(data: memoryview, image_format: str, where: str) -> NDArray[np.uint16]:
    image = decode(data, where)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(
            where,
            f"{image_format!r} contains an image of {image.dtype} and shape {image.shape}",
            "give depth as one channel of 16 bits",
        )
    return np.asarray(image, np.uint16)


_COLOR_READERS: Mapping[str, Callable[[Any, str], NDArray[Any]]] = {
    "Image": _color_from_image,
    "CompressedImage": _color_from_compressed,
}
_DEPTH_READERS: Mapping[str, Callable[[Any, str, float | None], Float32]] = {
    "Image": _depth_from_image,
    "CompressedImage": _depth_from_compressed,
}

IMAGE_TYPES = tuple(_COLOR_READERS)
"""Names of the message types that can be read, without their package."""
