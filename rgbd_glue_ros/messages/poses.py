"""Messages that hold a pose -> transform."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.fields import PoseStamped
from rgbd_glue_ros.messages.reading import reader_of
from rgbd_glue_ros.types import Float64

_READERS: Mapping[str, Callable[[Any], tuple[Any, Any]]] = {
    "PoseStamped": lambda m: (m.pose.position, m.pose.orientation),
    "TransformStamped": lambda m: (m.transform.translation, m.transform.rotation),
    "Odometry": lambda m: (m.pose.pose.position, m.pose.pose.orientation),
}

POSE_TYPES = tuple(_READERS)
"""Names of the types of messages read here, without their package."""


def pose_from_message(msg: PoseStamped, where: str) -> Float64:
    """The pose [4, 4] of the body in the header's frame.

    Args:
        msg: of one of POSE_TYPES.
        where: its topic.

    Raises:
        InputError: it is of another type, or its numbers are no pose.
    """
    position, orientation = reader_of(_READERS, msg, where)(msg)
    t = np.array([position.x, position.y, position.z])
    q = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
    if not (np.isfinite(t).all() and np.isfinite(q).all() and q.any()):
        raise InputError(where, "a pose is not finite, or without direction", "correct its source")
    return se3.from_translation_quaternion(t, q)
