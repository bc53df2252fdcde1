"""Readings of an IMU wait for the next frame, and a wrong stamp costs only its own reading."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.messages.imu import ImuReading
from rgbd_glue_ros.messages.imu_queue import ImuQueue
from rgbd_glue_ros.types import NANOSECONDS

PERIOD_NS = NANOSECONDS // 200
STILL = np.zeros(3)


def stamps_left(stamps_ns: list[int], size: int = 100) -> list[int]:
    """The stamps that a frame gets after readings with these."""
    queue = ImuQueue(size, lambda: False)
    for stamp_ns in stamps_ns:
        queue.add(ImuReading(stamp_ns, STILL, STILL), stamp_ns)
    taken = [reading.stamp_ns for reading in queue.take()]
    assert (len(queue), queue.newest_ns) == (0, None)
    return taken


def test_one_stamp_in_the_future_costs_no_other_reading() -> None:
    good = [i * PERIOD_NS for i in range(10)]
    assert stamps_left([*good[:5], 3600 * NANOSECONDS, *good[5:]]) == good


def test_when_time_goes_back_only_readings_of_the_new_time_are_left() -> None:
    before = [10 * NANOSECONDS + i * PERIOD_NS for i in range(5)]
    assert stamps_left([*before, 0, PERIOD_NS]) == [0, PERIOD_NS]


def test_readings_that_are_slightly_out_of_order_are_kept() -> None:
    assert stamps_left([0, 2 * PERIOD_NS, PERIOD_NS]) == [0, 2 * PERIOD_NS, PERIOD_NS]


def test_of_more_readings_than_may_wait_the_latest_are_kept() -> None:
    assert stamps_left([i * PERIOD_NS for i in range(9)], size=3) == [
        i * PERIOD_NS for i in range(6, 9)
    ]


def test_readings_go_by_the_clock_of_the_images_even_if_that_is_known_only_later() -> None:
    images = {"by receipt": False}
    queue = ImuQueue(100, lambda: images["by receipt"])
    for i in range(3):
        queue.add(ImuReading(NANOSECONDS + i, STILL, STILL), 100 * NANOSECONDS + i)
    assert queue.newest_ns == NANOSECONDS + 2
    images["by receipt"] = True
    assert queue.newest_ns == 100 * NANOSECONDS + 2
    assert [reading.stamp_ns for reading in queue.take()] == [
        100 * NANOSECONDS + i for i in range(3)
    ]


def test_a_reading_without_a_stamp_has_the_time_of_its_receipt() -> None:
    queue = ImuQueue(100, lambda: False)
    queue.add(ImuReading(0, STILL, STILL), 7)
    assert [reading.stamp_ns for reading in queue.take()] == [7]
