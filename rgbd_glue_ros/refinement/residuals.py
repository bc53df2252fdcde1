"""The residuals of planes and pixels at a pose, and their derivatives.

Residuals of planes are weighted by the depth noise, those of pixels by their own spread. Both have
Cauchy weights. Derivatives are for a perturbation on the left of the pose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rgbd_glue_ros.compiled import compiled, inlined
from rgbd_glue_ros.geometry.depth import SURFACE_SIGMAS, depth_at, depth_sigma
from rgbd_glue_ros.geometry.motion_compensation import displaced_point
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.projection import Projection, as_numbers, project
from rgbd_glue_ros.refinement.sampling import sample_visible
from rgbd_glue_ros.types import Float64, Mask

# Lateral accuracy of depth, limited by blurred depth edges and the lens.
_LATERAL_SIGMA_PX = 0.5

# A residual of at most this many standard deviations agrees.
AGREEING_SIGMAS = 3.0
# The standard deviation of a normal distribution is this many times its mean absolute value.
DEVIATION_OF_MEAN = 1.25

# Planes are as noisy as a sensor's from this spread on: it is 0.8 to 2 in recordings, and 0.2 to
# 0.5 in most rendered scenes, whose depth is exact.
_NOISY_SPREAD = 0.7


class Residuals(NamedTuple):
    """Residuals at a pose: of N planes in metres, or of N pixels in grey levels.

    Attributes:
        weight: float64 [N], 1 / m² or, for a pixel, the robust weight only; 0 where the image does
            not show the point, whose other values mean nothing.
        residual: float64 [N].
        jacobian: float64 [6, N].
        row_time: float64 [N], normalised time of the image row that shows the point.
    """

    weight: Float64
    residual: Float64
    jacobian: Float64
    row_time: Float64


class PlaneFit(NamedTuple):
    """How planes fit a depth image.

    Attributes:
        seen: number of planes that project onto known depth.
        agreeing: number of these that agree.
        occluded: number of these that are occluded.
        spread: standard deviation of the residuals of the others, in that of depth noise.
    """

    seen: int
    agreeing: int
    occluded: int
    spread: float


@compiled
def plane_residuals(T: Float64, problem: LevelProblem) -> tuple[Residuals, Float64, PlaneFit]:
    """The distances of measured points from the planes, at T.

    Returns:
        The residuals; their squares in units of their variance, float64 [N]; and how planes fit.
    """
    seen = project(T, problem.points, problem.depth_exposure)
    measured = depth_at(problem.depth, seen.u, seen.v, problem.depth_noise)
    residuals, squared = _distances(T, problem, seen, measured)
    return residuals, squared, _plane_fit(seen.z, measured, residuals.weight, squared)


@compiled
def visible_planes(T: Float64, problem: LevelProblem) -> tuple[Mask, Mask]:
    """Which planes a frame shows at T and nothing hides, and which of them agree; bool [N] each."""
    seen = project(T, problem.points, problem.depth_exposure)
    measured = depth_at(problem.depth, seen.u, seen.v, problem.depth_noise)
    residuals, squared = _distances(T, problem, seen, measured)
    size = len(measured)
    visible, agrees = np.empty(size, np.bool_), np.empty(size, np.bool_)
    for i in range(size):
        fits = residuals.weight[i] > 0.0
        visible[i] = fits | (measured[i] >= seen.z[i])
        agrees[i] = fits & (squared[i] < AGREEING_SIGMAS**2)
    return visible, agrees


@compiled
def weight_of_pixels(problem: LevelProblem, planes: PlaneFit) -> float:
    """The weight of a pixel relative to a plane.

    Planes that fit better than a sensor's depth can are exact, and hold a pose on their own.
    """
    noisy = min((planes.spread / _NOISY_SPREAD) ** 2, 1.0)
    return problem.pixel_weight + noisy * (problem.noisy_pixel_weight - problem.pixel_weight)


@compiled
def pixel_residuals(
    T_model_camera: Float64, problem: LevelProblem, affine_brightness: Float64
) -> tuple[Residuals, Float64]:
    """The differences in brightness of the pixels, at a pose and with ``affine_brightness``.

    Returns:
        The residuals of the pixels that are in the image and not occluded; and the brightness of
        the image there, float64 [M].
    """
    seen = project(T_model_camera, problem.pixels, problem.image_exposure)
    is_visible, brightness, gradient = sample_visible(seen, problem)
    T = as_numbers(T_model_camera)
    X, Y, Z = problem.pixels[0], problem.pixels[1], problem.pixels[2]
    expected, gradient_u, gradient_v = problem.brightness, gradient[0], gradient[1]
    fx, fy, cx, cy = problem.image_exposure.K
    gain, bias = affine_brightness[0], affine_brightness[1]
    half_weight = problem.pixel_cauchy * affine_brightness[2]
    u, v, z = seen.u, seen.v, seen.z
    size = len(u)
    weight, residual, jacobian = np.empty(size), np.empty(size), np.empty((6, size))
    J0, J1, J2 = jacobian[0], jacobian[1], jacobian[2]
    J3, J4, J5 = jacobian[3], jacobian[4], jacobian[5]
    for i in range(size):
        r = gain * brightness[i] + bias - expected[i]
        weight[i] = 1.0 / (1.0 + (r / half_weight) ** 2) if is_visible[i] else 0.0
        residual[i] = r
        x, y = (u[i] - cx) / fx, (v[i] - cy) / fy
        gx, gy = gain * gradient_u[i] * fx / z[i], gain * gradient_v[i] * fy / z[i]
        # the point moves by -R^T (v + omega x X) in the camera, for a left perturbation of T
        j0 = -gx * (T[0][0] - x * T[0][2]) - gy * (T[0][1] - y * T[0][2])
        j1 = -gx * (T[1][0] - x * T[1][2]) - gy * (T[1][1] - y * T[1][2])
        j2 = -gx * (T[2][0] - x * T[2][2]) - gy * (T[2][1] - y * T[2][2])
        J0[i], J1[i], J2[i] = j0, j1, j2
        J3[i], J4[i], J5[i] = by_rotation(X[i], Y[i], Z[i], j0, j1, j2)
    return Residuals(weight, residual, jacobian, seen.row_time), brightness


@inlined
def by_rotation(
    x: float, y: float, z: float, by_x: float, by_y: float, by_z: float
) -> tuple[float, float, float]:
    """The derivative of a point's residual by a rotation, from that by a translation.

    A perturbation v, omega moves a point X by v + omega x X. So the derivative by omega is the
    cross product of X and the derivative by v.
    """
    return y * by_z - z * by_y, z * by_x - x * by_z, x * by_y - y * by_x


@compiled
def plane_variance(
    nx: float, ny: float, nz: float, x: float, y: float, z: float, fx: float, noise: float
) -> float:
    """Variance of a measured point x, y, z along a normal, both in the optical frame, m².

    It consists of depth noise along the ray, which is ``noise`` times ``depth_sigma``, and lateral
    blur.
    """
    along = noise * depth_sigma(z) * (nx * x + ny * y + nz * z) / z
    lateral = _LATERAL_SIGMA_PX * z / fx
    return along * along + lateral * lateral * (nx * nx + ny * ny)


@compiled
def plane_variances(normals: Float64, points: Float64, fx: float, noise: float) -> Float64:
    """``plane_variance`` of points [N, 3] along normals [N, 3]; float64 [N]."""
    variances = np.empty(len(points))
    for i in range(len(points)):
        nx, ny, nz = normals[i, 0], normals[i, 1], normals[i, 2]
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        variances[i] = plane_variance(nx, ny, nz, x, y, z, fx, noise)
    return variances


@compiled
def _distances(
    T_model_camera: Float64, problem: LevelProblem, seen: Projection, measured: Float64
) -> tuple[Residuals, Float64]:
    """The distances of measured points from planes, and their squares in units of variance.

    Args:
        T_model_camera: float64 [4, 4].
        problem: the planes.
        seen: the planes in the depth image.
        measured: float64 [N], depth there, metres; NaN where it is unknown.
    """
    T = as_numbers(T_model_camera)
    points, normals = problem.points, problem.normals
    P0, P1, P2, N0, N1, N2 = points[0], points[1], points[2], normals[0], normals[1], normals[2]
    (fx, fy, cx, cy), _, twist, readout_time, delay = problem.depth_exposure
    cauchy_squared, noise = problem.plane_cauchy**2, problem.depth_noise
    u, v, row_time = seen.u, seen.v, seen.row_time
    size = len(measured)
    weight, residual, jacobian = np.empty(size), np.empty(size), np.empty((6, size))
    J0, J1, J2 = jacobian[0], jacobian[1], jacobian[2]
    J3, J4, J5 = jacobian[3], jacobian[4], jacobian[5]
    squared = np.empty(size)
    for i in range(size):
        is_known = measured[i] > 0.0
        z = measured[i] if is_known else 1.0
        x, y = (u[i] - cx) / fx * z, (v[i] - cy) / fy * z
        x, y, z = displaced_point(x, y, z, delay + row_time[i] * readout_time, twist)
        q0 = T[0][0] * x + T[0][1] * y + T[0][2] * z + T[0][3]
        q1 = T[1][0] * x + T[1][1] * y + T[1][2] * z + T[1][3]
        q2 = T[2][0] * x + T[2][1] * y + T[2][2] * z + T[2][3]
        n0, n1, n2 = N0[i], N1[i], N2[i]
        r = n0 * (q0 - P0[i]) + n1 * (q1 - P1[i]) + n2 * (q2 - P2[i])
        nx = T[0][0] * n0 + T[1][0] * n1 + T[2][0] * n2
        ny = T[0][1] * n0 + T[1][1] * n1 + T[2][1] * n2
        nz = T[0][2] * n0 + T[1][2] * n1 + T[2][2] * n2
        variance = plane_variance(nx, ny, nz, x, y, z, fx, noise)
        s = r * r / variance
        is_same_surface = is_known & (s <= SURFACE_SIGMAS**2)
        weight[i] = 1.0 / (variance * (1.0 + s / cauchy_squared)) if is_same_surface else 0.0
        residual[i], squared[i] = r, s
        J0[i], J1[i], J2[i] = n0, n1, n2
        J3[i], J4[i], J5[i] = by_rotation(q0, q1, q2, n0, n1, n2)
    return Residuals(weight, residual, jacobian, row_time), squared


@compiled
def _plane_fit(expected: Float64, measured: Float64, weight: Float64, squared: Float64) -> PlaneFit:
    """How planes fit, from expected and measured depths, weights and squared residuals [N]."""
    seen, fitting, agreeing, occluded, total = 0, 0, 0, 0, 0.0
    for i in range(len(measured)):
        is_known, fits = measured[i] > 0.0, weight[i] > 0.0
        seen += int(is_known)
        fitting += int(fits)
        agreeing += int(fits & (squared[i] < AGREEING_SIGMAS**2))
        occluded += int(is_known & (not fits) & (measured[i] < expected[i]))
    for i in range(len(measured)):
        if weight[i] > 0.0:
            total += min(math.sqrt(squared[i]), AGREEING_SIGMAS)
    spread = DEVIATION_OF_MEAN * total / max(fitting, 1)
    return PlaneFit(seen, agreeing, occluded, spread)
