"""Frames, covariances and twists of what is published."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.extrinsics import T_BODY_OPTICAL, Extrinsics, parse_extrinsics
from rgbd_glue_ros.messages.poses import parse_pose
from rgbd_glue_ros.types import Float64

SEEDS = st.integers(0, 2**32 - 1)


def random_transform(rng: np.random.Generator) -> Float64:
    return se3.exp(rng.uniform(-1.5, 1.5, 6))


def random_covariance(rng: np.random.Generator, scale: float) -> Float64:
    root = rng.normal(size=(6, 6)) * scale
    covariance: Float64 = root @ root.T
    return covariance


def test_a_camera_that_moves_forward_moves_along_x_of_the_odom_frame_in_body_axes() -> None:
    forward, right, down = np.eye(3)[2], np.eye(3)[0], np.eye(3)[1]
    body = Extrinsics.of_camera("body")
    for optical, in_odom in [(forward, [1, 0, 0]), (right, [0, -1, 0]), (down, [0, 0, -1])]:
        T = se3.from_rotation_translation(np.eye(3), optical)
        np.testing.assert_allclose(body.pose(T)[:3, 3], in_odom, atol=1e-15)


def test_with_optical_axes_the_published_pose_is_the_odometrys_own() -> None:
    T = random_transform(np.random.default_rng(0))
    np.testing.assert_array_equal(Extrinsics.of_camera("optical").pose(T), T)


@given(SEEDS)
def test_a_robot_frame_starts_at_the_origin_of_odom(seed: int) -> None:
    robot = Extrinsics.of_robot(random_transform(np.random.default_rng(seed)))
    np.testing.assert_allclose(robot.pose(np.eye(4)), np.eye(4), atol=1e-12)


@given(SEEDS)
def test_a_robot_can_start_anywhere_and_moves_the_same(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = Extrinsics.of_robot(random_transform(rng))
    start, T = random_transform(rng), random_transform(rng)
    moved = robot.starting_at(start)
    np.testing.assert_allclose(moved.pose(np.eye(4)), start, atol=1e-9)
    np.testing.assert_allclose(moved.pose(T), start @ robot.pose(T), atol=1e-9)


@given(SEEDS)
def test_if_up_is_known_odom_is_level_and_starts_at_the_same_place(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = Extrinsics.of_robot(random_transform(rng))
    up = rng.normal(size=3)
    up /= np.linalg.norm(up)
    level = robot.levelled(up)
    np.testing.assert_allclose(level.T_fixed_odom[:3, :3] @ up, [0, 0, 1], atol=1e-9)
    np.testing.assert_allclose(level.pose(np.eye(4))[:3, 3], 0, atol=1e-9)


@pytest.mark.parametrize(
    ("up", "ahead"),
    [
        ([0.0, -1.0, 0.0], [1.0, 0.0, 0.0]),
        ([0.0, -np.cos(0.4), -np.sin(0.4)], [np.cos(0.4), 0.0, -np.sin(0.4)]),
        ([0.6, -0.8, 0.0], [1.0, 0.0, 0.0]),
    ],
    ids=["level", "looking down by 0.4 rad", "rolled"],
)
def test_a_levelled_camera_looks_forward_along_x(up: list[float], ahead: list[float]) -> None:
    level = Extrinsics.of_camera("body").levelled(np.array(up))
    np.testing.assert_allclose(level.T_fixed_odom[:3, 2], ahead, atol=1e-12)


def test_a_camera_that_starts_upside_down_is_turned_over() -> None:
    level = Extrinsics.of_camera("body").levelled(np.array([0.0, 1.0, 0.0]))
    np.testing.assert_allclose(level.T_fixed_odom[:3, 1], [0, 0, 1], atol=1e-12)


def test_a_robot_that_turns_on_the_spot_stays_at_the_origin_while_its_camera_moves() -> None:
    # the camera looks forward from 0.3 m in front of base_link, 0.5 m above the ground
    config = parse_extrinsics("base_link", "0.3 0 0.5 0 0 0", "body")
    T_base_camera = parse_pose("", "0.3 0 0.5 0 0 0") @ T_BODY_OPTICAL
    turn = se3.exp(np.array([0, 0, 0, 0, 0, np.pi / 2]))
    T_odom_camera = se3.inverse(T_base_camera) @ turn @ T_base_camera
    assert np.linalg.norm(T_odom_camera[:3, 3]) > 0.4
    np.testing.assert_allclose(config.pose(T_odom_camera), turn, atol=1e-12)


def test_the_twist_of_a_turning_robot_has_no_linear_part_while_its_cameras_has() -> None:
    config = parse_extrinsics("base_link", "0.3 0 0.5 0 0 0", "body")
    # turning left about base_link moves the camera to its left (-x optical) at 0.3 m/s
    camera = np.array([-0.3, 0, 0, 0, -1.0, 0])
    np.testing.assert_allclose(config.twist(camera), [0, 0, 0, 0, 0, 1.0], atol=1e-12)


@given(SEEDS)
def test_the_twist_is_the_derivative_of_the_published_pose_in_the_child_frame(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = Extrinsics.of_robot(random_transform(rng))
    T_odom_camera, twist, dt = random_transform(rng), rng.normal(size=6), 1e-6
    before, after = robot.pose(T_odom_camera), robot.pose(T_odom_camera @ se3.exp(twist * dt))
    np.testing.assert_allclose(
        robot.twist(twist), se3.log(se3.inverse(before) @ after) / dt, atol=1e-5
    )


def test_the_pose_covariance_is_that_of_randomly_perturbed_poses() -> None:
    rng = np.random.default_rng(1)
    extrinsics = Extrinsics(random_transform(rng), random_transform(rng))
    T = random_transform(rng)
    covariance = random_covariance(rng, 1e-3)
    errors = rng.multivariate_normal(np.zeros(6), covariance, size=20000)
    nominal = extrinsics.pose(T)
    published = np.empty_like(errors)
    for row, error in zip(published, errors, strict=True):
        perturbed = T.copy()
        perturbed[:3, 3] += error[:3]
        perturbed[:3, :3] = se3.exp(np.r_[0, 0, 0, error[3:]])[:3, :3] @ T[:3, :3]
        moved = extrinsics.pose(perturbed)
        row[:3] = moved[:3, 3] - nominal[:3, 3]
        turned = se3.from_rotation_translation(moved[:3, :3] @ nominal[:3, :3].T, np.zeros(3))
        row[3:] = se3.log(turned)[3:]
    sampled = np.cov(published.T)
    expected = extrinsics.pose_covariance(T, covariance)
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    # the standard error of a correlation of 20,000 samples is below 0.007
    np.testing.assert_allclose(sampled / scale, expected / scale, atol=0.04)


@given(SEEDS)
def test_the_twist_covariance_is_that_of_the_linear_map_twist(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = Extrinsics.of_robot(random_transform(rng))
    root = rng.normal(size=(6, 6))
    columns = np.stack([robot.twist(column) for column in root.T])
    np.testing.assert_allclose(
        robot.twist_covariance(root @ root.T), columns.T @ columns, atol=1e-9
    )


def test_rotation_noise_of_the_camera_becomes_position_noise_of_a_robot_behind_it() -> None:
    robot = parse_extrinsics("base_link", "2 0 0 0 0 0", "body")
    yaw_only = np.zeros((6, 6))
    yaw_only[4, 4] = 0.01**2  # about the optical y axis, which points down
    published = robot.pose_covariance(np.eye(4), yaw_only)
    expected = np.zeros((6, 6))
    expected[5, 5] = 0.01**2
    expected[1, 1] = (2 * 0.01) ** 2
    expected[1, 5] = expected[5, 1] = -2 * 0.01**2
    np.testing.assert_allclose(published, expected, atol=1e-15)


def test_a_robot_frame_without_extrinsics_is_refused_instead_of_assuming_the_identity() -> None:
    with pytest.raises(InputError, match="the camera's pose in 'base_link' is unknown"):
        parse_extrinsics("base_link", "", "body")


def test_extrinsics_without_a_robot_frame_are_refused() -> None:
    with pytest.raises(InputError, match="frame_id, which is not set"):
        parse_extrinsics("", "0 0 0 0 0 0", "body")
