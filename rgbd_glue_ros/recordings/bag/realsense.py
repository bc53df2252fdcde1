"""Bags of the RealSense viewer and SDK (ROS 1): what they hold in topics of their own.

A stream ``/device_0/sensor_0/Depth_0`` has its images in ``image/data``, its camera info in
``info/camera_info`` and its place in ``tf/0``: a ``geometry_msgs/Transform`` that maps points of a
reference, which all streams share, to the stream. The unit of depth is an option of the sensor.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.recordings.bag.file import BagFile
from rgbd_glue_ros.types import Float64

_IMAGES, _INFO, _PLACE = "/image/data", "/info/camera_info", "/tf/0"
_UNIT = "/option/Depth Units/value"


def is_realsense(depth_topic: str) -> bool:
    """Whether a topic of images is one of the SDK's."""
    return depth_topic.endswith(_IMAGES)


def depth_info_topic(depth_topic: str) -> str:
    """The topic of the depth camera's info."""
    return depth_topic.removesuffix(_IMAGES) + _INFO


def metres_per_unit(bag: BagFile, depth_topic: str) -> float | None:
    """Metres of one unit of the depth images; None where the bag does not tell."""
    sensor = depth_topic.removesuffix(_IMAGES).rpartition("/")[0]
    topic = sensor + _UNIT
    if topic not in bag.topics:
        return None
    value = float(bag.deserialize(next(bag.messages([topic]))).data)
    return value if np.isfinite(value) and value > 0 else None


def T_color_depth(bag: BagFile, color_topic: str, depth_topic: str) -> Float64:
    """The place [4, 4] of the depth camera in that of colour.

    Raises:
        InputError: the bag does not tell it.
    """
    T_color_reference, T_depth_reference = (
        _place(bag, topic.removesuffix(_IMAGES) + _PLACE) for topic in (color_topic, depth_topic)
    )
    return T_color_reference @ se3.inverse(T_depth_reference)


def _place(bag: BagFile, topic: str) -> Float64:
    if topic not in bag.topics:
        raise InputError(
            topic,
            "is not in the bag, so where the depth camera is is not known",
            "record with the RealSense viewer, or say depth_is_registered if it is",
        )
    message: SimpleNamespace = bag.deserialize(next(bag.messages([topic])))
    t, q = message.translation, message.rotation
    numbers = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
    if not (np.isfinite(numbers).all() and numbers[3:].any()):
        raise InputError(topic, "holds no transform", "check the recording")
    return se3.from_translation_quaternion(numbers[:3], numbers[3:])
