"""Helpers of all message readers: selection by type, stamps and frames.

Messages of rclpy, rosbags and ``fields`` are read alike. Only ``fields`` is imported: in
annotations, its classes stand for any message of that type with the same fields.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeVar

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import Header, Time
from rgbd_glue_ros.types import NANOSECONDS

Reader = TypeVar("Reader")


def stamp_ns(stamp: Time) -> int:
    """A message's stamp in nanoseconds."""
    return stamp.sec * NANOSECONDS + stamp.nanosec


def frame_of(header: Header) -> str:
    """The frame that a header names; "" if it names none."""
    return plain_frame(header.frame_id)


def plain_frame(frame_id: str) -> str:
    """A frame's name as in tf2, without the leading slash of ROS 1 and its bags."""
    return frame_id.removeprefix("/")


def reader_of(readers: Mapping[str, Reader], msg: object, where: str) -> Reader:
    """The reader for a message.

    Args:
        readers: readers by the name of the type, without its package.
        msg: the message.
        where: its topic, for errors.

    Raises:
        InputError: there is no reader for its type.
    """
    return readers[check_type(readers, msg, where)]


def check_type(types: Collection[str], msg: object, where: str) -> str:
    """The name of a message's type, without its package; checks that it is one of ``types``.

    Raises:
        InputError: it is not.
    """
    # ``Image`` for both rclpy's Image and rosbags' sensor_msgs__msg__Image
    name = type(msg).__name__.rpartition("__")[2]
    if name not in types:
        raise InputError(where, f"has the type {name}", f"give a topic of {' or '.join(types)}")
    return name
