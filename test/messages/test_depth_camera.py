from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.depth_camera import (
    FoundDepthCamera,
    GivenDepthCamera,
    find_depth_camera,
)
from rgbd_glue_ros.messages.frame import FrameTopics, frame_from_messages
from rgbd_glue_ros.messages.making import camera_info, color_image, depth_image, header
from rgbd_glue_ros.types import CameraIntrinsics, Float64

COLOR = CameraIntrinsics(64, 48, 60.0, 61.0, 31.5, 23.5, (0.1, -0.2, 0.001, 0.002, 0.3))
DEPTH = CameraIntrinsics(80, 64, 70.0, 72.0, 39.0, 32.5)
TOPICS = FrameTopics("/color", "/depth", "/color/info", "/depth/info")
T_COLOR_DEPTH = se3.exp(np.array([0.05, 0.01, 0.0, 0.0, 0.02, 0.0]))


def found(
    depth_frame: str,
    info_frame: str | None,
    info_camera: CameraIntrinsics = DEPTH,
    T: Float64 | None = T_COLOR_DEPTH,
    given: Float64 | None = None,
) -> FoundDepthCamera:
    return find_depth_camera(
        color_image(np.zeros((48, 64), np.uint8), header(0, "color_optical")),
        depth_image(np.ones((64, 80), np.float32), header(0, depth_frame)),
        camera_info(COLOR, header(0, "color_optical")),
        None if info_frame is None else camera_info(info_camera, header(0, info_frame)),
        lambda target, source: (
            T if (target, source) == ("color_optical", "depth_optical") else None
        ),
        TOPICS,
        GivenDepthCamera(given),
    )


def taken_by(*args: Any, **kwargs: Any) -> Any:
    return found(*args, **kwargs).camera


def test_depth_in_the_frame_of_colour_is_registered_already() -> None:
    assert taken_by("color_optical", None) is None
    assert taken_by("", None) is None
    for scale in (0.5, 1, 2):
        alike = COLOR.scaled(round(64 * scale), round(48 * scale))
        assert taken_by("color_optical", "color_optical", alike) is None


def test_an_info_of_another_frame_than_the_depth_image_is_not_its_camera() -> None:
    assert taken_by("color_optical", "depth_optical") is None


def test_depth_in_another_frame_has_the_camera_of_its_info_at_the_pose_of_that_frame() -> None:
    camera = taken_by("depth_optical", "depth_optical")
    assert camera.intrinsics == DEPTH
    assert np.array_equal(camera.T_color_depth, T_COLOR_DEPTH)


def test_depth_in_the_frame_of_colour_with_another_lens_has_the_pose_of_colour() -> None:
    camera = taken_by("color_optical", "color_optical", DEPTH)
    assert camera.intrinsics == DEPTH
    assert np.array_equal(camera.T_color_depth, np.eye(4))


def test_a_given_pose_overrides_that_of_frames() -> None:
    given = se3.exp(np.array([0.1, 0, 0, 0, 0, 0]))
    for frame in ("color_optical", "depth_optical", ""):
        camera = taken_by(frame, frame, given=given)
        assert np.array_equal(camera.T_color_depth, given)


def test_depth_that_is_registered_only_because_of_its_info_is_reported() -> None:
    for frame, camera, is_noted in (
        ("color_optical", DEPTH, True),
        ("", DEPTH, True),
        ("color_optical", COLOR, False),
        ("depth_optical", DEPTH, False),
    ):
        note = found(frame, frame, camera).note
        assert (note is not None) == is_noted
        assert note is None or "set depth_camera_pose" in note


def test_unregistered_depth_without_an_info_is_refused_with_what_to_enable() -> None:
    with pytest.raises(InputError) as caught:
        taken_by("depth_optical", None)
    said = str(caught.value)
    assert said.startswith(
        "/depth: is not registered to colour: its frame is depth_optical, that of /color "
        "color_optical; enable registration in the driver (realsense2_camera: align_depth.enable"
    )
    assert "name the depth camera's info (depth_info_topic, now /depth/info)" in said
    assert "\n" not in said


def test_unregistered_depth_with_an_unknown_pose_is_refused() -> None:
    with pytest.raises(InputError, match="the pose of depth_optical in color_optical is unknown"):
        taken_by("depth_optical", "depth_optical", T=None)


def test_a_frame_of_another_depth_camera_has_depth_at_the_pixels_of_colour() -> None:
    """A wall at 2 m, seen by both; the depth camera's image is a quarter of its info's size."""
    color = color_image(np.zeros((48, 64), np.uint8), header(5, "color_optical"))
    depth = depth_image(np.full((32, 40), 2.0, np.float32), header(5, "depth_optical"))
    ahead = np.eye(4)
    ahead[2, 3] = 0.5
    camera = find_depth_camera(
        color,
        depth,
        camera_info(COLOR, header(0, "")),
        camera_info(DEPTH, header(0, "depth_optical")),
        lambda *_: ahead,
        TOPICS,
    ).camera
    frame = frame_from_messages(color, depth, camera_info(COLOR, header(0, "")), TOPICS, camera)
    assert frame.depth.shape == (48, 64)
    assert frame.intrinsics == COLOR
    np.testing.assert_allclose(frame.depth[10:-10, 10:-10], 2.5, rtol=1e-5)


def test_a_depth_info_with_another_aspect_ratio_than_its_image_is_refused() -> None:
    color = color_image(np.zeros((48, 64), np.uint8), header(5, "color_optical"))
    depth = depth_image(np.ones((64, 80), np.float32), header(5, "color_optical"))
    camera = taken_by("color_optical", "color_optical", replace(DEPTH, width=96))
    with pytest.raises(InputError, match=r"^/depth/info: has 96x64 pixels, but /depth has 80x64"):
        frame_from_messages(color, depth, camera_info(COLOR, header(0, "")), TOPICS, camera)
