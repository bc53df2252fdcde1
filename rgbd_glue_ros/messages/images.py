"""Message fields -> numpy, for messages of rclpy, rosbags and ``message_fields`` alike.

None of these is imported here but the last, whose classes stand in the annotations for any
message of that type with the same fields. What cannot be used is refused with an ``InputError``
that names the topic, what is wrong and what to do.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.depth_registration import DepthCamera, registered
from rgbd_glue_ros.messages.fields import (
    DEPTH_UNITS_PER_METRE,
    CameraInfo,
    CompressedImage,
    Image,
    PoseStamped,
    Time,
)
from rgbd_glue_ros.messages.image_codecs import PNG_SIGNATURE, check_size, decode
from rgbd_glue_ros.messages.rvl import decode_rvl
from rgbd_glue_ros.types import (
    NANOSECONDS,
    CameraIntrinsics,
    Float32,
    Float64,
    RgbdFrame,
    UInt8,
)

Reader = TypeVar("Reader")

AnyImage = Image | CompressedImage


# Depth is decoded beside colour: compressed, each takes milliseconds, and neither holds the
# interpreter's lock.
@lru_cache(maxsize=1)
def _beside() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(1, thread_name_prefix="depth")


# image_transport appends these to the name of the image's topic
COLOR_SUFFIX, DEPTH_SUFFIX = "/compressed", "/compressedDepth"


@dataclass(frozen=True)
class FrameTopics:
    """Names of the topics that a frame comes from, for errors."""

    color: str
    depth: str
    info: str
    depth_info: str = "depth/camera_info"


@dataclass(frozen=True)
class _ColorEncoding:
    """Channels of 8 bits, and OpenCV's code of the conversion to RGB (None: nothing to do)."""

    channels: int
    to_rgb: int | None


_COLOR_ENCODINGS: Mapping[str, _ColorEncoding] = {
    "rgb8": _ColorEncoding(3, None),
    "bgr8": _ColorEncoding(3, cv2.COLOR_BGR2RGB),
    "rgba8": _ColorEncoding(4, cv2.COLOR_RGBA2RGB),
    "bgra8": _ColorEncoding(4, cv2.COLOR_BGRA2RGB),
    "mono8": _ColorEncoding(1, None),
    # OpenCV's names leave the order open; those who use them publish OpenCV's order
    "8UC1": _ColorEncoding(1, None),
    "8UC3": _ColorEncoding(3, cv2.COLOR_BGR2RGB),
    "8UC4": _ColorEncoding(4, cv2.COLOR_BGRA2RGB),
}

# Type of the pixels and how many units make a metre (REP-118)
_DEPTH_ENCODINGS: Mapping[str, tuple[type[np.generic], int]] = {
    "16UC1": (np.uint16, DEPTH_UNITS_PER_METRE),
    "mono16": (np.uint16, DEPTH_UNITS_PER_METRE),
    "32FC1": (np.float32, 1),
}

# Before the PNG in a compressedDepth message: an enumerator and the two quantisation parameters
_QUANTISATION = struct.Struct("<iff")

# Focal length and centre of a camera are within so many times, and above this part of, its image.
MAX_SIDES = 100.0

# How many coefficients each distortion model may have; the order is OpenCV's in both
_DISTORTION_MODELS: Mapping[str, tuple[int, ...]] = {
    "plumb_bob": (4, 5),
    "rational_polynomial": (8,),
}


def stamp_ns(stamp: Time) -> int:
    """A message's stamp in nanoseconds."""
    return stamp.sec * NANOSECONDS + stamp.nanosec


def color_from_message(msg: AnyImage, where: str) -> UInt8:
    """The pixels of a colour or grey image.

    Args:
        msg: sensor_msgs/msg/Image or CompressedImage.
        where: its topic.

    Returns:
        uint8 [H, W, 3] RGB or [H, W]. It shares the message's memory where that holds just this.

    Raises:
        InputError: it is of another type or encoding, cut off or damaged.
    """
    return _reader(_COLOR_READERS, msg, where)(msg, where)


