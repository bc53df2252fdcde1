"""The residuals of a frame at its refined pose."""

from __future__ import annotations

from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import Rows, plane_and_pixel_rows


def rows_at(refinement: Refinement, problem: RefinementProblem, level: int) -> tuple[Rows, Rows]:
    """``plane_and_pixel_rows`` at a refined pose.

    Args:
        refinement: the pose of a frame in the model.
        problem: the problem that it was refined with.
        level: pyramid level.
    """
    T, of_level = refinement.T_model_source, problem.at_level(level)
    return plane_and_pixel_rows(T, of_level, refinement.affine_brightness)
