"""When the frames of a recording without stamps were taken."""

from __future__ import annotations

from rgbd_glue_ros.types import NANOSECONDS

RATE_HZ = 30
"""Assumed rate of numbered images, which have no stamps."""


def frame_stamp_ns(number: int) -> int:
    """When a numbered frame was taken; from 1/30 s on, since a stamp of zero means none in ROS."""
    return (number + 1) * NANOSECONDS // RATE_HZ