def depth_from_message(msg: AnyImage, where: str) -> Float32:
    """The depth of every pixel.

    Args:
        msg: sensor_msgs/msg/Image or CompressedImage (``compressedDepth`` as PNG or RVL, or a PNG).
        where: its topic.

    Returns:
        float32 [H, W], metres, NaN where unknown.

    Raises:
        InputError: it is of another type or encoding, cut off or damaged.
    """
    return _reader(_DEPTH_READERS, msg, where)(msg, where)


def base_name(topic: str) -> str:
    """The image's topic without what image_transport appended."""
    return topic.removesuffix(DEPTH_SUFFIX).removesuffix(COLOR_SUFFIX)


def is_rectified(topic: str) -> bool:
    """Whether an image topic is named as image_proc names those of rectified images."""
    return re.search(r"(^|[/_])rect[^/]*$", base_name(topic)) is not None


def intrinsics_from_message(msg: CameraInfo, where: str) -> CameraIntrinsics:
    """The camera that took the image as it was published, by K and D: not rectified.

    Args:
        msg: sensor_msgs/msg/CameraInfo.
        where: its topic.

    Returns:
        The camera after cropping and binning.

    Raises:
        InputError: it is of another type, not calibrated, or of an unknown distortion model.
    """
    _check_info(msg, where)
    camera = _pinhole(np.reshape(msg.k, (3, 3)), msg, "K", where)
    return replace(camera, distortion=_distortion(msg, where))


def rectified_intrinsics_from_message(msg: CameraInfo, where: str) -> CameraIntrinsics:
    """The camera that would have taken the rectified image, by P.

    Args:
        msg: sensor_msgs/msg/CameraInfo.
        where: its topic.

    Returns:
        The camera after cropping and binning.

    Raises:
        InputError: it is of another type, or not calibrated.
    """
    _check_info(msg, where)
    return _pinhole(np.reshape(msg.p, (3, 4))[:, :3], msg, "P", where)


def pose_from_message(msg: PoseStamped, where: str) -> Float64:
    """The pose [4, 4] of the body in the header's frame.

    Args:
        msg: of one of POSE_TYPES.
        where: its topic.

    Raises:
        InputError: it is of another type, or its numbers are no pose.
    """
    position, orientation = _reader(_POSE_READERS, msg, where)(msg)
    t = np.array([position.x, position.y, position.z])
    q = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    if not (np.isfinite(t).all() and np.isfinite(q).all() and q.any()):
        raise InputError(where, "a pose is not finite, or without direction", "correct its source")
    return se3.from_translation_quaternion(t, q)


def frame_from_messages(
    color: AnyImage,
    depth: AnyImage,
    info: CameraInfo,
    topics: FrameTopics,
    depth_camera: DepthCamera | None = None,
) -> RgbdFrame:
    """The frame made of three messages.

    A registered depth image of another size than the colour image is brought to the colour
    image's, by nearest neighbours, and a camera info of another size is scaled, if the aspect is
    the same.
    Whether the images are rectified is told by the name of the colour topic: a camera info
    describes both.

    Args:
        color: sensor_msgs/msg/Image or CompressedImage.
        depth: the same.
        info: of the colour image.
        topics: where they are from.
        depth_camera: that took the depth image; None if it is registered to the colour image.

    Raises:
        InputError: one of them cannot be used, or the sizes have different aspects.
    """
    decoded = _beside().submit(depth_from_message, depth, topics.depth)
    color_pixels = color_from_message(color, topics.color)
    depth_pixels = decoded.result()
    camera = (
        rectified_intrinsics_from_message(info, topics.info)
        if is_rectified(topics.color)
        else intrinsics_from_message(info, topics.info)
    )
    camera = _sized(camera, color_pixels.shape[:2], topics.info, topics.color)
    if depth_camera is not None:
        shape = depth_pixels.shape[:2]
        taken_by = _sized(depth_camera.intrinsics, shape, topics.depth_info, topics.depth)
        depth_camera = replace(depth_camera, intrinsics=taken_by)
        depth_pixels = registered(depth_pixels, depth_camera, camera)
    elif depth_pixels.shape != color_pixels.shape[:2]:
        height, width = color_pixels.shape[:2]
        _check_aspect(depth_pixels.shape[:2], (height, width), topics.depth, topics.color)
        depth_pixels = resampled(depth_pixels, width, height)
    return RgbdFrame(
        stamp_ns=stamp_ns(color.header.stamp),
        color=color_pixels,
        depth=depth_pixels,
        intrinsics=camera,
        frame_id=color.header.frame_id,
        depth_delay_ns=stamp_ns(depth.header.stamp) - stamp_ns(color.header.stamp),
    )


