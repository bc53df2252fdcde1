"""Projections, samples and residuals, against closed forms and differences of residuals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from rigs.geometry import SEEDS
from scipy.ndimage import map_coordinates

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.geometry.camera import project as pinhole
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.level_problem import Exposure, LevelProblem
from rgbd_glue_ros.refinement.model import LEVELS, model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.projection import project
from rgbd_glue_ros.refinement.residuals import Residuals, pixel_residuals, plane_residuals
from rgbd_glue_ros.refinement.sampling import brightness_and_gradient
from rgbd_glue_ros.types import CameraIntrinsics, Float64, View

K = (500.0, 510.0, 320.0, 240.0)
HEIGHT = 480
AT_REST = (0.0,) * 6
AS_SEEN = np.array([1.0, 0.0, 5.0])


def a_pose(random: np.random.Generator) -> Float64:
    return se3.exp(random.normal(0, 0.2, 6))


def points_before(random: np.random.Generator, T_model_camera: Float64) -> Float64:
    """Points [N, 3] in front of a camera, in the model's frame."""
    seen = random.uniform([-0.6, -0.45, 1.0], [0.6, 0.45, 4.0], (50, 3))
    return se3.transform(T_model_camera, seen)


def of_wall(level: int) -> LevelProblem:
    """A smoothly painted, slanted wall on itself, seen while the camera moves."""
    v, u = np.mgrid[:HEIGHT, :640].astype(float)
    rays = np.stack([(u - K[2]) / K[0], (v - K[3]) / K[1], np.ones_like(u)], axis=-1)
    depth = (2.0 / (rays @ np.array([0.3, -0.2, 1.0]))).astype(np.float32)
    grey = (128 + 60 * np.sin(u / 7) + 60 * np.cos(v / 6)).astype(np.uint8)
    view = View(grey, depth, CameraIntrinsics(640, HEIGHT, *K))
    twist = np.array([0.3, -0.2, 0.1, 0.2, 0.4, -0.3])
    moving, config = replace(view, twist=twist, readout_time=0.02, depth_delay=0.01), RefineConfig()
    return RefinementProblem(model_of(view, config.grid_step), moving, config).at_level(level)


@given(SEEDS)
@settings(max_examples=20)
def test_a_camera_at_rest_projects_as_a_pinhole(seed: int) -> None:
    random = np.random.default_rng(seed)
    T = a_pose(random)
    points = points_before(random, T)
    found = project(T, np.ascontiguousarray(points.T), Exposure(K, HEIGHT, AT_REST, 0.03, 0.01))
    in_camera = se3.transform(se3.inverse(T), points)
    uv = pinhole(in_camera, CameraIntrinsics(640, HEIGHT, *K))
    np.testing.assert_allclose(np.column_stack([found.u, found.v]), uv, atol=1e-9)
    np.testing.assert_allclose(found.z, in_camera[:, 2])
    np.testing.assert_allclose(found.row_time, uv[:, 1] / HEIGHT - 0.5)


@given(SEEDS)
@settings(max_examples=20)
def test_a_moving_camera_sees_a_point_from_where_it_is_when_its_row_is_read(seed: int) -> None:
    random = np.random.default_rng(seed)
    T, twist = a_pose(random), random.uniform(-0.5, 0.5, 6)
    readout_time, delay = 0.03, 0.01
    points = points_before(random, T)
    exposure = Exposure(K, HEIGHT, tuple(twist.tolist()), readout_time, delay)
    found = project(T, np.ascontiguousarray(points.T), exposure)
    for i, point in enumerate(points):
        then = T @ se3.exp((delay + found.row_time[i] * readout_time) * twist)
        x, y, z = se3.transform(se3.inverse(then), point[None])[0]
        uv = [K[0] * x / z + K[2], K[1] * y / z + K[3]]
        # velocity times time is the motion but for its square
        assert [found.u[i], found.v[i]] == pytest.approx(uv, abs=0.3)
        assert found.row_time[i] == pytest.approx(found.v[i] / HEIGHT - 0.5, abs=2e-3)


def test_a_point_behind_the_camera_has_no_column() -> None:
    behind = np.array([[0.0], [0.0], [-2.0]])
    assert np.isnan(project(np.eye(4), behind, Exposure(K, HEIGHT, AT_REST, 0.0, 0.0)).u[0])


@given(SEEDS)
@settings(max_examples=50)
def test_brightness_between_pixels_is_bilinear_and_its_gradient_the_central_difference(
    seed: int,
) -> None:
    random = np.random.default_rng(seed)
    image = random.integers(0, 255, (12, 14)).astype(np.uint8)
    u, v = random.uniform(1, 11), random.uniform(1, 9)

    def between(u: float, v: float) -> float:
        return float(map_coordinates(image.astype(float), [[v], [u]], order=1)[0])

    expected = (
        between(u, v),
        (between(u + 1, v) - between(u - 1, v)) / 2,
        (between(u, v + 1) - between(u, v - 1)) / 2,
    )
    assert brightness_and_gradient(image, u, v) == pytest.approx(expected)


@pytest.mark.parametrize("level", range(LEVELS))
@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("kind", ["planes", "pixels"])
def test_derivatives_are_how_residuals_change_with_the_pose(
    kind: str, axis: int, level: int
) -> None:
    problem, step = of_wall(level), 0.004

    def residuals(T: Float64) -> Residuals:
        if kind == "planes":
            return plane_residuals(T, problem)[0]
        return pixel_residuals(T, problem, AS_SEEN)[0]

    direction = np.eye(6)[axis]
    at, ahead, behind = (residuals(se3.exp(way * step * direction)) for way in (0, 1, -1))
    seen = (at.weight > 0) & (ahead.weight > 0) & (behind.weight > 0)
    assert np.count_nonzero(seen) > len(seen) / 2
    change = (ahead.residual - behind.residual)[seen] / (2 * step)
    derivative = at.jacobian[axis, seen]
    error, size = (np.sqrt(np.mean(values**2)) for values in (change - derivative, derivative))
    # the camera turns a little while it reads a wall, and grey levels are whole
    assert error < 0.1 * size


def test_residuals_are_zero_where_model_and_frame_are_the_same() -> None:
    problem = of_wall(0)
    at_rest = problem._replace(
        depth_exposure=problem.depth_exposure._replace(twist=AT_REST),
        image_exposure=problem.image_exposure._replace(twist=AT_REST),
    )
    planes, _, fit = plane_residuals(np.eye(4), at_rest)
    pixels, _ = pixel_residuals(np.eye(4), at_rest, AS_SEEN)
    assert fit.agreeing == np.count_nonzero(planes.weight) > 4000
    assert np.count_nonzero(pixels.weight) > 4000
    np.testing.assert_allclose(planes.residual[planes.weight > 0], 0, atol=1e-5)
    np.testing.assert_allclose(pixels.residual[pixels.weight > 0], 0, atol=1e-2)
