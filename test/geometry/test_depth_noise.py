"""How noisy depth is, relative to what is expected of it, from one image of it."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.bag_frames import recorded_frames

from rgbd_glue_ros.geometry.depth import depth_sigmas
from rgbd_glue_ros.geometry.depth_noise import depth_noise_of
from rgbd_glue_ros.types import Float32


def slanted_wall() -> Float32:
    """Exact depth from 1.3 to 4 m."""
    v, u = np.mgrid[:240, :320]
    return np.asarray(1 / (0.25 + 0.001 * u + 0.0008 * v), np.float32)


def with_noise(depth: Float32, sigmas: float) -> Float32:
    noise = np.random.default_rng(0).normal(size=depth.shape)
    return np.asarray(depth + sigmas * depth_sigmas(depth) * noise, np.float32)


@pytest.mark.parametrize("sigmas", [2.5, 4.0, 6.0])
def test_the_noise_of_a_wall_is_found(sigmas: float) -> None:
    assert depth_noise_of(with_noise(slanted_wall(), sigmas)) == pytest.approx(sigmas, rel=0.1)


@pytest.mark.parametrize("sigmas", [0.0, 1.0])
def test_depth_as_exact_as_expected_has_no_more_noise_than_expected(sigmas: float) -> None:
    assert depth_noise_of(with_noise(slanted_wall(), sigmas)) == 1.0


def test_whole_steps_of_disparity_are_no_noise() -> None:
    px_metres = 575 * 0.075
    disparity = np.rint(8 * px_metres / slanted_wall()) / 8
    assert depth_noise_of((px_metres / disparity).astype(np.float32)) == 1.0


def test_furniture_is_no_noise() -> None:
    assert {depth_noise_of(frame.depth) for frame in recorded_frames()[::10]} == {1.0}


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (30, 40)])
def test_too_little_depth_is_taken_for_exact(shape: tuple[int, int]) -> None:
    assert depth_noise_of(np.full(shape, 2.0, np.float32)) == 1.0
    assert depth_noise_of(np.full((240, 320), np.nan, np.float32)) == 1.0
