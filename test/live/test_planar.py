"""A robot on wheels keeps to its plane, whatever the camera's odometry gathers beside it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.extrinsics import PlanarExtrinsics, parse_extrinsics
from rgbd_glue_ros.types import Float64

# the camera looks ahead and down, from the front of the robot
CAMERA_POSE = "0.3 0.05 0.5 0 0.3 0"


def wheeled() -> PlanarExtrinsics:
    robot = parse_extrinsics("base_footprint", CAMERA_POSE, "body", planar=True)
    assert isinstance(robot, PlanarExtrinsics)
    return robot


def on_plane(x: float, y: float, yaw: float) -> Float64:
    return se3.from_rotation_translation(
        Rotation.from_euler("z", yaw).as_matrix(), np.array([x, y, 0.0])
    )


def seen_by_camera(robot: PlanarExtrinsics, T_start_robot: Float64) -> Float64:
    """T_odom_camera of a robot that is where it is."""
    T_robot_camera = se3.inverse(robot.T_camera_child)
    T: Float64 = robot.T_camera_child @ T_start_robot @ T_robot_camera
    return T


@pytest.mark.parametrize("yaw", [0.0, 1.0, -3.0])
def test_motion_in_the_plane_is_published_as_without_the_constraint(yaw: float) -> None:
    robot, T = wheeled(), on_plane(2.0, -1.0, yaw)
    np.testing.assert_allclose(robot.pose(seen_by_camera(robot, T)), T, atol=1e-12)


def test_drift_in_height_and_tilt_is_removed() -> None:
    robot = wheeled()
    drift = se3.from_rotation_translation(
        Rotation.from_euler("ZYX", [0.0, 0.04, -0.03]).as_matrix(), np.array([0.0, 0.0, 0.2])
    )
    T = on_plane(2.0, -1.0, 0.7)
    published = robot.pose(seen_by_camera(robot, T @ drift))
    np.testing.assert_allclose(published, T, atol=1e-12)


def test_motion_stays_in_a_plane_that_the_initial_pose_tilts() -> None:
    start = se3.exp(np.array([1.0, 2.0, 3.0, 0.2, -0.1, 0.5]))
    robot = wheeled()
    T_odom_camera = seen_by_camera(robot, on_plane(1.0, 0.5, 0.3))
    moved = robot.starting_at(start)
    np.testing.assert_allclose(moved.pose(T_odom_camera), start @ on_plane(1.0, 0.5, 0.3))
    # a ramp that the robot starts on: doubt is along it
    covariance = moved.pose_covariance(T_odom_camera, np.eye(6))
    across = start[:3, 2]
    np.testing.assert_allclose(across @ covariance[:3, :3] @ across, 1e-6, rtol=1e-6)


def test_the_twist_has_only_forward_sideways_and_yaw_components() -> None:
    robot, rng = wheeled(), np.random.default_rng(0)
    camera = rng.normal(size=6)
    free = parse_extrinsics("base_footprint", CAMERA_POSE, "body").twist(camera)
    np.testing.assert_array_equal(robot.twist(camera), free * [1, 1, 0, 0, 0, 1])


def test_covariances_stay_invertible_and_are_unchanged_within_the_plane() -> None:
    robot, rng = wheeled(), np.random.default_rng(1)
    root = rng.normal(size=(6, 6)) * 1e-2
    covariance = root @ root.T
    free = parse_extrinsics("base_footprint", CAMERA_POSE, "body")
    T, kept = seen_by_camera(robot, on_plane(1.0, 0.0, 0.5)), np.ix_([0, 1, 5], [0, 1, 5])
    for planar, full in (
        (robot.pose_covariance(T, covariance), free.pose_covariance(T, covariance)),
        (robot.twist_covariance(covariance), free.twist_covariance(covariance)),
    ):
        np.testing.assert_allclose(planar[kept], full[kept], atol=1e-15)
        assert np.linalg.eigvalsh(planar).min() > 1e-9


def test_planar_without_a_robot_frame_is_refused() -> None:
    with pytest.raises(InputError, match="set frame_id"):
        parse_extrinsics("", "", "body", planar=True)
