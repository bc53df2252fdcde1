"""Poses as parameters write them."""

from __future__ import annotations

import numpy as np
import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.poses import parse_pose


def test_six_numbers_are_urdfs_roll_pitch_yaw_and_seven_a_quaternion() -> None:
    six = parse_pose("camera_pose", "1 2 3 0 0 1.5707963267948966")
    seven = parse_pose("camera_pose", "1, 2, 3, 0, 0, 0.70710678, 0.70710678")
    np.testing.assert_allclose(six, seven, atol=1e-8)
    np.testing.assert_allclose(six @ [1, 0, 0, 1], [1, 3, 3, 1], atol=1e-8)


@pytest.mark.parametrize(
    "text", ["1 2 3", "a b c d e f", "0 0 0 0 0 nan", "0 0 0 0 0 0 0", "0 0 0 0 0 0 2"]
)
def test_a_pose_that_is_none_is_refused_with_the_form_it_should_have(text: str) -> None:
    with pytest.raises(InputError, match="x y z roll pitch yaw"):
        parse_pose("camera_pose", text)
