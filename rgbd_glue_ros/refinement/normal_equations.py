"""Normal equations of residuals: Hessian and gradient, for the pose and for other unknowns."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.refinement.residual_rows import Rows
from rgbd_glue_ros.types import Float64

# Added to the Hessian: where neither planes nor pixels constrain the pose, it stays as it was.
DAMPING = 100.0


def extended_normal_equations(rows: Rows, *derivatives: Float64) -> tuple[Float64, Float64]:
    """Hessian [6 + K, 6 + K] and gradient [6 + K] for the pose and K other unknowns.

    Args:
        rows: residuals.
        derivatives: their derivatives by the other unknowns, float64 [N] or [N, M] each, with K
            columns in total.
    """
    J = np.column_stack([rows.jacobian, *derivatives])
    return normal_equations(J, rows.weight, rows.residual)


def marginalise_pose(H: Float64, g: Float64) -> tuple[Float64, Float64]:
    """Eliminates the pose from normal equations that have other unknowns too.

    Args:
        H: float64 [6 + K, 6 + K], Hessian for the pose and K other unknowns.
        g: float64 [6 + K], gradient.

    Returns:
        Hessian [K, K] and gradient [K] of the other unknowns.
    """
    elimination = H[6:, :6] @ np.linalg.inv(damped(H[:6, :6]))
    return H[6:, 6:] - elimination @ H[:6, 6:], g[6:] - elimination @ g[:6]


@compiled
def normal_equations(J: Float64, weight: Float64, residual: Float64) -> tuple[Float64, Float64]:
    """Hessian [K, K] and gradient [K] of weighted residuals with the derivatives J [N, K].

    Does not use BLAS, whose last digits depend on its number of threads.
    """
    size = J.shape[1]
    H, g = np.zeros((size, size)), np.zeros(size)
    for i in range(len(J)):
        for a in range(size):
            by_a = weight[i] * J[i, a]
            g[a] += by_a * residual[i]
            for b in range(a, size):
                H[a, b] += by_a * J[i, b]
    mirror_upper_triangle(H)
    return H, g


@compiled
def mirror_upper_triangle(H: Float64) -> None:
    """Copies the upper triangle of H [K, K] to the lower one."""
    for a in range(len(H)):
        for b in range(a):
            H[a, b] = H[b, a]


@compiled
def damped(H: Float64) -> Float64:
    """A Hessian [6, 6] with ``DAMPING`` on its diagonal, so that it can be inverted."""
    held: Float64 = H + DAMPING * np.eye(6)
    return held
