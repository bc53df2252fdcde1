"""Whether depth is registered to colour, and if not, which camera took it and from where.

A driver that registers depth gives it the colour camera's frame; another frame means another
camera. Depth of another camera needs that camera's info and pose, and is refused without them:
registered or not, depth images look alike, and nothing would show that poses are wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.messages.camera_info import intrinsics_of
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.frame import FrameTopics
from rgbd_glue_ros.messages.images import AnyImage, is_named_registered
from rgbd_glue_ros.messages.reading import frame_of
from rgbd_glue_ros.types import CameraIntrinsics, Float64

FindTransform = Callable[[str, str], Float64 | None]
"""Returns T_target_source [4, 4] of two frames (target, source); None if it is unknown."""

REGISTER_IN_DRIVER = (
    "enable registration in the driver (realsense2_camera: align_depth.enable, and its topic "
    "aligned_depth_to_color/image_raw; orbbec_camera, astra_camera, openni2_camera: "
    "depth_registration; depthai_ros_driver: stereo.i_align_depth; azure_kinect_ros_driver: topic "
    "depth_to_rgb/image_raw), or run depth_image_proc's register node"
)
_IF_REGISTERED = "if it is registered nevertheless, set depth_is_registered"


@dataclass(frozen=True)
class GivenDepthCamera:
    """What the user has specified about the depth camera.

    Attributes:
        T_color_depth: its pose in the colour camera, float64 [4, 4]; None if not specified.
        is_info_chosen: whether the user named the topic of its info; then that info always counts.
    """

    T_color_depth: Float64 | None = None
    is_info_chosen: bool = False


NOTHING_GIVEN = GivenDepthCamera()


@dataclass(frozen=True)
class FoundDepthCamera:
    """The camera that took a depth image.

    Attributes:
        camera: the camera; None if the image is registered to colour.
        note: a warning about how it was determined; None if everything agrees.
    """

    camera: DepthCamera | None
    note: str | None = None


def find_depth_camera(
    color: AnyImage,
    depth: AnyImage,
    color_info: CameraInfo,
    depth_info: CameraInfo | None,
    find_transform: FindTransform,
    topics: FrameTopics,
    given: GivenDepthCamera = NOTHING_GIVEN,
) -> FoundDepthCamera:
    """Determines the camera that took a depth image from frames, infos and the user's input.

    Args:
        color: the colour image.
        depth: the depth image.
        color_info: info of the colour camera.
        depth_info: info of the depth camera; None if there is none.
        find_transform: looks up the pose of the depth camera.
        topics: topics of the messages, for errors.
        given: what the user has specified.

    Raises:
        InputError: the depth image is not registered, and the depth camera or its pose is unknown.
    """
    color_frame, depth_frame = frame_of(color.header), frame_of(depth.header)
    if depth_info is not None and frame_of(depth_info.header) not in {"", depth_frame}:
        depth_info = None  # of another image, for example if only one of two topics was remapped
    if color_frame == depth_frame or not (color_frame and depth_frame):
        return _in_one_frame(color_info, depth_info, topics, given)
    if depth_info is None:
        raise InputError(
            topics.depth,
            f"is not registered to colour: its frame is {depth_frame}, that of {topics.color} "
            f"{color_frame}",
            f"{REGISTER_IN_DRIVER}; or name the depth camera's info (depth_info_topic, now "
            f"{topics.depth_info}); {_IF_REGISTERED}",
        )
    intrinsics = intrinsics_of(depth_info, topics.depth, topics.depth_info)
    T_color_depth = given.T_color_depth
    if T_color_depth is None:
        T_color_depth = find_transform(color_frame, depth_frame)
    if T_color_depth is None:
        raise InputError(
            topics.depth,
            f"is not registered to colour, and the pose of {depth_frame} in {color_frame} is "
            "unknown",
            f"make the driver publish it on /tf_static, or set depth_camera_pose; or "
            f"{REGISTER_IN_DRIVER}; {_IF_REGISTERED}",
        )
    return FoundDepthCamera(DepthCamera(intrinsics, T_color_depth))


def _in_one_frame(
    color_info: CameraInfo,
    depth_info: CameraInfo | None,
    topics: FrameTopics,
    given: GivenDepthCamera,
) -> FoundDepthCamera:
    """The camera of depth in the frame of colour, from its info if that is to be believed."""
    if depth_info is None:
        return FoundDepthCamera(None)
    try:
        intrinsics = intrinsics_of(depth_info, topics.depth, topics.depth_info)
    except InputError as error:
        if given.is_info_chosen:
            raise
        note = f"{error.where}: {error.cause}; {topics.depth} is assumed registered to colour"
        return FoundDepthCamera(None, note)
    color = intrinsics_of(color_info, topics.color, topics.info)
    is_alike = _is_alike(intrinsics, color)
    if is_alike and _is_same_view(intrinsics, color):
        return FoundDepthCamera(None)
    # some drivers send the depth camera's info beside registered depth
    if is_named_registered(topics.depth) and not given.is_info_chosen:
        note = (
            f"{topics.depth}: registered to colour according to its name, but of another camera "
            f"according to {topics.depth_info}; it is assumed to be registered. If it is not, name "
            "its info (depth_info_topic, on the command line --depth-info-topic)"
        )
        return FoundDepthCamera(None, note)
    if given.T_color_depth is not None or is_alike:
        T = np.eye(4) if given.T_color_depth is None else given.T_color_depth
        return FoundDepthCamera(DepthCamera(intrinsics, T))
    note = (
        f"{topics.depth}: its frame is that of {topics.color}, but its camera is another one "
        f"according to {topics.depth_info}: depth is registered here, for cameras in the same "
        "place; set depth_camera_pose if they are not, or depth_is_registered if it is registered"
    )
    return FoundDepthCamera(DepthCamera(intrinsics, np.eye(4)), note)


def is_same_camera(color_info: CameraInfo, depth_info: CameraInfo, topics: FrameTopics) -> bool:
    """Whether both infos describe the same camera, possibly at different resolutions.

    Raises:
        InputError: one of them cannot be used.
    """
    depth = intrinsics_of(depth_info, topics.depth, topics.depth_info)
    return _is_alike(depth, intrinsics_of(color_info, topics.color, topics.info))


def _is_alike(depth: CameraIntrinsics, color: CameraIntrinsics) -> bool:
    """Whether both are the same camera, possibly at different resolutions.

    The matrix decides, since no two cameras have the same one: drivers omit the distortion
    coefficients for registered depth.
    """
    if depth.width and color.width:
        depth = depth.scaled(color.width, color.height)
    of_depth, of_color = _significant(depth), _significant(color)
    is_one_lens = depth.lens is color.lens and np.array_equal(of_depth, of_color)
    if not is_one_lens and len(of_depth) and len(of_color):
        return False
    return bool(np.allclose(depth.matrix, color.matrix, rtol=0, atol=0.01))


def _is_same_view(depth: CameraIntrinsics, color: CameraIntrinsics) -> bool:
    """Whether images of both have the same aspect ratio, which they do unless one was squeezed."""
    if not (depth.width and color.width):
        return True
    return abs(depth.width * color.height - color.width * depth.height) <= max(
        depth.width, color.width
    )


def _significant(camera: CameraIntrinsics) -> Float64:
    return np.trim_zeros(np.array(camera.distortion), "b")
