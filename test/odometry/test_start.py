"""The first keyframe of a camera that moves already when tracking starts."""

from __future__ import annotations

import numpy as np
from rigs.room import rolling_frame, true_pose

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.odometry import Odometry
from rgbd_glue_ros.parameters import Config, with_values
from rgbd_glue_ros.types import Float64

# As a Kinect's, seconds.
READOUT_TIME = 0.026
# the camera moves at half a metre and 20 degrees a second
TIMES = tuple(1.0 + np.arange(4) / 30)


def moved(time_s: float) -> Float64:
    """The true pose in the first camera's frame."""
    return se3.inverse(true_pose(TIMES[0])) @ true_pose(time_s)


def test_a_rolling_shutter_in_motion_does_not_distort_the_first_keyframe() -> None:
    known = {"spread": 0.0, "readout_time": READOUT_TIME}
    config = with_values(Config(), {f"time_offsets.{name}": value for name, value in known.items()})
    frames = [rolling_frame(time_s, READOUT_TIME, 0.0) for time_s in TIMES]
    with Odometry(config) as odometry:
        poses = [odometry.process(frame).T_odom_camera for frame in frames]
    # the second frame shows how fast the first one moved
    for time_s, pose in zip(TIMES[2:], poses[2:], strict=True):
        assert pose is not None
        error = se3.inverse(moved(time_s)) @ pose
        assert np.linalg.norm(error[:3, 3]) < 0.004
        assert np.degrees(se3.rotation_angle(error)) < 0.1