def registration_doubt(color: AnyImage, depth: AnyImage, topics: FrameTopics) -> str | None:
    """Why depth may not be registered to colour, None if nothing speaks against it."""
    frames = color.header.frame_id, depth.header.frame_id
    if frames[0] == frames[1] or not all(frames):
        return None
    return (
        f"{topics.depth}: its frame is {frames[1]}, but that of {topics.color} is {frames[0]}; "
        "if depth is not registered to colour, give a topic where it is"
    )


def resampled(depth: Float32, width: int, height: int) -> Float32:
    """Depth [h, w] at ``height`` x ``width`` pixels: each takes the pixel that its centre is in.

    Depth is never averaged: a mean across an edge lies where nothing is.
    """
    rows = _nearest(depth.shape[0], height)
    columns = _nearest(depth.shape[1], width)
    nearest: Float32 = depth[rows[:, None], columns]
    return nearest


def _nearest(old: int, new: int) -> NDArray[np.int64]:
    """For each of ``new`` pixels, which of ``old`` its centre is in: floor((i + 0.5) old / new)."""
    return (2 * np.arange(new) + 1) * old // (2 * new)


def _sized(
    camera: CameraIntrinsics, shape: tuple[int, ...], where: str, image_topic: str
) -> CameraIntrinsics:
    """The camera at the resolution of its image, ``shape`` (height, width)."""
    height, width = shape
    if (camera.width, camera.height) == (width, height):
        return camera
    _check_aspect((camera.height, camera.width), shape, where, image_topic)
    return camera.scaled(width, height)


def _check_aspect(
    shape: tuple[int, ...], image_shape: tuple[int, ...], where: str, image_topic: str
) -> None:
    (height, width), (image_height, image_width) = shape, image_shape
    if round(width * image_height / image_width) != height and (
        round(height * image_width / image_height) != width
    ):
        raise InputError(
            where,
            f"is of {width}x{height} pixels, but {image_topic} of {image_width}x{image_height}",
            "give depth registered to colour, or its own camera's info, and the info of each image",
        )


def _type_name(msg: object) -> str:
    """``Image`` for rclpy's Image as for rosbags' sensor_msgs__msg__Image."""
    return type(msg).__name__.rpartition("__")[2]


def _reader(readers: Mapping[str, Reader], msg: object, where: str) -> Reader:
    name = _type_name(msg)
    if name not in readers:
        raise InputError(where, f"is of type {name}", f"give a topic of {' or '.join(readers)}")
    return readers[name]


def _color_from_image(msg: Image, where: str) -> UInt8:
    encoding = _COLOR_ENCODINGS.get(msg.encoding)
    if encoding is None:
        raise _unknown_encoding(msg.encoding, _COLOR_ENCODINGS, "colour", where)
    pixels = np.ascontiguousarray(_pixels(msg, np.dtype(np.uint8), encoding.channels, where))
    if encoding.to_rgb is None:
        return pixels
    return np.asarray(cv2.cvtColor(pixels, encoding.to_rgb), np.uint8)


def _depth_from_image(msg: Image, where: str) -> Float32:
    if msg.encoding not in _DEPTH_ENCODINGS:
        raise _unknown_encoding(msg.encoding, _DEPTH_ENCODINGS, "depth", where)
    kind, units = _DEPTH_ENCODINGS[msg.encoding]
    dtype = np.dtype(kind).newbyteorder(">" if msg.is_bigendian else "<")
    return _metres(_pixels(msg, dtype, 1, where), units)


