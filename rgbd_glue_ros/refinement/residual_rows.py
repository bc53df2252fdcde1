"""All residuals of a model at a pose as rows, for problems with more unknowns than the pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.residuals import (
    Residuals,
    pixel_residuals,
    plane_residuals,
    weight_of_pixels,
)
from rgbd_glue_ros.types import Float64, Int64


class Rows(NamedTuple):
    """Residuals of the planes or pixels that are visible.

    Attributes:
        point: int64 [N], index of the plane or pixel in the problem.
        weight: float64 [N].
        residual: float64 [N].
        jacobian: float64 [N, 6], for a perturbation on the left of T.
        row_time: float64 [N], normalised time of the image row that shows the point.
    """

    point: Int64
    weight: Float64
    residual: Float64
    jacobian: Float64
    row_time: Float64


def plane_and_pixel_rows(
    T: Float64, problem: LevelProblem, affine_brightness: Float64
) -> tuple[Rows, Rows]:
    """Both at T; the weight of the pixels depends on the planes, which are compared only once."""
    residuals, _, planes = plane_residuals(T, problem)
    weight = weight_of_pixels(problem, planes)
    return _rows(residuals), _pixel_rows(T, problem, affine_brightness, weight)


def _rows(residuals: Residuals) -> Rows:
    seen = np.flatnonzero(residuals.weight)
    return Rows(
        point=seen,
        weight=residuals.weight[seen],
        residual=residuals.residual[seen],
        jacobian=np.ascontiguousarray(residuals.jacobian.T[seen]),
        row_time=residuals.row_time[seen],
    )


def _pixel_rows(
    T: Float64, problem: LevelProblem, affine_brightness: Float64, weight: float
) -> Rows:
    rows = _rows(pixel_residuals(T, problem, affine_brightness)[0])
    sigma = affine_brightness[2]
    return rows._replace(weight=rows.weight * (weight / (sigma * sigma)))
