"""IMU messages -> samples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import Imu, Vector3
from rgbd_glue_ros.messages.reading import reader_of
from rgbd_glue_ros.types import Float64, ImuSamples, Int64

_READERS: Mapping[str, Callable[[Any], tuple[Any, Any, Any, Any]]] = {
    "Imu": lambda m: (
        m.angular_velocity,
        m.angular_velocity_covariance,
        m.linear_acceleration,
        m.linear_acceleration_covariance,
    ),
}

IMU_TYPES = tuple(_READERS)
"""Names of the message types that can be read, without their package."""


@dataclass(frozen=True)
class ImuReading:
    """One measurement of an IMU, in the axes of its frame.

    Attributes:
        stamp_ns: time of the measurement, nanoseconds.
        angular_velocity: float64 [3], rad/s; NaN if it was not measured.
        linear_acceleration: float64 [3], m/s², gravity included; NaN if it was not measured.
    """

    stamp_ns: int
    angular_velocity: Float64
    linear_acceleration: Float64


def imu_reading(msg: Imu, stamp_ns: int, where: str) -> ImuReading:
    """Reads a message.

    Args:
        msg: sensor_msgs/msg/Imu.
        stamp_ns: time of the measurement, nanoseconds.
        where: its topic, for errors.

    Raises:
        InputError: it has another type, or its values are not finite.
    """
    turning, turning_covariance, pull, pull_covariance = reader_of(_READERS, msg, where)(msg)
    angular_velocity = _vector(turning, turning_covariance, where)
    acceleration = _vector(pull, pull_covariance, where)
    if not acceleration.any():
        # exact free fall: the driver has no accelerometer, but does not mark it as not measured
        acceleration = np.full(3, np.nan)
    return ImuReading(stamp_ns, angular_velocity, acceleration)


def imu_samples(readings: Sequence[ImuReading]) -> ImuSamples:
    """The readings in order of time; of readings with the same stamp, only the first."""
    if not readings:
        return ImuSamples.empty()
    stamps: Int64 = np.array([r.stamp_ns for r in readings], np.int64)
    _, first = np.unique(stamps, return_index=True)
    return ImuSamples(
        stamps[first],
        np.array([readings[i].angular_velocity for i in first]),
        np.array([readings[i].linear_acceleration for i in first]),
    )


def _vector(value: Vector3, covariance: Any, where: str) -> Float64:
    """The vector [3]; NaN if the covariance starts with -1, which means not measured."""
    if len(covariance) and covariance[0] == -1:
        return np.full(3, np.nan)
    vector = np.array([value.x, value.y, value.z], np.float64)
    if not np.isfinite(vector).all():
        raise InputError(where, "a measurement is not finite", "correct its source")
    return vector
