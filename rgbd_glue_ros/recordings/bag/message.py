"""What every reader of bags gives: messages, and how a file stops making sense."""

from __future__ import annotations

from dataclasses import dataclass


class DamagedError(Exception):
    """How a file stops making sense."""


@dataclass(frozen=True)
class RecordedMessage:
    """A message as it is in a bag.

    Attributes:
        topic: its name.
        type: as ``sensor_msgs/msg/Image``, in ROS 1 bags too.
        stamp_ns: time of recording, nanoseconds.
        data: serialised: CDR, in a ROS 1 bag that of ROS 1.
    """

    topic: str
    type: str
    stamp_ns: int
    data: bytes
