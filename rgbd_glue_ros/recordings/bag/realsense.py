"""Bags of the RealSense viewer and SDK: the content of their own topics.

A stream ``/device_0/sensor_0/Depth_0`` has its images in ``image/data``. Its camera info is in
``info/camera_info`` (ROS 1), or as text in ``camera_info`` (ROS 2). Its place is in ``tf/0``, as a
``geometry_msgs/Transform`` (ROS 1), or as text in ``tf/ref_0`` (ROS 2), whose last number is that
of a reference which streams share. The unit of depth is an option of the sensor.

The place maps points of the reference to the stream: the SDK's recorder stores what
``device::get_extrinsics`` fetches from the reference to the stream, ``rs2_extrinsics`` maps points
of the first to the second, and its ROS 2 recorder inverts it for ``/tf_static``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.camera_info import intrinsics_from_message
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.making import header
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.types import CameraIntrinsics, Float64

_IMAGES, _INFO, _TEXT_INFO, _PLACES = "/image/data", "/info/camera_info", "/camera_info", "/tf/"
_UNITS = ("/option/Depth Units/value", "/option/Depth_Units/value")


def is_realsense(image_topic: str) -> bool:
    """Whether a topic of images is one of the SDK's."""
    return image_topic.endswith(_IMAGES)


def info_topic(image_topic: str) -> str:
    """The topic of a stream's camera info."""
    return _stream(image_topic) + _INFO


def camera_in_text(bag: BagFile, image_topic: str) -> CameraIntrinsics | None:
    """The camera of a stream if the bag contains it as text; otherwise None.

    Raises:
        InputError: the text is not a camera.
    """
    topic = _stream(image_topic) + _TEXT_INFO
    if topic not in bag.topics or not _is_text(bag, topic):
        return None
    values = _values(bag.first(topic).data)
    try:
        fx, fy, cx, cy = (float(values[name]) for name in ("fx", "fy", "ppx", "ppy"))
        info = CameraInfo(
            header=header(0, ""),
            height=int(values["height"]),
            width=int(values["width"]),
            distortion_model=values["model"],
            d=_numbers(values["coeffs"]),
            k=np.array([fx, 0, cx, 0, fy, cy, 0, 0, 1]),
            r=np.eye(3).ravel(),
            p=np.zeros(12),
        )
    except (KeyError, ValueError) as error:
        raise InputError(
            topic, f"holds no valid camera ({error})", "give --calibration FILE"
        ) from error
    return intrinsics_from_message(info, topic)


def metres_per_unit(bag: BagFile, depth_topic: str) -> float | None:
    """Metres per unit of the depth images; None if the bag does not say.

    Raises:
        InputError: it cannot be read.
    """
    sensor = _stream(depth_topic).rpartition("/")[0]
    topic = next((sensor + unit for unit in _UNITS if sensor + unit in bag.topics), None)
    if topic is None:
        return None
    message = bag.first(topic)
    try:
        value = float(message.data)
    except (AttributeError, TypeError, ValueError) as error:
        raise InputError(
            topic, f"holds no valid unit of depth ({error})", "give --depth-scale M"
        ) from error
    return value if np.isfinite(value) and value > 0 else None


def T_color_depth(bag: BagFile, color_topic: str, depth_topic: str) -> Float64:
    """The pose [4, 4] of the depth camera in that of colour.

    Raises:
        InputError: the bag does not contain it.
    """
    color, depth = (_stream(topic) + _PLACES for topic in (color_topic, depth_topic))
    references = [
        topic.removeprefix(color)
        for topic in bag.topics
        if topic.startswith(color) and depth + topic.removeprefix(color) in bag.topics
    ]
    if not references:
        # some recordings lack it, such as those of the L515 by SDK 2.36
        raise InputError(
            bag.path,
            f"does not contain the pose of the depth camera ({depth}0 and {color}0)",
            "give --set depth_camera_pose='x y z roll pitch yaw', as rs-enumerate-devices -c "
            "prints it (about 0.015 0 0 0 0 0 for a D400), or --set depth_is_registered=true if "
            "the depth is registered to colour",
        )
    T_color_reference, T_depth_reference = (
        _place(bag, stream + references[0]) for stream in (color, depth)
    )
    return T_color_reference @ se3.inverse(T_depth_reference)


def _is_text(bag: BagFile, topic: str) -> bool:
    return bag.topics[topic].type.rpartition("/")[2] == "String"


def _stream(image_topic: str) -> str:
    return image_topic.removesuffix(_IMAGES)


def _place(bag: BagFile, topic: str) -> Float64:
    """The transform [4, 4] from the reference to the stream."""
    message = bag.first(topic)
    try:
        T = _of_text(message.data) if _is_text(bag, topic) else _of_transform(message)
    except (AttributeError, KeyError, ValueError) as error:
        raise InputError(
            topic, f"holds no valid transform ({error})", "check the recording"
        ) from error
    return T


def _of_transform(message: Any) -> Float64:
    t, q = message.translation, message.rotation
    numbers = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
    if not (np.isfinite(numbers).all() and numbers[3:].any()):
        raise ValueError(numbers.tolist())
    return se3.from_translation_quaternion(numbers[:3], numbers[3:])


def _of_text(text: str) -> Float64:
    values = _values(text)
    # the SDK writes rotations by columns
    R = _numbers(values["rotation"]).reshape(3, 3).T
    t = _numbers(values["translation"])
    if not (np.isfinite(t).all() and np.allclose(R @ R.T, np.eye(3), atol=1e-3)):
        raise ValueError(text)
    return se3.from_rotation_translation(R, t)


def _values(text: str) -> Mapping[str, str]:
    """The values in a text of the SDK: ``name=value;name=value``."""
    pairs = (part.partition("=") for part in text.split(";"))
    return {name.strip(): value.strip() for name, _, value in pairs}


def _numbers(text: str) -> Float64:
    numbers: Float64 = np.array([float(word) for word in text.split(",")])
    return numbers
