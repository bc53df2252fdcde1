from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from numpy.typing import NDArray

from rgbd_glue_ros.geometry import lens, se3
from rgbd_glue_ros.geometry.depth_registration import DepthCamera, registered
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64

DEPTH_CAMERA = CameraIntrinsics(80, 64, 70.0, 72.0, 39.0, 32.5)
COLOR = CameraIntrinsics(64, 48, 60.0, 61.0, 31.5, 23.5)
T_COLOR_DEPTH = se3.exp(np.array([0.05, -0.01, 0.02, 0.02, -0.05, 0.03]))
BARREL = (-0.28, 0.08, 0.001, -0.002, -0.01)
RATIONAL = (0.5, -2.6, 0.0005, -0.0003, 1.5, 0.4, -2.4, 1.4)

# normal n and distance d of n · p = d in the depth camera's frame
PLANE = np.array([0.3, -0.2, 1.0]), 2.0


def rays(camera: CameraIntrinsics) -> Float64:
    """Where each pixel looks (x, y, 1), by OpenCV."""
    v, u = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    lens = np.array(camera.distortion or (0.0,) * 5)
    xy = cv2.undistortPoints(pixels, camera.matrix, lens).reshape(camera.height, camera.width, 2)
    return np.dstack([xy, np.ones(xy.shape[:2])])


def plane_depth(camera: CameraIntrinsics, T_camera_depth: Float64) -> Float64:
    """The depth of PLANE at every pixel of a camera."""
    T = se3.inverse(T_camera_depth)
    normal, distance = PLANE
    depth: Float64 = (distance - normal @ T[:3, 3]) / (rays(camera) @ (normal @ T[:3, :3]))
    return depth


def is_in_view(points: Float64, camera: CameraIntrinsics, margin: float) -> NDArray[np.bool_]:
    """Which points [H, W, 3] a camera sees, at least so many pixels within its image."""
    lens = np.array(camera.distortion or (0.0,) * 5)
    flat, _ = cv2.projectPoints(
        points.reshape(-1, 3), np.zeros(3), np.zeros(3), camera.matrix, lens
    )
    u, v = np.moveaxis(flat.reshape(*points.shape[:2], 2), 2, 0)
    inside_u = (u > margin) & (u < camera.width - 1 - margin)
    return np.asarray(inside_u & (v > margin) & (v < camera.height - 1 - margin))


@pytest.mark.parametrize("scale", [0.25, 0.7, 1, 3.3])
@pytest.mark.parametrize(
    ("depth_lens", "color_lens"), [((), ()), (BARREL, RATIONAL), (RATIONAL, BARREL), ((), BARREL)]
)
def test_a_plane_has_the_depth_of_its_equation_wherever_the_depth_camera_sees_it(
    scale: float, depth_lens: tuple[float, ...], color_lens: tuple[float, ...]
) -> None:
    depth_camera = replace(DEPTH_CAMERA, distortion=depth_lens)
    color = replace(COLOR.scaled(round(64 * scale), round(48 * scale)), distortion=color_lens)
    depth = plane_depth(depth_camera, np.eye(4)).astype(np.float32)
    image = registered(depth, DepthCamera(depth_camera, T_COLOR_DEPTH), color)
    expected = plane_depth(color, T_COLOR_DEPTH)
    known = np.isfinite(image)
    np.testing.assert_allclose(image[known], expected[known], rtol=2e-5 if not color_lens else 1e-3)
    T = se3.inverse(T_COLOR_DEPTH)
    in_depth_frame = (rays(color) * expected[..., None]) @ T[:3, :3].T + T[:3, 3]
    np.testing.assert_array_equal(known | ~is_in_view(in_depth_frame, depth_camera, 0.01), True)


def scene(camera: CameraIntrinsics, T_camera_depth: Float64) -> Float64:
    """Depth of a wall at 3 m with a board of 0.6 m x 0.5 m at 1 m before it, traced by hand."""
    T = se3.inverse(T_camera_depth)
    directions = rays(camera) @ T[:3, :3].T
    best = np.full(directions.shape[:2], np.inf)
    for z, half_width, half_height in ((1.0, 0.3, 0.25), (3.0, np.inf, np.inf)):
        s = (z - T[2, 3]) / directions[..., 2]
        x, y = (T[i, 3] + s * directions[..., i] for i in (0, 1))
        hit = (s > 0) & (np.abs(x) < half_width) & (np.abs(y) < half_height)
        best = np.where(hit, np.minimum(best, s), best)
    return best


def near_edges(depth: Float64, pixels: int) -> NDArray[np.bool_]:
    """Pixels that are so close to a step of depth."""
    size = (2 * pixels + 1, 2 * pixels + 1)
    return np.asarray(cv2.dilate(depth, np.ones(size)) - cv2.erode(depth, np.ones(size)) > 0.5)


