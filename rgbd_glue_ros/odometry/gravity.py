"""Which way is up, from an accelerometer."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.gyroscope import Gyroscope
from rgbd_glue_ros.types import NANOSECONDS, Float64, ImuSamples

# The accelerations of a hand or a robot average out over this time.
_WINDOW_NS = NANOSECONDS // 2
# A mean outside this is not gravity: the sensor falls, is pushed, or uses other units; m/s².
_LEAST, _MOST = 9.81 - 1.0, 9.81 + 1.0


def up_direction(samples: ImuSamples, gyroscope: Gyroscope, stamp_ns: int) -> Float64 | None:
    """The direction away from the earth's centre at a stamp of the camera.

    It is that of the mean acceleration of the preceding time, with each sample rotated to the
    camera's orientation at the stamp, as far as the gyroscope covers that.

    Args:
        samples: in the axes of the camera's optical frame.
        gyroscope: what is known about it.
        stamp_ns: of an image, nanoseconds.

    Returns:
        A unit vector [3] in the camera's optical frame; None if no acceleration was measured, or
        not that of a sensor at rest.
    """
    offset_ns = round(gyroscope.time_offset * NANOSECONDS)
    recent = samples.between(stamp_ns + offset_ns - _WINDOW_NS, stamp_ns + offset_ns)
    accelerations = []
    for at_ns, acceleration in zip(recent.stamps_ns, recent.linear_acceleration, strict=True):
        turn = gyroscope.turn(samples, int(at_ns) - offset_ns, stamp_ns)
        back = np.zeros(3) if turn is None else -turn.rotation_vector
        R_camera_then = se3.exp(np.concatenate([np.zeros(3), back]))[:3, :3]
        if np.isfinite(acceleration).all():
            accelerations.append(R_camera_then @ acceleration)
    if not accelerations:
        return None
    mean = np.mean(accelerations, axis=0)
    size = float(np.linalg.norm(mean))
    return mean / size if _LEAST <= size <= _MOST else None
