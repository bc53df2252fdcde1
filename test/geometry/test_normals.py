"""Planes of a depth image: right on planes and spheres, silent at edges and holes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from rigs.room import CAMERA

from rgbd_glue_ros.geometry.camera import back_project
from rgbd_glue_ros.geometry.depth import depth_sigma
from rgbd_glue_ros.geometry.normals import grid_points_and_normals, normals_of_nine
from rgbd_glue_ros.types import Float32, Float64, Int64

STEP = 8
ROWS, COLUMNS = CAMERA.height // STEP, CAMERA.width // STEP
K = tuple(CAMERA.focal_and_centre.tolist())


def rays() -> Float64:
    """Directions of all pixels with z = 1, float64 [H, W, 3]."""
    v, u = np.mgrid[: CAMERA.height, : CAMERA.width]
    uv = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    return back_project(uv, np.ones(len(uv)), CAMERA).reshape(*u.shape, 3)


def plane_depth(normal: Float64, distance: float) -> Float32:
    """Depth of the plane n·X = -distance, unknown where it is farther than 8 m."""
    with np.errstate(divide="ignore"):
        depth = -distance / (rays() @ normal)
    known: Float32 = np.where((depth > 0) & (depth < 8), depth, np.nan).astype(np.float32)
    return known


def tilted(degrees: float, azimuth: float) -> Float64:
    """A unit normal towards the camera, tilted away from the optical axis."""
    tilt, around = np.radians(degrees), np.radians(azimuth)
    return np.array(
        [np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), -np.cos(tilt)], np.float64
    )


def known(points: Float64) -> NDArray[np.bool_]:
    return np.isfinite(points[..., 2])


def nine(depth: Float32, rows: Int64, columns: Int64) -> Float64:
    """The normals of nine depths each, float64 [N, 3]."""
    normals: Float64 = normals_of_nine(depth, K, rows, columns, 1.0).T
    return normals


@given(st.floats(0, 60), st.floats(0, 360), st.floats(0.5, 4))
@example(0.0, 0.0, 2.0)
@settings(max_examples=25, deadline=None)
def test_on_a_plane_points_and_normals_are_exact(
    degrees: float, azimuth: float, distance: float
) -> None:
    normal = tilted(degrees, azimuth)
    points, normals = grid_points_and_normals(plane_depth(normal, distance), CAMERA, STEP)
    seen = known(points)
    assert seen.mean() > 0.3
    np.testing.assert_allclose(normals[seen] @ normal, 1.0, atol=1e-5)
    # exact but for the digits of float32
    np.testing.assert_allclose(points[seen] @ normal, -distance, rtol=1e-5)


def test_a_grid_point_is_on_the_ray_of_the_pixel_in_the_middle_of_its_cell() -> None:
    points, _ = grid_points_and_normals(plane_depth(tilted(30, 40), 2.0), CAMERA, STEP)
    assert points.shape == (ROWS, COLUMNS, 3)
    middles = rays()[STEP // 2 :: STEP, STEP // 2 :: STEP]
    np.testing.assert_allclose(points / points[..., 2:], middles, atol=1e-12)


def test_on_a_sphere_normals_point_away_from_its_centre_and_towards_the_camera() -> None:
    centre, radius = np.array([0.1, -0.05, 2.0]), 0.6
    ray = rays()
    a, b, c = (ray**2).sum(-1), ray @ centre, centre @ centre - radius**2
    with np.errstate(invalid="ignore"):
        depth = ((b - np.sqrt(b**2 - a * c)) / a).astype(np.float32)
    points, normals = grid_points_and_normals(depth, CAMERA, STEP)
    seen = known(points)
    assert seen.sum() > 200
    np.testing.assert_allclose(np.linalg.norm(normals[seen], axis=1), 1.0)
    assert (np.einsum("ij,ij->i", normals[seen], points[seen]) < 0).all()
    outward = (points[seen] - centre) / np.linalg.norm(points[seen] - centre, axis=1)[:, None]
    angle = np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", normals[seen], outward), -1, 1)))
    assert np.median(angle) < 1.0
    # a window reaches over 6 pixels, 5 cm here: at the rim it is cut to one side
    assert np.quantile(angle, 0.9) < 5.0


def test_depth_noise_is_averaged_over_the_window() -> None:
    rng = np.random.default_rng(0)
    sigma = depth_sigma(2.0)
    depth = plane_depth(tilted(0, 0), 2.0)
    depth += rng.normal(0, sigma, depth.shape).astype(np.float32)
    points, normals = grid_points_and_normals(depth, CAMERA, STEP)
    inside = slice(1, -1), slice(1, -1)
    error = points[inside][..., 2] - 2.0
    # the middle of a plane fitted to 7 x 7 pixels
    assert error.std() == pytest.approx(sigma / 7, rel=0.1)
    # its slope, from the pixels' offsets of variance 4² around it, in metres at 2 m
    slope = sigma / (7 * 4 * 2.0 / CAMERA.fx)
    assert normals[inside][..., 0].std() == pytest.approx(slope, rel=0.1)


def test_at_a_step_no_point_is_between_the_two_surfaces() -> None:
    depth = np.full((CAMERA.height, CAMERA.width), 3.0, np.float32)
    depth[:, 157:] = 2.0
    points, normals = grid_points_and_normals(depth, CAMERA, STEP)
    z = points[..., 2][known(points)]
    assert (np.minimum(np.abs(z - 2), np.abs(z - 3)) < 1e-6).all()
    np.testing.assert_allclose(normals[known(points)] @ [0, 0, -1], 1.0, atol=1e-9)


def test_where_depth_is_unknown_there_is_no_point_and_no_normal() -> None:
    depth = plane_depth(tilted(20, 0), 2.0)
    depth[80:160, 100:200] = np.nan
    points, normals = grid_points_and_normals(depth, CAMERA, STEP)
    hole = np.isnan(depth[STEP // 2 :: STEP, STEP // 2 :: STEP])
    assert hole.sum() > 100
    np.testing.assert_array_equal(known(points), ~hole)
    np.testing.assert_array_equal(known(normals), ~hole)


def test_a_few_pixels_alone_are_no_plane() -> None:
    depth = np.full((CAMERA.height, CAMERA.width), np.nan, np.float32)
    depth[100:105, 100:105] = 2.0
    depth[:, 200] = 2.0  # nor is a line
    points, _ = grid_points_and_normals(depth, CAMERA, STEP)
    assert not known(points).any()


def test_a_surface_seen_too_flat_is_not_trusted() -> None:
    # a floor half a metre below the camera: the ray at slope y meets it at an angle atan(y)
    points, _ = grid_points_and_normals(plane_depth(np.array([0.0, -1, 0]), 0.5), CAMERA, STEP)
    seen = points[known(points)]
    angle = np.degrees(np.arcsin(seen[:, 1] / np.linalg.norm(seen, axis=1)))
    assert len(seen) > 300
    assert 9 < angle.min() < 12


@given(st.floats(0, 60), st.floats(0, 360), st.floats(0.5, 4))
@settings(max_examples=25, deadline=None)
def test_on_a_plane_the_normals_of_nine_are_exact_up_to_the_border(
    degrees: float, azimuth: float, distance: float
) -> None:
    normal = tilted(degrees, azimuth)
    depth = plane_depth(normal, distance)
    rows, columns = (x.ravel() for x in np.mgrid[: CAMERA.height, : CAMERA.width])
    normals = nine(depth, rows, columns)
    seen = known(normals)
    assert seen.mean() > 0.3
    np.testing.assert_allclose(normals[seen] @ normal, 1.0, atol=1e-5)


def test_nine_depths_beside_an_edge_or_a_hole_have_no_normal() -> None:
    left, right = (plane_depth(tilted(45, azimuth), 1.0) for azimuth in (0, 180))
    middle = CAMERA.width // 2
    corner = np.where(np.arange(CAMERA.width) < middle, left, right)
    columns = np.array([middle - 30, middle, middle + 30])
    rows = np.full(3, CAMERA.height // 2)
    seen = known(nine(corner, rows, columns))
    assert seen.tolist() == [True, False, True]
    holed = left.copy()
    holed[rows[0] + 6, columns[0]] = np.nan
    assert not known(nine(holed, rows, columns))[0]


def test_an_image_smaller_than_nine_depths_has_no_normals() -> None:
    depth = np.ones((12, 40), np.float32)
    assert not known(nine(depth, np.array([6]), np.array([20]))).any()
