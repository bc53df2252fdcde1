"""The residuals of planes and pixels at a pose, and their derivatives.

Residuals of planes are weighted by the depth noise, those of pixels by their own spread. Both have
Cauchy weights. Derivatives are for a perturbation on the left of the pose.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rgbd_glue_ros.compiled import compiled, inlined
from rgbd_glue_ros.geometry.depth import SURFACE_SIGMAS, depth_sigma
from rgbd_glue_ros.geometry.motion_compensation import displaced_point
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.sampling import (
    NEAREST_M,
    brightness_at,
    gradient_at,
    inside,
    is_occluded,
    measured_point,
)
from rgbd_glue_ros.types import Float64

# Lateral accuracy of depth, limited by blurred depth edges and the lens.
_LATERAL_SIGMA_PX = 0.5

# A residual of at most this many standard deviations agrees.
AGREEING_SIGMAS = 3.0
# The standard deviation of a normal distribution is this many times its mean absolute value.
DEVIATION_OF_MEAN = 1.25

# The columns of a table of residuals: index of the plane or pixel, weight, residual, the first of
# six derivatives, and the normalised time of the image row that shows it.
POINT, WEIGHT, RESIDUAL, JACOBIAN, ROW_TIME = 0, 1, 2, 3, 9
_PLANE_COLUMNS = 10
# A table of pixels also has the brightness of the image.
IMAGE_BRIGHTNESS = 10
_PIXEL_COLUMNS = 11


# Planes are as noisy as a sensor's from this spread on: it is 0.8 to 2 in recordings, and 0.2 to
# 0.5 in most rendered scenes, whose depth is exact.
_NOISY_SPREAD = 0.7


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
def plane_residuals(T: Float64, problem: LevelProblem) -> tuple[Float64, PlaneFit]:
    """The distances of measured points from the planes, at T.

    Returns:
        A table, float64 [N, 10], with a row for each plane that the depth image shows and the
        columns ``POINT``, ``WEIGHT`` (1 / m²), ``RESIDUAL`` (metres), ``JACOBIAN`` and
        ``ROW_TIME``; and how the planes fit.
    """
    points, normals, depth = problem.points, problem.normals, problem.depth
    exposure, cauchy = problem.depth_exposure, problem.plane_cauchy
    K, height, twist, readout_time, delay = exposure
    table = np.empty((len(points), _PLANE_COLUMNS))
    n, seen, agreeing, occluded, total = 0, 0, 0, 0, 0.0
    for i in range(len(points)):
        x, y, expected, row_time = in_camera(T, points, i, K, height, twist, readout_time, delay)
        if expected <= 0.0:
            continue
        x, y, z = measured_point(depth, K, x, y, expected)
        if not z > 0.0:
            continue
        seen += 1
        is_nearer = z < expected
        x, y, z = displaced_point(x, y, z, delay + row_time * readout_time, twist)
        q0 = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z + T[0, 3]
        q1 = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z + T[1, 3]
        q2 = T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3]
        n0, n1, n2 = normals[i, 0], normals[i, 1], normals[i, 2]
        r = n0 * (q0 - points[i, 0]) + n1 * (q1 - points[i, 1]) + n2 * (q2 - points[i, 2])
        nx = T[0, 0] * n0 + T[1, 0] * n1 + T[2, 0] * n2
        ny = T[0, 1] * n0 + T[1, 1] * n1 + T[2, 1] * n2
        nz = T[0, 2] * n0 + T[1, 2] * n1 + T[2, 2] * n2
        variance = plane_variance(nx, ny, nz, x, y, z, K)
        squared = r * r / variance
        if squared > SURFACE_SIGMAS**2:
            occluded += int(is_nearer)
            continue
        if squared < AGREEING_SIGMAS**2:
            agreeing += 1
        total += min(math.sqrt(squared), AGREEING_SIGMAS)
        weight = 1.0 / (variance * (1.0 + squared / (cauchy * cauchy)))
        _write(table[n], i, weight, r, (n0, n1, n2), (q0, q1, q2), row_time)
        n += 1
    spread = DEVIATION_OF_MEAN * total / max(n, 1)
    return table[:n], PlaneFit(seen, agreeing, occluded, spread)


@compiled
def weight_of_pixels(problem: LevelProblem, planes: PlaneFit) -> float:
    """The weight of a pixel relative to a plane.

    Planes that fit better than a sensor's depth can are exact, and hold a pose on their own.
    """
    noisy = min((planes.spread / _NOISY_SPREAD) ** 2, 1.0)
    return problem.pixel_weight + noisy * (problem.noisy_pixel_weight - problem.pixel_weight)


@compiled
def pixel_residuals(T: Float64, problem: LevelProblem, affine_brightness: Float64) -> Float64:
    """The differences in brightness of the pixels, at T and with ``affine_brightness``.

    Returns:
        A table, float64 [N, 11], with a row for each pixel that is in the image and not occluded,
        and the columns ``POINT``, ``WEIGHT`` (the robust weight only), ``RESIDUAL`` (grey levels),
        ``JACOBIAN``, ``ROW_TIME`` and ``IMAGE_BRIGHTNESS``.
    """
    points, expected = problem.pixels, problem.brightness
    image, depth, cauchy = problem.image, problem.depth, problem.pixel_cauchy
    K_depth, depth_delay = problem.depth_exposure.K, problem.depth_exposure.delay
    K, height, twist, readout_time, delay = problem.image_exposure
    gain, bias, sigma = affine_brightness[0], affine_brightness[1], affine_brightness[2]
    table = np.empty((len(points), _PIXEL_COLUMNS))
    n = 0
    for i in range(len(points)):
        x, y, z, row_time = in_camera(T, points, i, K, height, twist, readout_time, delay)
        if z <= 0.0:
            continue
        in_depth = displaced_point(x, y, z, -depth_delay, twist)
        x, y = x / z, y / z
        u, v = K[0] * x + K[2], K[1] * y + K[3]
        # occluded by a nearer surface, or the surface has moved away
        if not inside(image, u, v) or is_occluded(
            depth, K_depth, in_depth[0], in_depth[1], in_depth[2]
        ):
            continue
        brightness = brightness_at(image, u, v)
        r = gain * brightness + bias - expected[i]
        gu, gv = gradient_at(image, u, v)
        gx, gy = gain * gu * K[0] / z, gain * gv * K[1] / z
        # the point moves by -R^T (v + omega x X) in the camera, for a left perturbation of T
        J0 = -gx * (T[0, 0] - x * T[0, 2]) - gy * (T[0, 1] - y * T[0, 2])
        J1 = -gx * (T[1, 0] - x * T[1, 2]) - gy * (T[1, 1] - y * T[1, 2])
        J2 = -gx * (T[2, 0] - x * T[2, 2]) - gy * (T[2, 1] - y * T[2, 2])
        weight = 1.0 / (1.0 + (r / (cauchy * sigma)) ** 2)
        point = points[i, 0], points[i, 1], points[i, 2]
        _write(table[n], i, weight, r, (J0, J1, J2), point, row_time)
        table[n, IMAGE_BRIGHTNESS] = brightness
        n += 1
    return table[:n]


@inlined
def _write(
    row: Float64,
    i: int,
    weight: float,
    residual: float,
    by_translation: tuple[float, float, float],
    point: tuple[float, float, float],
    row_time: float,
) -> None:
    """Writes the columns that planes and pixels share to a row of their table.

    A perturbation v, omega moves a point X by v + omega x X. So the derivative by omega is the
    cross product of X and the derivative by v.
    """
    J0, J1, J2 = by_translation
    p0, p1, p2 = point
    row[POINT], row[WEIGHT], row[RESIDUAL] = i, weight, residual
    row[JACOBIAN], row[JACOBIAN + 1], row[JACOBIAN + 2] = J0, J1, J2
    row[JACOBIAN + 3] = p1 * J2 - p2 * J1
    row[JACOBIAN + 4] = p2 * J0 - p0 * J2
    row[JACOBIAN + 5] = p0 * J1 - p1 * J0
    row[ROW_TIME] = row_time


@compiled
def in_camera(
    T: Float64,
    points: Float64,
    i: int,
    K: Float64,
    height: int,
    twist: Float64,
    readout_time: float,
    delay: float,
) -> tuple[float, float, float, float]:
    """Where and when the camera at T sees point i of a model.

    Args:
        T: T_model_camera when the middle row of the colour image is read, float64 [4, 4].
        points: float64 [N, 3], points of the model.
        i: index of the point.
        K: fx, fy, cx, cy of the image; this and the following are its ``Exposure``.
        height: image height, pixels.
        twist: float64 [6], velocity of the camera.
        readout_time: time from the first row to the last, seconds.
        delay: time from the colour image to this one, seconds.

    Returns:
        x, y, z in the optical frame when the point's row is read, and the normalised time of that
        row; z is not positive for a point behind the camera.
    """
    d0, d1, d2 = points[i, 0] - T[0, 3], points[i, 1] - T[1, 3], points[i, 2] - T[2, 3]
    z = T[0, 2] * d0 + T[1, 2] * d1 + T[2, 2] * d2
    if z < NEAREST_M:
        return 0.0, 0.0, -1.0, 0.0
    x = T[0, 0] * d0 + T[1, 0] * d1 + T[2, 0] * d2
    y = T[0, 1] * d0 + T[1, 1] * d1 + T[2, 1] * d2
    sx, sy, sz, row_time = x, y, z, 0.0
    # row and time depend on each other; two iterations converge to a hundredth of a pixel
    for _ in range(2):
        row_time = (K[1] * sy / sz + K[3]) / height - 0.5
        sx, sy, sz = displaced_point(x, y, z, -(delay + row_time * readout_time), twist)
        if sz < NEAREST_M:
            return 0.0, 0.0, -1.0, 0.0
    return sx, sy, sz, row_time


@compiled
def plane_variance(
    nx: float, ny: float, nz: float, x: float, y: float, z: float, K: Float64
) -> float:
    """Variance of a measured point x, y, z along a normal, both in the optical frame, m².

    It consists of depth noise along the ray and lateral blur.
    """
    along = depth_sigma(z) * (nx * x + ny * y + nz * z) / z
    lateral = _LATERAL_SIGMA_PX * z / K[0]
    return float(along * along + lateral * lateral * (nx * nx + ny * ny))
