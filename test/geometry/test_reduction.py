"""Images of a large frame, reduced."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rgbd_glue_ros.geometry.camera import back_project
from rgbd_glue_ros.geometry.reduction import reduced
from rgbd_glue_ros.types import CameraIntrinsics, RgbdFrame

LARGE = CameraIntrinsics(1280, 720, 900.0, 910.0, 630.3, 355.7)


def frame(camera: CameraIntrinsics = LARGE) -> RgbdFrame:
    """A slanted plane z = 2 + 0.3 x + 0.1 y, seen by the camera, with a ramp of brightness."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    x, y = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    depth = (2 / (1 - 0.3 * x - 0.1 * y)).astype(np.float32)
    color = np.repeat((u // 8 % 256).astype(np.uint8)[..., None], 3, axis=2)
    return RgbdFrame(7, color, depth, camera, "optical", 3)


@pytest.mark.parametrize(
    ("max_width", "size"),
    [(640, (640, 360)), (639, (426, 240)), (426, (426, 240)), (500, (426, 240)), (320, (320, 180))],
)
def test_a_plane_stays_in_place_when_images_are_reduced(
    max_width: int, size: tuple[int, int]
) -> None:
    small = reduced(frame(), max_width)
    camera = small.intrinsics
    assert (camera.width, camera.height) == size
    assert small.depth.shape == small.color.shape[:2] == size[::-1]
    assert (small.stamp_ns, small.frame_id, small.depth_delay_ns) == (7, "optical", 3)
    v, u = np.indices(small.depth.shape).reshape(2, -1)
    points = back_project(
        np.column_stack([u, v]).astype(np.float64), small.depth.ravel().astype(np.float64), camera
    )
    x, y, z = points.T
    # the mean of a block is off by the plane's curvature in the image alone
    np.testing.assert_allclose(z, 2 + 0.3 * x + 0.1 * y, atol=1e-4)


@pytest.mark.parametrize("max_width", [0, 1280, 2000])
def test_an_image_that_is_not_wider_is_left_as_it_is(max_width: int) -> None:
    large = frame()
    assert reduced(large, max_width) is large


def test_no_depth_lies_between_two_surfaces_and_unknown_samples_are_left_out() -> None:
    camera = CameraIntrinsics(6, 4, 5.0, 5.0, 2.5, 1.5)
    near, far, none = 1.0, 3.0, np.nan
    depth = np.array(
        [
            [near, far, none, far, none, none],
            [far, far, none, none, none, none],
            [near, 1.01, far, far, none, near],
            [near, 1.01, far, near, none, none],
        ],
        np.float32,
    )
    small = reduced(replace(frame(camera), depth=depth), 3).depth
    np.testing.assert_allclose(small, [[near, far, none], [1.005, far, near]], rtol=1e-6)


def test_colour_is_the_mean_of_a_block_and_may_be_grey() -> None:
    camera = CameraIntrinsics(4, 2, 5.0, 5.0, 1.5, 0.5)
    grey = np.array([[0, 100, 7, 7], [100, 200, 7, 7]], np.uint8)
    small = reduced(replace(frame(camera), color=grey), 2)
    np.testing.assert_array_equal(small.color, [[100, 7]])


def test_an_image_lower_than_a_block_keeps_a_row() -> None:
    camera = CameraIntrinsics(1280, 16, 500.0, 500.0, 639.5, 7.5)
    small = reduced(frame(camera), 32)
    assert small.depth.shape == small.color.shape[:2] == (1, 80)


def test_the_one_sample_of_a_large_block_is_found() -> None:
    camera = CameraIntrinsics(600, 300, 500.0, 500.0, 299.5, 149.5)
    depth = np.full((300, 600), np.nan, np.float32)
    depth[0, 299] = 2.0
    np.testing.assert_array_equal(
        reduced(replace(frame(camera), depth=depth), 1).depth, [[2, np.nan]]
    )