@pytest.mark.parametrize("scale", [1, 4])
def test_the_nearest_surface_is_seen_and_what_is_hidden_from_the_depth_camera_is_unknown(
    scale: int,
) -> None:
    T_color_depth = se3.exp(np.array([0.1, 0.03, 0.0, 0.0, 0.02, 0.01]))
    color = COLOR.scaled(64 * scale, 48 * scale)
    seen = scene(DEPTH_CAMERA, np.eye(4))
    image = registered(seen.astype(np.float32), DepthCamera(DEPTH_CAMERA, T_color_depth), color)
    truth = scene(color, T_color_depth)
    clear = ~near_edges(truth, scale)
    known = np.isfinite(image)
    np.testing.assert_allclose(image[known & clear], truth[known & clear], rtol=1e-5)

    # the depth camera sees a point if nothing in its image is nearer where the point is
    T = se3.inverse(T_color_depth)
    points = (rays(color) * truth[..., None]) @ T[:3, :3].T + T[:3, 3]
    K = DEPTH_CAMERA
    u = np.clip(K.fx * points[..., 0] / points[..., 2] + K.cx, 0, K.width - 1)
    v = np.clip(K.fy * points[..., 1] / points[..., 2] + K.cy, 0, K.height - 1)
    edge = near_edges(seen, 1)[np.rint(v).astype(int), np.rint(u).astype(int)]
    visible = np.abs(seen[np.rint(v).astype(int), np.rint(u).astype(int)] - points[..., 2]) < 0.5
    inside = is_in_view(points, K, 1)
    hidden = inside & ~visible & ~edge
    assert hidden.sum() > 5 * scale**2
    assert not known[hidden].any()
    assert known[inside & visible & ~edge].all()


@given(
    npst.arrays(np.float32, (6, 8), elements=st.floats(0.25, 6, width=32) | st.just(float("nan")))
)
def test_between_equal_cameras_at_one_place_nothing_changes(depth: Float32) -> None:
    camera = CameraIntrinsics(8, 6, 9.0, 9.0, 3.5, 2.5)
    image = registered(depth, DepthCamera(camera, np.eye(4)), camera)
    np.testing.assert_allclose(image, depth, rtol=1e-5)


def test_a_pixel_without_neighbours_is_kept() -> None:
    depth = np.full((64, 80), np.nan, np.float32)
    depth[30, 40] = 1.5
    image = registered(depth, DepthCamera(DEPTH_CAMERA, np.eye(4)), COLOR)
    assert np.isfinite(image).sum() == 1
    u = COLOR.fx * (40 - DEPTH_CAMERA.cx) / DEPTH_CAMERA.fx + COLOR.cx
    v = COLOR.fy * (30 - DEPTH_CAMERA.cy) / DEPTH_CAMERA.fy + COLOR.cy
    assert image[round(v), round(u)] == np.float32(1.5)


@pytest.mark.parametrize(("x", "looks_to", "is_seen"), [(0.2, 1, True), (0.8, -1, False)])
def test_a_surface_that_the_depth_camera_sees_the_other_side_of_is_not_there(
    x: float, looks_to: int, is_seen: bool
) -> None:
    """A wall at x = 0.5 along the depth camera's view; the colour camera looks along the x axis."""
    camera = CameraIntrinsics(80, 64, 400.0, 400.0, -200.0, 31.5)
    u = np.mgrid[:64, :80][1]
    wall = (0.5 * camera.fx / (u - camera.cx)).astype(np.float32)
    turned = np.array([[0.0, 0, looks_to], [0, 1, 0], [-looks_to, 0, 0]])
    T_depth_color = se3.from_rotation_translation(turned, np.array([x, 0.0, 0.8]))
    image = registered(wall, DepthCamera(camera, se3.inverse(T_depth_color)), COLOR)
    assert np.isfinite(image).any() == is_seen


def test_a_lens_whose_model_diverges_at_the_corners_has_depth_elsewhere() -> None:
    color = replace(COLOR, distortion=(-1.5, -1.8, 0.0, 0.0, 0.0, 1.0, 0.3, -0.5))
    assert np.isnan(lens.rays(color)[0, 0]).any()
    depth = np.full((64, 80), 2.0, np.float32)
    image = registered(depth, DepthCamera(DEPTH_CAMERA, np.eye(4)), color)
    np.testing.assert_allclose(image[20:28, 28:36], 2.0, rtol=1e-6)


def test_a_wide_depth_camera_puts_nothing_into_the_image_of_a_narrow_lens_that_turns_back() -> None:
    lens = (-0.4, 0.0, 0.0, 0.0, 0.0)  # r - 0.4 r³ falls from r = 0.91 on
    color = CameraIntrinsics(64, 48, 90.0, 90.0, 31.5, 23.5, lens)
    wide = CameraIntrinsics(160, 128, 40.0, 40.0, 79.5, 63.5)
    depth = plane_depth(wide, np.eye(4)).astype(np.float32)
    depth[depth < 0] = np.nan
    image = registered(depth, DepthCamera(wide, np.eye(4)), color)
    np.testing.assert_allclose(image, plane_depth(color, np.eye(4)), rtol=2e-3)


@given(
    st.lists(st.floats(-3, 3), min_size=6, max_size=6),
    npst.arrays(np.float32, (5, 7), elements=st.floats(width=32)),
)
@settings(max_examples=200)
def test_no_depth_and_no_place_of_the_camera_gives_anything_but_depth(
    motion: list[float], depth: Float32
) -> None:
    camera = CameraIntrinsics(7, 5, 6.0, 6.0, 3.0, 2.0)
    image = registered(depth, DepthCamera(camera, se3.exp(np.array(motion))), COLOR)
    assert image.shape == (48, 64)
    assert (image[np.isfinite(image)] > 0).all()
