"""From pixels to points and back: the pinhole, depth between pixels, depth at another time."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rigs.geometry import SEEDS, twists
from rigs.room import CAMERA, room_frame, true_depth, true_pose
from scipy.ndimage import map_coordinates

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import back_project, cloud, project
from rgbd_glue_ros.geometry.depth import (
    DEPTH_EDGE_SIGMAS,
    depth_at,
    depth_sigma,
    depth_sigmas,
    limit_depth,
    sample_depth,
)
from rgbd_glue_ros.geometry.motion_compensation import displaced_points, keypoints_to_points
from rgbd_glue_ros.geometry.views import grey, rectified
from rgbd_glue_ros.parameters import CameraConfig
from rgbd_glue_ros.types import Float32, Float64, RgbdFrame, View

NAN = float("nan")
DISTORTED = replace(CAMERA, distortion=(0.2, -0.4, 0.002, -0.001, 0.3))


def sloped(height: int = 20, width: int = 30) -> Float32:
    """Depth that is linear in the pixel, as bilinear sampling is exact for it."""
    v, u = np.mgrid[:height, :width]
    depth: Float32 = (2.0 + 0.001 * u - 0.0005 * v).astype(np.float32)
    return depth


@given(SEEDS)
def test_projecting_undoes_back_projecting(seed: int) -> None:
    rng = np.random.default_rng(seed)
    uv, z = rng.uniform(-50, 400, (10, 2)), rng.uniform(0.1, 8, 10)
    points = back_project(uv, z, CAMERA)
    np.testing.assert_allclose(project(points, CAMERA), uv, atol=1e-9)
    np.testing.assert_allclose(points @ CAMERA.matrix.T / z[:, None], np.c_[uv, np.ones(10)])


def test_a_pixel_right_of_and_below_the_principal_point_is_a_point_to_the_right_and_down() -> None:
    uv = np.array([[CAMERA.cx, CAMERA.cy], [CAMERA.cx + CAMERA.fx, CAMERA.cy + CAMERA.fy]])
    points = back_project(uv, np.array([2.0, 3.0]), CAMERA)
    np.testing.assert_allclose(points, [[0, 0, 2], [3, 3, 3]])


def test_points_that_are_not_in_front_have_no_pixel() -> None:
    points = np.array([[0.0, 0, 1], [0, 0, 0], [0, 0, -1]])
    known = np.isfinite(project(points, CAMERA))
    np.testing.assert_array_equal(known, [[True] * 2, [False] * 2, [False] * 2])


def test_the_cloud_has_a_point_for_every_known_depth() -> None:
    depth = sloped()
    depth[3, 4] = depth[0, 0] = NAN
    points = cloud(depth, CAMERA)
    assert len(points) == depth.size - 2
    uv = np.rint(project(points, CAMERA)).astype(int)
    np.testing.assert_allclose(depth[uv[:, 1], uv[:, 0]], points[:, 2])


def test_in_a_smaller_image_a_pixel_sees_what_the_pixels_it_covers_see() -> None:
    # pixel i of the half image covers pixels 2 i and 2 i + 1, whose middle is 2 i + 0.5
    half = CAMERA.scaled(CAMERA.width // 2, CAMERA.height // 2)
    small = back_project(np.array([[10.0, 20.0]]), np.ones(1), half)
    large = back_project(np.array([[20.5, 40.5]]), np.ones(1), CAMERA)
    np.testing.assert_allclose(small, large)
    assert half.scaled(CAMERA.width, CAMERA.height) == CAMERA


def test_grey_is_the_luminance_of_red_green_blue_in_that_order() -> None:
    color = np.eye(3, dtype=np.uint8)[None] * 255
    assert list(grey(color)[0]) == [76, 150, 29]  # ITU-R BT.601: 0.299, 0.587, 0.114


def test_a_grey_image_stays_as_it_is() -> None:
    image = np.arange(12, dtype=np.uint8).reshape(3, 4)
    np.testing.assert_array_equal(grey(image), image)
    assert grey(image.T).flags.c_contiguous


def test_depth_out_of_range_is_unknown_and_nothing_warns() -> None:
    depth = np.array([[NAN, math.inf, -math.inf, -1, 0, 0.4, 0.5, 3, 4, 4.1]], np.float32)
    original = depth.copy()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        limited = limit_depth(depth, CameraConfig(depth_min=0.5, depth_max=4.0))
    np.testing.assert_array_equal(limited, [[*[NAN] * 6, 0.5, 3, 4, NAN]])
    assert limited.dtype == np.float32
    np.testing.assert_array_equal(depth, original)


def test_depth_noise_grows_with_the_square_of_the_distance() -> None:
    assert depth_sigma(0.4) == pytest.approx(0.0012)
    assert depth_sigma(2.4) == pytest.approx(0.0012 + 0.0019 * 2**2)
    assert depth_sigma(4.4) - depth_sigma(0.4) == pytest.approx(
        4 * (depth_sigma(2.4) - depth_sigma(0.4))
    )


def test_depth_noise_of_an_image_is_that_of_each_pixel() -> None:
    depth = np.array([[0.4, 1.0, NAN], [2.4, 8.0, 4.4]], np.float32)
    sigmas = depth_sigmas(depth)
    assert sigmas.dtype == np.float32
    np.testing.assert_array_equal(
        sigmas, np.array([[depth_sigma(z) for z in row] for row in depth], np.float32)
    )


@given(st.floats(0, 29), st.floats(0, 19))
def test_depth_between_pixels_is_bilinear(u: float, v: float) -> None:
    depth = sloped() + np.float32(0.003) * np.sin(np.arange(30, dtype=np.float32))
    expected = map_coordinates(depth.astype(np.float64), [[v], [u]], order=1)[0]
    assert sample_depth(depth, u, v) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("u", "v"), [(-0.01, 5), (5, -0.01), (29.01, 5), (5, 19.01), (NAN, 5), (5, math.inf)]
)
def test_there_is_no_depth_outside_the_image(u: float, v: float) -> None:
    assert math.isnan(sample_depth(sloped(), u, v))


@pytest.mark.parametrize(("dv", "du"), [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_there_is_no_depth_beside_an_unknown_one(dv: int, du: int) -> None:
    depth = sloped()
    depth[7 + dv, 9 + du] = NAN
    assert math.isnan(sample_depth(depth, 9.5, 7.5))
    assert not math.isnan(sample_depth(depth, 12.5, 7.5))


def test_there_is_no_depth_between_two_surfaces_but_on_a_slope_there_is() -> None:
    step = DEPTH_EDGE_SIGMAS * depth_sigma(2.0)
    for height, is_edge in ((1.05 * step, True), (0.95 * step, False)):
        depth = np.full((4, 4), 2.0, np.float32)
        depth[:, 2:] += np.float32(height)
        assert math.isnan(sample_depth(depth, 1.5, 1.5)) is is_edge


def test_depth_at_many_pixels_is_that_at_each() -> None:
    depth = sloped()
    depth[5] = NAN
    u, v = np.random.default_rng(0).uniform(-2, 32, (2, 200))
    each = [sample_depth(depth, *pixel) for pixel in zip(u, v, strict=True)]
    np.testing.assert_array_equal(depth_at(depth, u, v), each)


def test_points_of_late_depth_lie_where_the_camera_sees_them_at_the_time_of_colour() -> None:
    """Over the 20 ms that depth may be late in a fast motion, against a rendered truth."""
    seconds, step = 0.02, np.array([0.01, 0.005, 0.01, 0.01, 0.02, 0])
    early, late = true_pose(0.0), true_pose(0.0) @ se3.exp(step)
    frame = room_frame(0.0)
    u, v = np.meshgrid(np.arange(0, 320, 5), np.arange(0, 240, 5))
    uv = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float32)
    now = View(grey(frame.color), true_depth(early), CAMERA)
    then = replace(now, depth=true_depth(late), twist=step / seconds, depth_delay=seconds)
    points, known = keypoints_to_points(uv, then)
    at_once, seen = keypoints_to_points(uv, replace(then, depth_delay=0.0))
    assert known.mean() > 0.8
    truth = depth_at(now.depth, *uv.T.astype(np.float64))
    error = np.abs(points[:, 2] - truth[known])
    ignored = np.abs(at_once[:, 2] - truth[seen])
    # what is left is quadratic in the angle: 0.024²/2 of some 3 m
    assert np.nanmedian(error) < 0.001
    assert np.nanmedian(ignored) > 10 * np.nanmedian(error)
    np.testing.assert_allclose(project(points, CAMERA), uv[known], atol=1e-4)


@given(twists(max_length=1.0, max_angle=1.0), st.floats(-0.03, 0.03))
def test_a_point_seen_before_is_where_the_camera_was_to_first_order(
    twist: Float64, seconds: float
) -> None:
    """T(0)^-1 T(t) takes what is seen at t to what is seen at 0."""
    points = np.array([[0.3, -0.2, 1.5], [-1.0, 0.5, 3.0]])
    exact = se3.transform(se3.exp(seconds * twist), points)
    moved = displaced_points(points, np.full(2, seconds), twist)
    # what is left is quadratic in the angle and the way
    np.testing.assert_allclose(moved, exact, atol=0.03**2 * 4)


def test_a_frame_without_distortion_is_passed_on_as_it_is() -> None:
    for camera in (CAMERA, replace(CAMERA, distortion=(0.0,) * 5)):
        frame = replace(room_frame(0.0), intrinsics=camera)
        assert rectified(frame) is frame


def test_a_rectified_image_is_the_one_that_opencv_undistorts() -> None:
    frame = replace(room_frame(0.0), intrinsics=DISTORTED)
    straight = rectified(frame)
    expected = cv2.undistort(frame.color, CAMERA.matrix, np.array(DISTORTED.distortion))
    # OpenCV works it out in strips of rows, so that rounding may differ
    assert np.abs(straight.color.astype(int) - expected).max() <= 1
    assert straight.intrinsics == CAMERA
    assert (straight.stamp_ns, straight.frame_id) == (frame.stamp_ns, frame.frame_id)


def test_rectified_depth_lies_on_the_plane_that_a_distorted_camera_looked_at() -> None:
    def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 2.0 / (1.0 + 0.3 * x - 0.2 * y)

    v, u = np.mgrid[: CAMERA.height, : CAMERA.width].astype(np.float64)
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    rays = cv2.undistortPoints(pixels, CAMERA.matrix, np.array(DISTORTED.distortion))
    rays = rays.reshape(CAMERA.height, CAMERA.width, 2)
    depth = plane(rays[..., 0], rays[..., 1]).astype(np.float32)
    frame = RgbdFrame(0, room_frame(0.0).color, depth, DISTORTED)
    expected = plane((u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy)
    error = np.abs(rectified(frame).depth - expected)
    known = np.isfinite(error)
    assert known.mean() > 0.9
    # the nearest pixel is half a pixel away, across and down, at most
    across, down = np.abs(np.gradient(depth.astype(np.float64)))
    half_a_pixel = 0.5 * (across + down).max()
    assert error[known].max() <= 1.01 * half_a_pixel
    assert np.abs(depth - expected).max() > 5 * half_a_pixel


def test_rectified_depth_is_unknown_where_the_distorted_image_ends_and_is_never_mixed() -> None:
    pincushion = replace(CAMERA, distortion=(0.5, 0.0, 0.0, 0.0, 0.0))
    depth = np.full((CAMERA.height, CAMERA.width), 1.0, np.float32)
    depth[:, CAMERA.width // 2 :] = 3.0
    depth[100:110] = NAN
    straight = rectified(RgbdFrame(0, room_frame(0.0).color, depth, pincushion)).depth
    assert np.isnan(straight[0, 0])
    assert {*np.unique(straight[np.isfinite(straight)])} == {1.0, 3.0}