def _unknown_encoding(
    encoding: str, known: Mapping[str, object], kind: str, where: str
) -> InputError:
    return InputError(
        where,
        f"encoding {encoding!r} is none of {kind} ({', '.join(known)})",
        "choose the topic or the driver's format accordingly",
    )


def _pixels(msg: Image, dtype: np.dtype[Any], channels: int, where: str) -> NDArray[Any]:
    """[H, W] or [H, W, channels], in the message's memory."""
    check_size(msg.width, msg.height, where)
    row = msg.width * channels * dtype.itemsize
    if msg.step < row:
        raise InputError(
            where,
            f"step is {msg.step} bytes, but a row of {msg.width} pixels {msg.encoding} has {row}",
            "correct the publisher",
        )
    # the padding of the last row may be missing
    needed = (msg.height - 1) * msg.step + row
    if len(msg.data) < needed:
        raise InputError(
            where,
            f"data are cut off: {len(msg.data)} bytes instead of {needed} for "
            f"{msg.width}x{msg.height} {msg.encoding}",
            "check the publisher or the recording",
        )
    shape: tuple[int, ...] = (msg.height, msg.width)
    strides: tuple[int, ...] = (msg.step, channels * dtype.itemsize)
    if channels > 1:
        shape, strides = (*shape, channels), (*strides, dtype.itemsize)
    pixels: NDArray[Any] = np.ndarray(shape, dtype, msg.data, strides=strides)
    return pixels


def _metres(depth: NDArray[Any], units_per_metre: float) -> Float32:
    """float32 metres; NaN where the depth is not positive and finite."""
    with np.errstate(invalid="ignore"):
        metres: Float32 = np.divide(depth, np.float32(units_per_metre), dtype=np.float32)
    metres[~((metres > 0) & (metres < np.inf))] = np.nan
    return metres


def _color_from_compressed(msg: CompressedImage, where: str) -> UInt8:
    if "compressedDepth" in msg.format:
        raise InputError(where, f"is depth ({msg.format})", "give the topic of the colour image")
    image = decode(_bytes(msg), where)
    if image.dtype != np.uint8:
        raise InputError(
            where, f"is an image of {image.dtype} ({msg.format})", "give a colour image of 8 bits"
        )
    if image.ndim == 2:
        return image
    if image.shape[2] == 4:
        return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGRA2RGB), np.uint8)
    # image_transport says so when RGB was given to an encoder that takes BGR
    if "compressed rgb" in msg.format:
        return image
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def _depth_from_compressed(msg: CompressedImage, where: str) -> Float32:
    data = _bytes(msg)
    if "compressedDepth" not in msg.format:
        if data[: len(PNG_SIGNATURE)] != PNG_SIGNATURE:
            raise InputError(
                where, f"is a {msg.format} image, which holds no depth", "record compressedDepth"
            )
        return _metres(_decoded_depth(data, msg.format, where), DEPTH_UNITS_PER_METRE)
    if len(data) < _QUANTISATION.size:
        raise InputError(where, f"data are cut off: {len(data)} bytes", "check the recording")
    _, a, b = _QUANTISATION.unpack_from(data)
    coded = data[_QUANTISATION.size :]
    is_rvl = "compressedDepth rvl" in msg.format
    image = decode_rvl(coded, where) if is_rvl else _decoded_depth(coded, msg.format, where)
    if not msg.format.startswith("32FC1"):
        return _metres(image, DEPTH_UNITS_PER_METRE)
    if not (np.isfinite(a) and np.isfinite(b) and a > 0):
        raise InputError(
            where, f"the quantisation ({a}, {b}) makes no sense", "check the publisher"
        )
    with np.errstate(divide="ignore"):
        metres = np.float32(a) / (image.astype(np.float32) - np.float32(b))
    metres[image == 0] = np.nan
    return _metres(metres, 1)


def _bytes(msg: CompressedImage) -> memoryview:
    buffer: Any = msg.data
    return memoryview(buffer)


