"""Readings of an IMU that wait for the next frame; does not depend on ROS."""

from __future__ import annotations

from collections import deque

from rgbd_glue_ros.messages.channel_queue import BACKWARD_JUMP_NS
from rgbd_glue_ros.messages.imu import ImuReading


class ImuQueue:
    """The latest readings, without those that are far ahead of a later one.

    If a reading's stamp is well before that of the previous one, time went back, as when a bag
    loops, or the previous stamp was wrong. Not thread-safe.
    """

    def __init__(self, size: int) -> None:
        """Starts empty.

        Args:
            size: readings that wait, at most; then the oldest is dropped.
        """
        self._waiting: deque[ImuReading] = deque(maxlen=size)

    def __len__(self) -> int:
        """Number of readings that wait."""
        return len(self._waiting)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the last reading, nanoseconds; None if none waits."""
        return self._waiting[-1].stamp_ns if self._waiting else None

    def add(self, reading: ImuReading) -> None:
        """Adds a reading."""
        while self._waiting and reading.stamp_ns < self._waiting[-1].stamp_ns - BACKWARD_JUMP_NS:
            self._waiting.pop()
        self._waiting.append(reading)

    def take(self) -> list[ImuReading]:
        """Removes and returns all readings, in order of arrival."""
        taken = list(self._waiting)
        self._waiting.clear()
        return taken
