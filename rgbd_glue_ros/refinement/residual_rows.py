"""All residuals of a model at a pose as rows, for what has more unknowns than the pose."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.residuals import (
    JACOBIAN,
    POINT,
    RESIDUAL,
    ROW_TIME,
    WEIGHT,
    pixel_residuals,
    plane_residuals,
)
from rgbd_glue_ros.types import Float64, Int64


class Rows(NamedTuple):
    """Residuals of planes or pixels, those that count.

    Attributes:
        point: int64 [N], which plane or pixel of the problem.
        weight: float64 [N].
        residual: float64 [N].
        jacobian: float64 [N, 6], by a perturbation on the left of T.
        row_time: float64 [N], normalised time of the image row that shows it.
    """

    point: Int64
    weight: Float64
    residual: Float64
    jacobian: Float64
    row_time: Float64


def plane_rows(T: Float64, problem: LevelProblem) -> Rows:
    """The residuals at T, metres, of the planes that the depth image shows."""
    return _rows(plane_residuals(T, problem)[0])


def pixel_rows(T: Float64, problem: LevelProblem, affine_brightness: Float64) -> Rows:
    """The residuals at T, grey levels, of the pixels that the image shows."""
    rows = _rows(pixel_residuals(T, problem, affine_brightness))
    sigma = affine_brightness[2]
    return rows._replace(weight=rows.weight * (problem.pixel_weight / (sigma * sigma)))


def squared_sigmas(rows: Rows, problem: LevelProblem) -> Float64:
    """The squares of planes' residuals divided by their standard deviations, float64 [N].

    A plane's weight is that of Cauchy divided by the variance, w = 1 / (σ² (1 + s / c²)) with
    s = r² / σ². So w r² = s / (1 + s / c²), and s = w r² / (1 - w r² / c²). Only what looks for a
    contradiction asks for s: in a column of its own, every step of Gauss-Newton would write it.

    Args:
        rows: of planes.
        problem: that they are of.
    """
    weighted = rows.weight * rows.residual**2
    squared: Float64 = weighted / (1 - weighted / problem.plane_cauchy**2)
    return squared


def extended_normal_equations(rows: Rows, *derivatives: Float64) -> tuple[Float64, Float64]:
    """Hessian [6 + K, 6 + K] and gradient [6 + K] for the pose and K other unknowns.

    Args:
        rows: residuals.
        derivatives: of these by the other unknowns, float64 [N] or [N, M] each; K columns in all.
    """
    J = np.column_stack([rows.jacobian, *derivatives])
    return normal_equations(J, rows.weight, rows.residual)


@compiled
def normal_equations(J: Float64, weight: Float64, residual: Float64) -> tuple[Float64, Float64]:
    """Hessian [K, K] and gradient [K] of weighted residuals with the derivatives J [N, K].

    Not by BLAS, whose last digits depend on how many threads it has.
    """
    size = J.shape[1]
    H, g = np.zeros((size, size)), np.zeros(size)
    for i in range(len(J)):
        for a in range(size):
            by_a = weight[i] * J[i, a]
            g[a] += by_a * residual[i]
            for b in range(a, size):
                H[a, b] += by_a * J[i, b]
    for a in range(size):
        for b in range(a):
            H[a, b] = H[b, a]
    return H, g


def _rows(table: Float64) -> Rows:
    return Rows(
        point=table[:, POINT].astype(np.int64),
        weight=table[:, WEIGHT],
        residual=table[:, RESIDUAL],
        jacobian=table[:, JACOBIAN : JACOBIAN + 6],
        row_time=table[:, ROW_TIME],
    )
