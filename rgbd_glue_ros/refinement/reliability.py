"""How much of the information on a pose is spurious: made by errors of the residuals' derivatives.

Normals err: by noise, and where a plane was fitted across an edge. In the normal equations these
errors do not cancel but add up, as squares, so that thousands of planes of a wall seem to hold a
camera that they let slide. That is the bias of least squares with errors in the variables. As
there, a second measurement of the variables shows it: how the residuals change when the pose is
moved, which rests on the depth image and hardly on the normals. The regression of the second on the
first is the reliability ratio (Fuller 1987, Measurement Error Models, 1.1): the part of the
information that is real.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.refinement.gauss_newton import Refinement
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.problem import RefinementProblem
from rgbd_glue_ros.refinement.residual_rows import Rows, plane_rows
from rgbd_glue_ros.types import Float64


def without_spurious_information(
    refinement: Refinement,
    T_expected: Float64,
    problem: RefinementProblem,
    reach: float,
) -> Refinement:
    """A refined pose without the spurious part of its information in the weakest direction.

    Where more than half is spurious, nothing is left: in that direction the search has measured
    nothing, and the pose is put where it was expected.

    Args:
        refinement: the pose.
        T_expected: the pose before the images were looked at, float64 [4, 4].
        problem: what it was refined by.
        reach: distance, metres and radians, over which residuals have to change. A pose that is
            known better than that is left as it is.
    """
    T, H = refinement.T_model_source, refinement.information
    # in the camera's frame, where a metre and a radian move what is seen about as much
    A, to_camera = se3.adjoint(T), se3.adjoint(se3.inverse(T))
    eigenvalues, directions = np.linalg.eigh(A.T @ H @ A)
    weakest = A @ directions[:, 0]
    as_one = problem.config.residuals_per_independent_one
    if eigenvalues[0] * reach**2 > as_one or not eigenvalues[0] > 0:
        return refinement
    spurious = _spurious_information(T, weakest, reach, problem.at_level(0))
    share = min(spurious / eigenvalues[0], 1.0)
    if share >= 1 / 2:
        share = 1.0
        off = float(directions[:, 0] @ to_camera @ se3.log(T @ se3.inverse(T_expected)))
        T = se3.exp(-off * weakest) @ T
    eigenvalues[0] *= 1 - share
    information = to_camera.T @ (directions * eigenvalues) @ directions.T @ to_camera
    return replace(refinement, T_model_source=T, information=information)


def _spurious_information(
    T: Float64, direction: Float64, reach: float, problem: LevelProblem
) -> float:
    """The part of the planes' information in a direction that the reliability ratio leaves out."""
    rows = plane_rows(T, problem)
    derivative = rows.jacobian @ direction
    ahead, behind = (
        _residuals(plane_rows(se3.exp(step * direction) @ T, problem), rows)
        for step in (reach, -reach)
    )
    change = (ahead - behind) / (2 * reach)
    known = np.isfinite(change)
    weighted = rows.weight[known] * derivative[known]
    expected, changed = float(weighted @ derivative[known]), float(weighted @ change[known])
    reliability = min(max(changed / max(expected, np.finfo(float).tiny), 0.0), 1.0)
    return (1 - reliability) * float(rows.weight @ derivative**2)


def _residuals(moved: Rows, rows: Rows) -> Float64:
    """The residuals at another pose of the same planes; NaN where they are not seen."""
    size = 1 + max(moved.point.max(initial=0), rows.point.max(initial=0))
    residuals = np.full(size, np.nan)
    residuals[moved.point] = moved.residual
    return residuals[rows.point]
