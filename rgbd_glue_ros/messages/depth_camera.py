"""Whether depth is registered to colour, and if not, which camera took it and from where.

A driver that registers depth gives it the colour camera's frame; other frame, other camera. Depth
of another camera needs that camera's info and its place, and is refused without: registered or
not, depth images look alike, and poses from the wrong kind are wrong without a sign of it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.messages.camera_info import intrinsics_of
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.frame import FrameTopics
from rgbd_glue_ros.messages.images import AnyImage
from rgbd_glue_ros.messages.reading import frame_of
from rgbd_glue_ros.types import CameraIntrinsics, Float64

FindTransform = Callable[[str, str], Float64 | None]
"""Gives T_target_source [4, 4] of two frames (target, source); None where it is not known."""

REGISTER_IN_DRIVER = (
    "switch registration on in the driver (realsense2_camera: align_depth.enable, and its topic "
    "aligned_depth_to_color/image_raw; orbbec_camera, astra_camera, openni2_camera: "
    "depth_registration; depthai_ros_driver: stereo.i_align_depth; azure_kinect_ros_driver: topic "
    "depth_to_rgb/image_raw), or run depth_image_proc's register node"
)


def depth_camera(
    color: AnyImage,
    depth: AnyImage,
    color_info: CameraInfo,
    depth_info: CameraInfo | None,
    find_transform: FindTransform,
    topics: FrameTopics,
    given_T_color_depth: Float64 | None = None,
) -> DepthCamera | None:
    """The camera that took a depth image; None if the image is registered to colour.

    Args:
        color: the colour image.
        depth: the depth image.
        color_info: of the colour camera.
        depth_info: of the depth camera; None if there is none.
        find_transform: gives the place of the depth camera.
        topics: where the messages are from.
        given_T_color_depth: that place [4, 4] where the user gave it; None where not.

    Raises:
        InputError: the depth image is not registered, and the depth camera or its place is not
            known.
    """
    color_frame, depth_frame = frame_of(color.header), frame_of(depth.header)
    is_one_frame = color_frame == depth_frame or not (color_frame and depth_frame)
    if depth_info is not None and frame_of(depth_info.header) not in {"", depth_frame}:
        depth_info = None  # of another image, as where one of two topics was remapped
    if depth_info is None:
        if is_one_frame:
            return None
        raise InputError(
            topics.depth,
            f"is not registered to colour: its frame is {depth_frame}, that of {topics.color} "
            f"{color_frame}",
            f"{REGISTER_IN_DRIVER}; or set depth_info_topic to the topic of the depth camera's "
            f"info (now {topics.depth_info}), to have it registered here",
        )
    intrinsics = intrinsics_of(depth_info, topics.depth, topics.depth_info)
    if is_one_frame:
        if is_same_camera(color_info, depth_info, topics):
            return None
        T = np.eye(4) if given_T_color_depth is None else given_T_color_depth
        return DepthCamera(intrinsics, T)
    T_color_depth = given_T_color_depth
    if T_color_depth is None:
        T_color_depth = find_transform(color_frame, depth_frame)
    if T_color_depth is None:
        raise InputError(
            topics.depth,
            f"is not registered to colour, and where {depth_frame} is in {color_frame} is not "
            "known",
            f"see that the driver publishes it to /tf_static, or set depth_camera_pose; or "
            f"{REGISTER_IN_DRIVER}",
        )
    return DepthCamera(intrinsics, T_color_depth)


def is_same_camera(color_info: CameraInfo, depth_info: CameraInfo, topics: FrameTopics) -> bool:
    """Whether both infos tell of one camera, at one resolution or two.

    Raises:
        InputError: one of them cannot be used.
    """
    depth = intrinsics_of(depth_info, topics.depth, topics.depth_info)
    return _is_alike(depth, intrinsics_of(color_info, topics.color, topics.info))


def registration_note(
    color: AnyImage, depth: AnyImage, taken_by: DepthCamera | None, topics: FrameTopics
) -> str | None:
    """What to tell the user of a depth camera that was found by its info alone.

    Args:
        color: the colour image.
        depth: the depth image.
        taken_by: as ``depth_camera`` found it.
        topics: where the messages are from.

    Returns:
        None where depth is registered already, or the frames tell as well that it is not.
    """
    frames = {frame_of(color.header), frame_of(depth.header)} - {""}
    if taken_by is None or len(frames) > 1:
        return None
    return (
        f"{topics.depth}: its frame is that of {topics.color}, but its camera another one by "
        f"{topics.depth_info}: depth is registered here, as from the same place; set "
        "depth_camera_pose if it is from another, or depth_is_registered if it is registered"
    )


def _is_alike(depth: CameraIntrinsics, color: CameraIntrinsics) -> bool:
    """Whether both are one camera, at one resolution or two."""
    if depth.width and color.width:
        depth = depth.scaled(color.width, color.height)
    return (
        depth.lens is color.lens
        and np.array_equal(_significant(depth), _significant(color))
        and np.allclose(depth.matrix, color.matrix, rtol=0, atol=0.01)
    )


def _significant(camera: CameraIntrinsics) -> Float64:
    return np.trim_zeros(np.array(camera.distortion), "b")
