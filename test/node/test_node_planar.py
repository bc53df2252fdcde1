"""A robot on wheels that drives through a room, over real DDS: it keeps to its plane."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from rigs.room import view_after
from scipy.spatial.transform import Rotation

from rgbd_glue_ros.experiments.demo.node_process import NodeProcess, ros_environment
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL
from rgbd_glue_ros.messages.poses import parse_pose, pose_from_message
from rgbd_glue_ros.types import NANOSECONDS, Float64

pytest.importorskip("rclpy", reason="ROS is not installed")

from rigs.ros import Rig

PERIOD_NS = NANOSECONDS // 10
# the camera looks down a little from the front of the robot
CAMERA_POSE = "0.2 0 0.5 0 0.3 0"
ROUGHLY_EXACT = 1e-12


def on_plane(x: float, y: float, yaw: float) -> Float64:
    """T_start_robot after a drive."""
    R = Rotation.from_euler("z", yaw).as_matrix()
    return se3.from_rotation_translation(R, np.array([x, y, 0.0]))


DRIVE = [on_plane(0.03 * i, 0.002 * i**2, 0.02 * i) for i in range(8)]


@pytest.mark.slow
def test_a_wheeled_robot_is_published_in_its_plane(ros_domain: int) -> None:
    parameters = {"frame_id": "base_footprint", "camera_pose": f"'{CAMERA_POSE}'", "planar": True}
    T_robot_camera = parse_pose("", CAMERA_POSE) @ T_BODY_OPTICAL
    with NodeProcess(parameters, ros_environment(ros_domain)) as node, Rig(ros_domain) as rig:
        rig.wait_until_matched()
        for i, T_start_robot in enumerate(DRIVE):
            T_first_camera = se3.inverse(T_robot_camera) @ T_start_robot @ T_robot_camera
            pose = rig.pose_of(view_after(T_first_camera, (1 + i) * PERIOD_NS))
            published = pose_from_message(pose, "pose")
            assert abs(published[2, 3]) < ROUGHLY_EXACT
            np.testing.assert_allclose(published[2, :3], [0, 0, 1], atol=ROUGHLY_EXACT)
            np.testing.assert_allclose(published, T_start_robot, atol=0.01)
        rig.wait(lambda: len(rig.odoms) == len(DRIVE) - 1, "odom")
        sys.stdout.write("\n".join(node.lines))  # shown when the test fails
    odom = rig.odoms[-1]
    twist = odom.twist.twist
    assert (twist.linear.z, twist.angular.x, twist.angular.y) == (0.0, 0.0, 0.0)
    assert 0.1 < twist.linear.x < 0.5
    for covariance in (odom.pose.covariance, odom.twist.covariance):
        # robot_localization inverts it
        assert np.linalg.eigvalsh(np.reshape(covariance, (6, 6))).min() > 0
