"""The upward direction, from an accelerometer."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.odometry.gyroscope import Gyroscope
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples

# The accelerations of a hand or a robot average out over this time.
_WINDOW_NS = NANOSECONDS // 2
# A mean outside this is not gravity: the sensor falls, is pushed, or uses other units; m/s².
_LEAST, _MOST = 9.81 - 1.0, 9.81 + 1.0


def up_direction(samples: ImuSamples, gyroscope: Gyroscope, stamp_ns: int) -> Float64 | None:
    """The direction away from the earth's centre, in the camera at a stamp.

    It is the direction of the mean acceleration over the preceding half second. Each sample is
    rotated to the camera's orientation at the stamp, if the gyroscope covers that time.

    Args:
        samples: IMU samples in the axes of the camera's optical frame.
        gyroscope: the calibration of the gyroscope.
        stamp_ns: stamp of an image, nanoseconds.

    Returns:
        A unit vector [3] in the camera's optical frame; None if no acceleration was measured, or
        its mean is not that of a sensor at rest.
    """
    offset_ns = round(gyroscope.time_offset * NANOSECONDS)
    recent = samples.between(stamp_ns + offset_ns - _WINDOW_NS, stamp_ns + offset_ns)
    measured = np.isfinite(recent.linear_acceleration).all(axis=1)
    if not measured.any():
        return None
    stamps_ns = recent.stamps_ns[measured] - offset_ns
    R_camera_then = gyroscope.rotations_until(samples, stamps_ns, stamp_ns)
    mean = np.einsum("nij,nj->i", R_camera_then, recent.linear_acceleration[measured])
    mean /= len(stamps_ns)
    size = float(np.linalg.norm(mean))
    return mean / size if _LEAST <= size <= _MOST else None
