"""What all readers of messages share: who reads a type, and what a header says.

Messages of rclpy, rosbags and ``fields`` are read alike; of these only the last are imported,
whose classes stand in the annotations for any message of that type with the same fields.
"""

from __future__ import annotations

from collections.abc import Mapping
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
    """A frame's name as tf2 has it: ROS 1 began names with a slash, and its bags still do."""
    return frame_id.removeprefix("/")


def reader_of(readers: Mapping[str, Reader], msg: object, where: str) -> Reader:
    """Who reads a message.

    Args:
        readers: by the name of the type, without its package.
        msg: the message.
        where: its topic.

    Raises:
        InputError: nobody does.
    """
    # ``Image`` for rclpy's Image as for rosbags' sensor_msgs__msg__Image
    name = type(msg).__name__.rpartition("__")[2]
    if name not in readers:
        raise InputError(where, f"is of type {name}", f"give a topic of {' or '.join(readers)}")
    return readers[name]
