"""Three messages as one frame."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from rigs.messages import CAMERA, DEPTH, HEAD, RGB, TOPICS

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import Header, Time
from rgbd_glue_ros.messages.frame import (
    frame_from_messages,
    registration_doubt,
    resampled,
)
from rgbd_glue_ros.messages.making import camera_info, color_image, depth_image


def test_depth_in_another_frame_than_colour_is_doubted() -> None:
    color = color_image(RGB, HEAD)
    elsewhere = depth_image(DEPTH, replace(HEAD, frame_id="depth_optical"))
    doubt = registration_doubt(color, elsewhere, TOPICS)
    assert doubt is not None
    assert "/depth: its frame is depth_optical, but that of /color is camera_optical" in doubt
    for frame_id in ("", HEAD.frame_id):
        depth = depth_image(DEPTH, replace(HEAD, frame_id=frame_id))
        assert registration_doubt(color, depth, TOPICS) is None


def test_a_frame_has_the_stamp_and_frame_of_its_colour_image() -> None:
    later = Header(Time(2_000_000_000, 5), "depth_optical")
    frame = frame_from_messages(
        color_image(RGB, HEAD), depth_image(DEPTH, later), camera_info(CAMERA, later), TOPICS
    )
    assert frame.stamp_ns == 1_234_567_890_123_456_789
    assert frame.frame_id == "camera_optical"
    assert np.array_equal(frame.color, RGB)
    assert np.array_equal(frame.depth, DEPTH)
    assert frame.intrinsics == CAMERA


@pytest.mark.parametrize(("width", "height"), [(32, 24), (128, 96), (96, 72), (64, 48)])
def test_depth_of_another_size_is_resampled_about_pixel_centres_as_in_opencv(
    width: int, height: int
) -> None:
    expected = cv2.resize(DEPTH, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
    assert np.array_equal(resampled(DEPTH, width, height), expected)


def test_a_plane_stays_a_plane_when_its_depth_is_resampled() -> None:
    """Pixels of the enlarged image look along their own rays, to within the coarser pixel."""
    full = CAMERA.scaled(256, 192)
    u, v = np.meshgrid(np.arange(64), np.arange(48))
    normal = np.array([0.3, -0.2, 1.0])
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)])
    depth = (2.0 / np.tensordot(normal, rays, 1)).astype(np.float32)
    color = np.zeros((192, 256), np.uint8)
    frame = frame_from_messages(
        color_image(color, HEAD), depth_image(depth, HEAD), camera_info(full, HEAD), TOPICS
    )
    u, v = np.meshgrid(np.arange(256), np.arange(192))
    rays = np.stack([(u - full.cx) / full.fx, (v - full.cy) / full.fy, np.ones_like(u)])
    residual = np.tensordot(normal, rays * frame.depth, 1) - 2.0
    half_a_coarse_pixel = 0.5 / CAMERA.fx * (0.3 + 0.2) * np.nanmax(depth)
    assert np.abs(residual).max() < half_a_coarse_pixel
    assert abs(residual.mean()) < half_a_coarse_pixel / 50


def test_a_camera_info_of_another_size_is_scaled_about_pixel_centres() -> None:
    info = camera_info(CAMERA.scaled(128, 96), HEAD)
    frame = frame_from_messages(color_image(RGB, HEAD), depth_image(DEPTH, HEAD), info, TOPICS)
    assert frame.intrinsics.matrix == pytest.approx(CAMERA.matrix)


def test_sizes_with_another_aspect_ratio_are_refused() -> None:
    color, depth = color_image(RGB, HEAD), depth_image(DEPTH, HEAD)
    info = camera_info(CAMERA, HEAD)
    with pytest.raises(InputError, match=r"^/depth: has 64x36 pixels, but /color has 64x48"):
        frame_from_messages(color, depth_image(DEPTH[:36], HEAD), info, TOPICS)
    wide = camera_info(replace(CAMERA, width=128), HEAD)
    with pytest.raises(InputError, match=r"^/info: has 128x48 pixels, but /color has 64x48"):
        frame_from_messages(color, depth, wide, TOPICS)
