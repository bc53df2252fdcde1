"""Readings of an IMU that wait for the next frame; does not depend on ROS."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace

from rgbd_glue_ros.messages.channel_queue import BACKWARD_JUMP_NS
from rgbd_glue_ros.messages.imu import ImuReading


@dataclass(frozen=True)
class _Received:
    """A reading with the stamp of its header, and when it was received, nanoseconds."""

    reading: ImuReading
    receipt_ns: int


class ImuQueue:
    """The latest readings, without those that are far ahead of a later one.

    Their stamps are of the clock that images go by, which is known only once images have arrived:
    those in the headers, or the times of receipt.

    If a reading's stamp is well before that of the previous one, time went back, as when a bag
    loops, or the previous stamp was wrong. Not thread-safe.
    """

    def __init__(self, size: int, is_by_receipt: Callable[[], bool]) -> None:
        """Starts empty.

        Args:
            size: readings that wait, at most; then the oldest is dropped.
            is_by_receipt: whether images are stamped with the time of receipt.
        """
        self._is_by_receipt = is_by_receipt
        self._waiting: deque[_Received] = deque(maxlen=size)

    def __len__(self) -> int:
        """Number of readings that wait."""
        return len(self._waiting)

    @property
    def newest_ns(self) -> int | None:
        """Stamp of the last reading, nanoseconds; None if none waits."""
        return self._stamp_ns(self._waiting[-1]) if self._waiting else None

    def add(self, reading: ImuReading, receipt_ns: int) -> None:
        """Adds a reading with the stamp of its header; 0 if it has none.

        Args:
            reading: the reading.
            receipt_ns: when it was received, nanoseconds.
        """
        received = _Received(reading, receipt_ns)
        stamp_ns = self._stamp_ns(received)
        while self._waiting and stamp_ns < self._stamp_ns(self._waiting[-1]) - BACKWARD_JUMP_NS:
            self._waiting.pop()
        self._waiting.append(received)

    def take(self) -> list[ImuReading]:
        """Removes and returns all readings, in order of arrival."""
        taken = [replace(each.reading, stamp_ns=self._stamp_ns(each)) for each in self._waiting]
        self._waiting.clear()
        return taken

    def _stamp_ns(self, received: _Received) -> int:
        if self._is_by_receipt():
            return received.receipt_ns
        return received.reading.stamp_ns or received.receipt_ns
