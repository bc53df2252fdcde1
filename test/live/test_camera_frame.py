"""Images of another camera are noticed, and one image that is mislabelled changes nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from rigs.scenes import VGA_HALVED

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.live.camera_frame import CameraFrame, explain_moved_camera
from rgbd_glue_ros.types import RgbdFrame


def test_one_frame_of_another_camera_is_refused_and_a_second_one_in_a_row_accepted() -> None:
    camera = CameraFrame()
    assert camera.changes_to("left") is None
    with pytest.raises(
        InputError, match="names the camera frame 'right', the images before 'left'"
    ):
        camera.changes_to("right")
    assert camera.changes_to("left") is None
    with pytest.raises(InputError):
        camera.changes_to("right")
    assert camera.changes_to("right") == "left"
    assert camera.changes_to("right") is None


def test_the_first_camera_name_after_images_without_one_is_no_other_camera() -> None:
    camera = CameraFrame()
    assert camera.changes_to("") is None
    assert camera.changes_to("left") is None
    with pytest.raises(InputError, match="the images before 'left'"):
        camera.changes_to("right")
    assert camera.changes_to("right") == "left"


def test_of_two_alternating_cameras_one_is_refused() -> None:
    camera = CameraFrame()
    assert camera.changes_to("left") is None
    for _ in range(5):
        with pytest.raises(InputError):
            camera.changes_to("right")
        assert camera.changes_to("left") is None


@pytest.mark.parametrize(
    ("twist", "said"),
    [
        ((0.001, 0, 0, 0, 0, 0.002), None),
        ((0.03, 0, 0, 0, 0, 0), "by 0.030 m and 0.0 degrees"),
        ((0, 0, 0, 0, 0.1, 0), "by 0.000 m and 5.7 degrees"),
    ],
)
def test_a_camera_that_moves_on_its_robot_is_reported_with_the_distance(
    twist: tuple[float, ...], said: str | None
) -> None:
    T = se3.exp(np.array([0.2, 0, 0.5, 0, 0.3, 0]))
    explained = explain_moved_camera(T, T @ se3.exp(np.array(twist, np.float64)))
    assert explained is None if said is None else explained and said in explained


def test_images_without_a_camera_name_belong_to_the_last_camera() -> None:
    camera = CameraFrame()
    image, depth = np.zeros((240, 320), np.uint8), np.ones((240, 320), np.float32)
    unnamed = RgbdFrame(0, image, depth, VGA_HALVED)
    assert camera.named(unnamed).frame_id == ""
    assert camera.changes_to("left") is None
    assert camera.named(unnamed).frame_id == "left"
    assert camera.changes_to(camera.named(unnamed).frame_id) is None
    right = replace(unnamed, frame_id="right")
    assert camera.named(right) is right