def _decoded_depth(data: memoryview, image_format: str, where: str) -> NDArray[np.uint16]:
    image = decode(data, where)
    if image.dtype != np.uint16 or image.ndim != 2:
        raise InputError(
            where,
            f"{image_format!r} holds an image of {image.dtype} and shape {image.shape}",
            "give depth as one channel of 16 bits",
        )
    return np.asarray(image, np.uint16)


_COLOR_READERS: Mapping[str, Callable[[Any, str], UInt8]] = {
    "Image": _color_from_image,
    "CompressedImage": _color_from_compressed,
}
_DEPTH_READERS: Mapping[str, Callable[[Any, str], Float32]] = {
    "Image": _depth_from_image,
    "CompressedImage": _depth_from_compressed,
}
_INFO_READERS: Mapping[str, Callable[[Any, str], CameraIntrinsics]] = {
    "CameraInfo": intrinsics_from_message
}
_POSE_READERS: Mapping[str, Callable[[Any], tuple[Any, Any]]] = {
    "PoseStamped": lambda m: (m.pose.position, m.pose.orientation),
    "TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
    "Odometry": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
}

IMAGE_TYPES, INFO_TYPES, POSE_TYPES = (
    tuple(readers) for readers in (_COLOR_READERS, _INFO_READERS, _POSE_READERS)
)
"""Names of the types of messages read here, without their package."""


def _check_info(msg: CameraInfo, where: str) -> None:
    _reader(_INFO_READERS, msg, where)
    check_size(msg.width, msg.height, where)


def _pinhole(matrix: Float64, msg: CameraInfo, name: str, where: str) -> CameraIntrinsics:
    """The camera of ``matrix`` [3, 3], cropped and binned, without distortion."""
    if not matrix.any():
        raise InputError(
            where,
            f"{name} is all zeros: the camera is not calibrated",
            "calibrate it and give the file to its driver (camera_info_url)",
        )
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    camera = CameraIntrinsics(msg.width, msg.height, fx, fy, cx, cy)
    side = max(msg.width, msg.height)
    if not (
        np.array_equal(matrix, camera.matrix)
        and side / MAX_SIDES < min(fx, fy)
        and max(fx, fy, abs(cx), abs(cy)) < side * MAX_SIDES
    ):
        raise InputError(
            where,
            f"{name} is no camera matrix of {msg.width}x{msg.height} pixels: {matrix.tolist()}",
            "calibrate the camera again",
        )
    return _binned(_cropped(camera, msg, where), msg, where)


def _distortion(msg: CameraInfo, where: str) -> tuple[float, ...]:
    d: Float64 = np.asarray(msg.d, np.float64)
    if not np.isfinite(d).all():
        raise InputError(where, f"D holds {d.tolist()}", "calibrate the camera again")
    if not d.any():
        return ()
    if len(d) not in _DISTORTION_MODELS.get(msg.distortion_model, ()):
        raise InputError(
            where,
            f"{len(d)} coefficients of distortion model {msg.distortion_model!r} are not supported",
            f"rectify the images, or calibrate by {' or '.join(_DISTORTION_MODELS)}",
        )
    return tuple(d.tolist())


def _cropped(camera: CameraIntrinsics, msg: CameraInfo, where: str) -> CameraIntrinsics:
    roi = msg.roi
    if roi.width == 0 and roi.height == 0:
        return camera
    if (
        min(roi.width, roi.height) < 1
        or roi.x_offset + roi.width > camera.width
        or roi.y_offset + roi.height > camera.height
    ):
        raise InputError(
            where,
            f"the region of interest {roi.width}x{roi.height} at ({roi.x_offset}, {roi.y_offset}) "
            f"is not within {camera.width}x{camera.height} pixels",
            "correct the publisher",
        )
    return replace(
        camera,
        width=roi.width,
        height=roi.height,
        cx=camera.cx - roi.x_offset,
        cy=camera.cy - roi.y_offset,
    )


def _binned(camera: CameraIntrinsics, msg: CameraInfo, where: str) -> CameraIntrinsics:
    # both 0 and 1 mean no binning
    width = camera.width // max(msg.binning_x, 1)
    height = camera.height // max(msg.binning_y, 1)
    check_size(width, height, where)
    return camera.scaled(width, height)
