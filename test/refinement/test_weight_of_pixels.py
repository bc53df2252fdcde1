"""How much pixels weigh beside planes, in images of different sizes and with different depth."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rgbd_glue_ros.geometry.depth import depth_sigma
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import plane_and_pixel_rows
from rgbd_glue_ros.refinement.residuals import plane_residuals, weight_of_pixels
from rgbd_glue_ros.types import CameraIntrinsics, View

CONFIG = RefineConfig()


def problem_of(width: int, depth_noise: float) -> LevelProblem:
    """The finest level of a wall on itself, with noise in standard deviations of a sensor."""
    random, height = np.random.default_rng(0), width * 3 // 4
    K = CameraIntrinsics(
        width=width, height=height, fx=width, fy=width, cx=width / 2, cy=height / 2
    )
    texture = random.integers(0, 255, (height, width)).astype(np.uint8)
    distance = np.full((height, width), 2.0, np.float32)
    view = View(np.asarray(cv2.GaussianBlur(texture, (5, 5), 0)), distance, K)
    noise = depth_noise * depth_sigma(2.0) * random.normal(size=distance.shape)
    now = replace(view, depth=(distance + noise).astype(np.float32))
    return RefinementProblem(model_of(view, CONFIG.grid_step), now, CONFIG).at_level(0)


@pytest.mark.parametrize(
    ("width", "depth_noise", "gain"),
    [
        (640, 0.0, 1.0),
        (640, 1.0, 1.0),
        (320, 0.0, 1.0),
        (320, 0.5, 1.5),
        (400, 1.0, 1.6),
        (320, 1.0, 2.0),
    ],
)
def test_pixels_weigh_more_in_smaller_images_as_far_as_depth_is_noisy(
    width: int, depth_noise: float, gain: float
) -> None:
    problem = problem_of(width, depth_noise)
    *_, planes = plane_residuals(np.eye(4), problem)
    weight = weight_of_pixels(problem, planes)
    assert weight == pytest.approx(gain * CONFIG.pixel_weight, rel=0.1)


def test_pixels_of_tiny_images_weigh_twice_as_much_and_no_more() -> None:
    problem = problem_of(80, depth_noise=2.0)
    assert problem.noisy_pixel_weight == 2 * CONFIG.pixel_weight


def test_the_spread_of_planes_is_that_of_the_noise_of_depth() -> None:
    for noise in (0.5, 1.0):
        *_, planes = plane_residuals(np.eye(4), problem_of(640, noise))
        assert planes.spread == pytest.approx(noise, rel=0.05)


def test_rows_of_pixels_have_the_weight_of_the_refinement() -> None:
    brightness = np.array([1.0, 0.0, 5.0])
    noisy = problem_of(320, depth_noise=1.0)
    alone = noisy._replace(noisy_pixel_weight=noisy.pixel_weight)
    *_, planes = plane_residuals(np.eye(4), noisy)
    of_noisy, of_alone = (
        plane_and_pixel_rows(np.eye(4), of, brightness)[1] for of in (noisy, alone)
    )
    gain = weight_of_pixels(noisy, planes) / noisy.pixel_weight
    np.testing.assert_allclose(of_noisy.weight, gain * of_alone.weight)
