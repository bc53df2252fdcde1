"""The results of every bag reader: messages, and where a file becomes unreadable."""

from __future__ import annotations

from dataclasses import dataclass


class DamagedError(Exception):
    """A file is unreadable from some point on."""


@dataclass(frozen=True)
class RecordedMessage:
    """A message as it is in a bag.

    Attributes:
        topic: name of the topic.
        type: for example ``sensor_msgs/msg/Image``, in ROS 1 bags too.
        stamp_ns: time of recording, nanoseconds.
        data: serialised as CDR, or in a ROS 1 bag as in ROS 1.
    """

    topic: str
    type: str
    stamp_ns: int
    data: bytes
