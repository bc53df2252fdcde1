"""How fast cameras on robots and in hands move, where no image shows their motion."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.types import Float64

UNKNOWN_SPEED = np.array([1.0] * 3 + [1.0] * 3)
"""Standard deviations of an unknown velocity, float64 [6], m/s and rad/s."""

CHANGE_OF_SPEED = np.array([1.0] * 3 + [1.5] * 3)
"""How much a camera with a usable image may change its velocity between two frames, [6]."""

FASTEST = np.array([5.0] * 3 + [10.0] * 3)
"""No camera with a usable image moves faster, [6]: it was found again elsewhere."""

LOST_COVARIANCE = np.diag(UNKNOWN_SPEED**2)
"""The covariance of a pose a second after it was lost, float64 [6, 6], m² and rad²."""

# A covariance has no digits left after a clock jump of months: no pose is off by more.
_LARGEST_LOST_COVARIANCE = np.diag([1e3] * 3 + [np.pi] * 3) ** 2


def lost_covariance(seconds: float) -> Float64:
    """The covariance of a pose that has been lost for a time, float64 [6, 6], m² and rad²."""
    covariance: Float64 = np.minimum(LOST_COVARIANCE * seconds**2, _LARGEST_LOST_COVARIANCE)
    return covariance
