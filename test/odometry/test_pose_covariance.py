"""What the covariance of a pose counts: residuals that err alike, late images, a camera's scale."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from rigs.geometry import SEEDS
from rigs.room import room_view

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.odometry.motion_filter import Motion
from rgbd_glue_ros.odometry.pose_covariance import (
    UNKNOWN,
    PoseErrors,
    covariance_of,
    refined_covariance,
    timing_covariance,
    uncertain_part,
    unmeasured_part,
)
from rgbd_glue_ros.odometry.speeds import LOST_COVARIANCE
from rgbd_glue_ros.parameters import Config
from rgbd_glue_ros.refinement.gauss_newton import Refinement, evaluate_pose
from rgbd_glue_ros.refinement.model import model_of
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.types import Float64

CONFIG = Config()
EXACT = PoseErrors(residuals_per_independent_one=1.0, timing_error=0.0, scale_error=0.0)
MOVING = np.array([0.4, 0.0, 0.0, 0.0, 0.0, 0.5])


def refinement() -> Refinement:
    view = room_view(0.0)
    model = model_of(view, CONFIG.refine.grid_step)
    return evaluate_pose(np.eye(4), RefinementProblem(model, view, CONFIG.refine))


def covariance(errors: PoseErrors, twist: Float64, distance: float = 0.0) -> Float64:
    """Of a pose so far from the camera of its model."""
    T_model_anchor = se3.exp(np.array([distance, 0.0, 0.0, 0.0, 0.0, 0.0]))
    return refined_covariance(refinement(), T_model_anchor, twist, errors)


def test_errors_that_were_learnt_are_all_that_they_change_of_a_configuration() -> None:
    learnt = PoseErrors(123.0, 0.004, 0.01)
    applied = learnt.applied_to(CONFIG)
    assert PoseErrors.of(applied) == learnt
    assert PoseErrors.of(CONFIG).applied_to(applied) == CONFIG


def test_residuals_that_err_alike_count_as_one() -> None:
    alike = replace(EXACT, residuals_per_independent_one=9.0)
    at_rest = np.zeros(6)
    lost = np.linalg.inv(LOST_COVARIANCE)
    shown, shown_alike = (
        np.linalg.inv(covariance(errors, at_rest)) - lost for errors in (EXACT, alike)
    )
    np.testing.assert_allclose(9 * shown_alike, shown, rtol=1e-6, atol=1e-3)


def test_what_no_residual_shows_is_as_uncertain_as_the_pose_of_a_lost_camera() -> None:
    # in front of a wall without texture: only distance, roll and pitch
    one_plane = np.diag([0.0, 0.0, 1e6, 1e6, 1e6, 0.0])
    covariance = covariance_of(one_plane, 100.0)
    assert (np.linalg.eigvalsh(covariance) > 0).all()
    np.testing.assert_allclose(np.diag(covariance)[[0, 1, 5]], np.diag(LOST_COVARIANCE)[[0, 1, 5]])
    np.testing.assert_allclose(np.diag(covariance)[2:5], 1e-4, rtol=1e-3)


def test_a_late_image_is_off_by_what_the_camera_moved_meanwhile() -> None:
    late = replace(EXACT, timing_error=0.01)
    added = covariance(late, MOVING) - covariance(EXACT, MOVING)
    np.testing.assert_allclose(added, np.diag([0.004**2] * 3 + [0.005**2] * 3), atol=1e-12)
    motion = replace(Motion.start(0, np.eye(4)), twist=MOVING)
    np.testing.assert_allclose(timing_covariance(motion, late), added, atol=1e-12)


def test_a_wrong_scale_shows_in_proportion_to_the_distance() -> None:
    scaled = replace(EXACT, scale_error=0.01)
    added = covariance(scaled, MOVING, 0.5) - covariance(EXACT, MOVING, 0.5)
    np.testing.assert_allclose(added, np.diag([0.005**2] * 3 + [0.0] * 3), atol=1e-12)


@given(SEEDS, st.integers(0, 6))
def test_the_uncertain_part_of_a_twist_is_along_directions_that_are_not_known(
    seed: int, count: int
) -> None:
    rng = np.random.default_rng(seed)
    directions = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    sigmas = UNKNOWN * np.where(np.arange(6) < count, 2.0, 0.5)
    part = uncertain_part((directions * sigmas**2) @ directions.T)
    unknown = directions[:, :count]
    np.testing.assert_allclose(part @ unknown, unknown, atol=1e-9)
    np.testing.assert_allclose(part @ part, part, atol=1e-9)
    assert np.linalg.matrix_rank(part, tol=1e-6) == count


def test_a_pose_that_planes_of_one_wall_measure_is_unmeasured_along_it() -> None:
    T = se3.exp(np.array([0.3, -0.2, 0.5, 0.0, 0.0, 0.4]))
    in_camera = np.diag([0.0, 0.0, 1e6, 1e6, 1e6, 0.0])
    to_camera = se3.adjoint(se3.inverse(T))
    pose = replace(refinement(), T_model_source=T, information=to_camera.T @ in_camera @ to_camera)
    part = unmeasured_part(pose, 1.0)
    np.testing.assert_allclose(part, np.diag([1.0, 1, 0, 0, 0, 1]), atol=1e-6)
