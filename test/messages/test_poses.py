"""Poses in messages and as parameters write them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rigs.messages import HEAD

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.fields import Quaternion
from rgbd_glue_ros.messages.making import pose_stamped
from rgbd_glue_ros.messages.poses import parse_pose, pose_from_message
from rgbd_glue_ros.slam.map_check import transforms
from rgbd_glue_ros.trajectories.tum import read_tum, write_tum
from rgbd_glue_ros.types import Trajectory


def test_six_numbers_are_urdfs_roll_pitch_yaw_and_seven_a_quaternion() -> None:
    six = parse_pose("camera_pose", "1 2 3 0 0 1.5707963267948966")
    seven = parse_pose("camera_pose", "1, 2, 3, 0, 0, 0.70710678, 0.70710678")
    np.testing.assert_allclose(six, seven, atol=1e-8)
    np.testing.assert_allclose(six @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-8)


@pytest.mark.parametrize(
    "text", ["1 2 3", "a b c d e f", "0 0 0 0 0 nan", "0 0 0 0 0 0 0", "0 0 0 0 0 0 2"]
)
def test_an_invalid_pose_is_refused_with_the_expected_form(text: str) -> None:
    with pytest.raises(InputError, match="x y z roll pitch yaw"):
        parse_pose("camera_pose", text)


def test_a_pose_message_contains_the_transform() -> None:
    T = se3.exp(np.array([1.0, 2.0, 3.0, 0.3, -0.2, 0.1]))
    message = pose_stamped(T, HEAD)
    assert pose_from_message(message, "/pose") == pytest.approx(T, abs=1e-12)


@pytest.mark.parametrize("position", [np.nan, np.inf, -1e300, 1e10])
def test_a_pose_that_is_not_finite_is_refused(position: float) -> None:
    T = np.eye(4)
    T[0, 3] = position
    with pytest.raises(InputError, match=r"^/pose: a pose is not finite"):
        pose_from_message(pose_stamped(T, HEAD), "/pose")


@pytest.mark.parametrize("w", [0.0, 1e-320, 1e-20, 1e200, np.nan])
def test_a_quaternion_without_direction_is_refused(w: float) -> None:
    whole = pose_stamped(np.eye(4), HEAD)
    message = replace(whole, pose=replace(whole.pose, orientation=Quaternion(0, 0, 0, w)))
    with pytest.raises(InputError, match="has no direction"):
        pose_from_message(message, "/tf")


def test_what_is_written_of_the_farthest_start_can_be_read(tmp_path: Path) -> None:
    """An odometry moves on from there."""
    T = parse_pose("initial_pose", "1e7 -1e7 1e7 0.1 0.2 0.3")
    T[:3, 3] *= 1.5
    assert pose_from_message(pose_stamped(T, HEAD), "/pose") == pytest.approx(T, abs=1e-8)
    write_tum(tmp_path / "poses.txt", Trajectory(np.array([1]), T[np.newaxis]))
    assert read_tum(tmp_path / "poses.txt").poses[0] == pytest.approx(T, abs=1e-6)
    assert transforms({"poses": T[np.newaxis]}, "poses", 1)[0] == pytest.approx(T)
