"""Poses in messages and in parameters -> transforms."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.fields import PoseStamped
from rgbd_glue_ros.messages.reading import reader_of
from rgbd_glue_ros.parameters import POSE
from rgbd_glue_ros.types import Float64
from rgbd_glue_ros.types.checks import FARTHEST_READ_M

# Quaternions should have unit length; one with all elements below this has no direction.
_SHORTEST = 1e-3

_READERS: Mapping[str, Callable[[Any], tuple[Any, Any]]] = {
    "PoseStamped": lambda m: (m.pose.position, m.pose.orientation),
    "TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
    "Odometry": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
}

POSE_TYPES = tuple(_READERS)
"""Names of the message types that can be read, without their package."""


def pose_from_message(msg: PoseStamped, where: str) -> Float64:
    """The pose [4, 4] of the body in the header's frame.

    Args:
        msg: a message of one of POSE_TYPES.
        where: its topic, for errors.

    Raises:
        InputError: it has another type, or its values are not a pose.
    """
    position, orientation = reader_of(_READERS, msg, where)(msg)
    t = np.array([position.x, position.y, position.z])
    q = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    is_far = not np.abs(t).max() < FARTHEST_READ_M  # a comparison with NaN is false too
    if is_far or not _SHORTEST < np.abs(q).max() < 1 / _SHORTEST:
        raise InputError(
            where,
            f"a pose is not finite, has no direction, or is farther than {FARTHEST_READ_M:.0e} m",
            "correct its source",
        )
    return se3.from_translation_quaternion(t, q)


def parse_pose(where: str, text: str) -> Float64:
    """Parses a transform [4, 4] from ``x y z roll pitch yaw`` or ``x y z qx qy qz qw``.

    Args:
        where: name of the parameter, for errors.
        text: numbers separated by blanks or commas, metres and radians; roll, pitch and yaw are
            rotations about fixed axes in this order, as in URDF.

    Raises:
        InputError: not six or seven finite numbers, or the quaternion does not have unit length.
    """
    fault = POSE.fault(text)
    if fault:
        raise InputError(where, fault, f"give {POSE.allowed}")
    numbers = np.array([float(word) for word in text.replace(",", " ").split()])
    position, orientation = numbers[:3], numbers[3:]
    if orientation.size == 3:
        return se3.from_rotation_translation(
            Rotation.from_euler("xyz", orientation).as_matrix(), position
        )
    return se3.from_translation_quaternion(position, orientation)


def pose_parameter(name: str, text: str) -> Float64 | None:
    """The transform [4, 4] of a parameter, read by ``parse_pose``; None if it is empty.

    Raises:
        InputError: it cannot be read.
    """
    return parse_pose(name, text) if text else None
