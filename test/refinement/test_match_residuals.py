"""Visual matches hold a pose where planes and pixels leave it open."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from rigs.geometry import SEEDS

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.gauss_newton import refine
from rgbd_glue_ros.refinement.model import Model, model_of
from rgbd_glue_ros.refinement.problem import NO_MATCHES, RefinementProblem
from rgbd_glue_ros.types import CameraIntrinsics, Correspondences, Float64, View

CONFIG = RefineConfig(iterations=15)
CAMERA = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
TRUTH = se3.exp(np.array([0.08, -0.03, 0.05, 0.02, -0.04, 0.03]))


def view(metres: float) -> View:
    """A blank wall so far away; NaN for nothing at all."""
    depth = np.full((240, 320), metres, np.float32)
    return View(np.full((240, 320), 200, np.uint8), depth, CAMERA)


def matches(T_model_source: Float64, count: int, seed: int = 0) -> Correspondences:
    """Points that the frame sees, and where they are in the model."""
    points = np.random.default_rng(seed).uniform([-0.8, -0.6, 1.0], [0.8, 0.6, 3.0], (count, 3))
    return Correspondences(points, se3.transform(T_model_source, points), np.ones(count))


def refined(start: Float64, model: Model, source: View, by: Correspondences) -> Float64:
    return refine(start, RefinementProblem(model, source, CONFIG, by)).T_model_source


@given(SEEDS)
@settings(max_examples=10)
def test_matches_alone_lead_to_the_true_pose(seed: int) -> None:
    nothing = view(np.nan)
    off = se3.exp(np.random.default_rng(seed).normal(0, 0.01, 6))
    found = refined(off @ TRUTH, model_of(nothing, 8), nothing, matches(TRUTH, 40, seed))
    np.testing.assert_allclose(found, TRUTH, atol=1e-4)


def test_along_a_blank_wall_matches_determine_the_pose() -> None:
    wall, walked = view(2.0), se3.exp(np.array([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]))
    model = model_of(wall, 8)
    stuck = refined(np.eye(4), model, wall, NO_MATCHES)
    np.testing.assert_allclose(stuck, np.eye(4), atol=1e-3)
    held = refined(np.eye(4), model, wall, matches(walked, 15))
    np.testing.assert_allclose(held, walked, atol=1e-3)


@pytest.mark.parametrize("wrong", [3, 10])
def test_wrong_matches_among_right_ones_hardly_move_the_pose(wrong: int) -> None:
    nothing = view(np.nan)
    elsewhere = se3.exp(np.array([0.3, 0.2, 0.0, 0.0, 0.0, 0.2])) @ TRUTH
    both = matches(TRUTH, 40) + matches(elsewhere, wrong, seed=1)
    found = refined(TRUTH, model_of(nothing, 8), nothing, both)
    np.testing.assert_allclose(found, TRUTH, atol=2e-3)
