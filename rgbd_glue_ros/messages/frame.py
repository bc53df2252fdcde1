"""Three messages -> a frame: both images at the same size, with their camera."""

from __future__ import annotations

from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.geometry import lens
from rgbd_glue_ros.geometry.depth_registration import DepthCamera, can_project, registered
from rgbd_glue_ros.messages.camera_info import (
    check_aspect,
    intrinsics_of,
    of_image_size,
)
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.images import (
    AnyImage,
    ToEightBits,
    color_from_message,
    depth_from_message,
    in_8_bits,
)
from rgbd_glue_ros.messages.reading import frame_of, stamp_ns
from rgbd_glue_ros.messages.synchronizer import Match
from rgbd_glue_ros.types import CameraIntrinsics, Float32, RgbdFrame, UInt8


@dataclass(frozen=True)
class FrameTopics:
    """Names of the topics that a frame comes from, for errors."""

    color: str
    depth: str
    info: str
    depth_info: str = "depth/camera_info"


def frame_from_messages(
    color: AnyImage,
    depth: AnyImage,
    info: CameraInfo,
    topics: FrameTopics,
    depth_camera: DepthCamera | None = None,
    metres_per_unit: float | None = None,
    background: Executor | None = None,
    to_8_bits: ToEightBits = in_8_bits,
) -> RgbdFrame:
    """Converts three messages to a frame.

    A registered depth image of another size is resampled to that of the colour image, by nearest
    neighbours, and a camera info of another size is scaled, if the aspect ratio is the same.
    The name of the colour topic tells whether images are rectified: a camera info describes both.

    Args:
        color: sensor_msgs/msg/Image or CompressedImage.
        depth: the same.
        info: camera info of the colour image.
        topics: their topics, for errors.
        depth_camera: the camera that took the depth image; None if depth is registered to colour.
        metres_per_unit: as for ``depth_from_message``.
        background: decodes depth while this thread decodes colour. Decoding a compressed image
            takes milliseconds and releases the interpreter lock. None decodes one after the other.
        to_8_bits: as for ``color_from_message``.

    Raises:
        InputError: a message cannot be used, or the aspect ratios differ.
    """
    decode_depth = partial(depth_from_message, depth, topics.depth, metres_per_unit)
    decoded = None if background is None else background.submit(decode_depth)
    color_pixels = color_from_message(color, topics.color, to_8_bits)
    depth_pixels = decode_depth() if decoded is None else decoded.result()
    size = color_pixels.shape[0], color_pixels.shape[1]
    intrinsics = intrinsics_of(info, topics.color, topics.info)
    camera = of_image_size(intrinsics, size, topics.info, topics.color)
    if depth_camera is not None:
        color_pixels, depth_pixels, camera = registered_images(
            color_pixels, depth_pixels, camera, depth_camera, topics
        )
    else:
        depth_pixels = _of_size(depth_pixels, size, topics)
    return RgbdFrame(
        stamp_ns=stamp_ns(color.header.stamp),
        color=color_pixels,
        depth=depth_pixels,
        intrinsics=camera,
        frame_id=frame_of(color.header),
        depth_delay_ns=stamp_ns(depth.header.stamp) - stamp_ns(color.header.stamp),
    )


def _of_size(depth: Float32, size: tuple[int, int], topics: FrameTopics) -> Float32:
    """Registered depth [h, w] at the height and width of the colour image.

    Raises:
        InputError: the aspect ratios differ.
    """
    if depth.shape == size:
        return depth
    check_aspect(
        depth.shape,
        size,
        topics.depth,
        topics.color,
        "give depth registered to colour, or its own camera (--depth-calibration FILE; of the "
        "node depth_info_topic)",
    )
    height, width = size
    return resampled(depth, width, height)


def registered_images(
    color: UInt8,
    depth: Float32,
    camera: CameraIntrinsics,
    depth_camera: DepthCamera,
    topics: FrameTopics,
) -> tuple[UInt8, Float32, CameraIntrinsics]:
    """Registers depth to the colour camera.

    Args:
        color: [H, W(, 3)].
        depth: [h, w], metres, NaN where unknown.
        camera: the camera of ``color``, at its size.
        depth_camera: the camera of ``depth``, at any resolution.
        topics: topics of the images, for errors.

    Returns:
        Colour, depth [H, W] and the camera of both; colour is undistorted if depth cannot be
        projected with its lens model.

    Raises:
        InputError: ``depth`` has another aspect ratio than its camera.
    """
    taken_by = of_image_size(depth_camera.intrinsics, depth.shape, topics.depth_info, topics.depth)
    if not can_project(camera):
        color, camera = lens.undistorted(color, camera)
    return color, registered(depth, replace(depth_camera, intrinsics=taken_by), camera), camera


def frame_of_match(
    match: Match[Any],
    topics: FrameTopics,
    depth_camera: DepthCamera | None,
    metres_per_unit: float | None,
    background: Executor | None = None,
    to_8_bits: ToEightBits = in_8_bits,
) -> RgbdFrame:
    """``frame_from_messages`` of a match, with the stamps that its messages were paired by."""
    frame = frame_from_messages(
        match.color,
        match.depth,
        match.info,
        topics,
        depth_camera,
        metres_per_unit,
        background,
        to_8_bits,
    )
    return replace(frame, stamp_ns=match.stamp_ns, depth_delay_ns=match.interval_ns)


def registration_doubt(color: AnyImage, depth: AnyImage, topics: FrameTopics) -> str | None:
    """Why depth may not be registered to colour; None if nothing suggests that."""
    frames = frame_of(color.header), frame_of(depth.header)
    if frames[0] == frames[1] or not all(frames):
        return None
    return (
        f"{topics.depth}: its frame is {frames[1]}, but that of {topics.color} is {frames[0]}; "
        "if depth is not registered to colour, give a topic with registered depth (--depth-topic), "
        "or its camera (--depth-calibration FILE)"
    )


def resampled(depth: Float32, width: int, height: int) -> Float32:
    """Depth [h, w] resampled to ``height`` x ``width`` pixels, by nearest neighbours.

    Depth is never averaged: a mean across an edge is a point in empty space.
    """
    rows = _nearest(depth.shape[0], height)
    columns = _nearest(depth.shape[1], width)
    nearest: Float32 = depth[rows[:, None], columns]
    return nearest


def _nearest(old: int, new: int) -> NDArray[np.int64]:
    """For each new pixel, the old one that contains its centre: floor((i + 0.5) old / new)."""
    return (2 * np.arange(new) + 1) * old // (2 * new)
