"""Where the planes and pixels of a model meet a frame: the residuals and how a pose moves them.

Those of planes are divided by the depth noise, those of pixels by their own spread; both have
Cauchy weights, and derivatives by a perturbation on the left of the pose.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rgbd_glue_ros.compiled import compiled, inlined
from rgbd_glue_ros.geometry.depth import (
    SURFACE_SIGMAS,
    depth_sigma,
    sample_depth,
    surface_tolerance,
)
from rgbd_glue_ros.geometry.motion_compensation import displaced_point
from rgbd_glue_ros.parameters import RefineConfig
from rgbd_glue_ros.refinement.model import Model
from rgbd_glue_ros.types import Float32, Float64, Int64, UInt8, View

# Blur of depth edges and lens: a depth belongs to a pixel only to about this accuracy.
_LATERAL_SIGMA_PX = 0.5
# Nearer than this nothing is seen.
NEAREST_M = 0.05


# A derivative by the pose, and that of what is not seen.
Six = tuple[float, float, float, float, float, float]
_NONE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class LevelProblem(NamedTuple):
    """A model and a frame at one level of the pyramid: all that residuals are made of but T.

    Attributes:
        points: float64 [N, 3] of planes.
        normals: float64 [N, 3].
        depth: float32 [H, W] of the frame.
        K_depth: float64 [4], fx, fy, cx, cy.
        pixels: float64 [M, 3], textured points.
        brightness: float64 [M] of these.
        image: uint8 [H / 2^level, W / 2^level] of the frame.
        K_image: float64 [4].
        twist: float64 [6], how the camera moves.
        readout_time: of its shutter, seconds.
        delay: of its depth, seconds.
        plane_cauchy: residual, in standard deviations, at which a plane's weight is halved.
        pixel_cauchy: that of a pixel.
        pixel_weight: of a pixel beside a plane.
    """

    points: Float64
    normals: Float64
    depth: Float32
    K_depth: Float64
    pixels: Float64
    brightness: Float64
    image: UInt8
    K_image: Float64
    twist: Float64
    readout_time: float
    delay: float
    plane_cauchy: float
    pixel_cauchy: float
    pixel_weight: float


def level_problem(
    model: Model, image: UInt8, level: int, source: View, config: RefineConfig
) -> LevelProblem:
    """A model and a frame at a level, of which ``image`` is that of the frame's pyramid.

    The planes are every 2^level-th of the model.
    """
    K = source.intrinsics.focal_and_centre
    thinned = slice(None, None, 2**level)
    return LevelProblem(
        np.ascontiguousarray(model.planes.points[thinned]),
        np.ascontiguousarray(model.planes.normals[thinned]),
        source.depth,
        K,
        model.pixels[level].points,
        model.pixels[level].brightness,
        image,
        # pyrDown centres pixel i of a level on pixel 2 i of the one below
        K / 2**level,
        source.twist,
        source.readout_time,
        source.depth_delay,
        config.plane_cauchy,
        config.pixel_cauchy,
        config.pixel_weight,
    )


class Rows(NamedTuple):
    """Residuals of planes or pixels, those that count.

    Attributes:
        point: int64 [N], which one of the meeting's.
        weight: float64 [N].
        residual: float64 [N].
        jacobian: float64 [N, 6], by a perturbation on the left of T.
        row_time: float64 [N], of the shutter's way at which each was seen.
    """

    point: Int64
    weight: Float64
    residual: Float64
    jacobian: Float64
    row_time: Float64


def plane_rows(T: Float64, problem: LevelProblem) -> Rows:
    """The residuals of the planes at T that are no other surface, metres."""
    return _rows(_plane_rows(T, problem))


def pixel_rows(T: Float64, problem: LevelProblem, affine_brightness: Float64) -> Rows:
    """The residuals of the pixels at T under ``affine_brightness``, grey levels."""
    return _rows(_pixel_rows(T, problem, affine_brightness))


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


@inlined
def _write(
    row: Float64, point: int, weight: float, residual: float, J: Six, row_time: float
) -> None:
    """Writes a residual as ``_rows`` reads it."""
    row[0], row[1], row[2], row[9] = point, weight, residual, row_time
    row[3], row[4], row[5], row[6], row[7], row[8] = J


def _rows(table: Float64) -> Rows:
    return Rows(table[:, 0].astype(np.int64), table[:, 1], table[:, 2], table[:, 3:9], table[:, 9])


@compiled
def _plane_rows(T: Float64, problem: LevelProblem) -> Float64:
    points, normals, depth, K = problem.points, problem.normals, problem.depth, problem.K_depth
    twist, readout_time, delay = problem.twist, problem.readout_time, problem.delay
    cauchy = problem.plane_cauchy
    table = np.empty((len(points), 10))
    n = 0
    for i in range(len(points)):
        seen, _, squared, w, r, J, row_time = plane_residual(
            T, points, normals, i, depth, K, twist, readout_time, delay, cauchy
        )
        if seen and squared <= SURFACE_SIGMAS**2:
            _write(table[n], i, w, r, J, row_time)
            n += 1
    return table[:n]


@compiled
def _pixel_rows(T: Float64, problem: LevelProblem, affine_brightness: Float64) -> Float64:
    points, brightness = problem.pixels, problem.brightness
    image, K = problem.image, problem.K_image
    depth, K_depth = problem.depth, problem.K_depth
    twist, readout_time, delay = problem.twist, problem.readout_time, problem.delay
    weight, cauchy = problem.pixel_weight, problem.pixel_cauchy
    sigma = affine_brightness[2]
    table = np.empty((len(points), 10))
    n = 0
    for i in range(len(points)):
        seen, _, w, r, J, row_time = pixel_residual(
            T,
            points,
            brightness,
            i,
            image,
            K,
            depth,
            K_depth,
            twist,
            readout_time,
            delay,
            affine_brightness,
            cauchy,
        )
        if seen:
            w *= weight / (sigma * sigma)
            _write(table[n], i, w, r, J, row_time)
            n += 1
    return table[:n]


@inlined
def plane_residual(
    T: Float64,
    points: Float64,
    normals: Float64,
    i: int,
    depth: Float32,
    K: Float64,
    twist: Float64,
    readout_time: float,
    delay: float,
    cauchy: float,
) -> tuple[bool, bool, float, float, float, Six, float]:
    """Distance of what is measured from plane i, at T.

    Returns:
        Whether depth is known there, whether something nearer is, the residual in variances, its
        weight, the residual in metres, its derivative, and the part of the shutter's way.
    """
    x, y, expected, row_time = in_camera(
        T, points, i, K, depth.shape[0], twist, readout_time, delay
    )
    if expected <= 0.0:
        return False, False, 0.0, 0.0, 0.0, _NONE, 0.0
    x, y, z = measured_point(depth, K, x, y, expected)
    if not z > 0.0:
        return False, False, 0.0, 0.0, 0.0, _NONE, 0.0
    nearer = z < expected
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
    w = 1.0 / (variance * (1.0 + squared / (cauchy * cauchy)))
    J = (n0, n1, n2, q1 * n2 - q2 * n1, q2 * n0 - q0 * n2, q0 * n1 - q1 * n0)
    return True, nearer, squared, w, r, J, row_time


@inlined
def pixel_residual(
    T: Float64,
    points: Float64,
    brightness: Float64,
    i: int,
    image: UInt8,
    K: Float64,
    depth: Float32,
    K_depth: Float64,
    twist: Float64,
    readout_time: float,
    delay: float,
    affine_brightness: Float64,
    cauchy: float,
) -> tuple[bool, float, float, float, Six, float]:
    """Difference in brightness of pixel i, at T and under ``affine_brightness``.

    Returns:
        Whether it is in the image and no other surface is there, the image's brightness, its
        robust weight, the residual, its derivative, and the part of the shutter's way.
    """
    x, y, z, row_time = in_camera(T, points, i, K, image.shape[0], twist, readout_time, 0.0)
    if z <= 0.0:
        return False, 0.0, 0.0, 0.0, _NONE, 0.0
    there = displaced_point(x, y, z, -delay, twist)
    x, y = x / z, y / z
    u, v = K[0] * x + K[2], K[1] * y + K[3]
    # where an edge passes in front, or what was seen has moved away
    if not inside(image, u, v) or is_occluded(depth, K_depth, there[0], there[1], there[2]):
        return False, 0.0, 0.0, 0.0, _NONE, 0.0
    gain, bias, sigma = affine_brightness[0], affine_brightness[1], affine_brightness[2]
    value = brightness_at(image, u, v)
    r = gain * value + bias - brightness[i]
    w = 1.0 / (1.0 + (r / (cauchy * sigma)) ** 2)
    gu, gv = gradient_at(image, u, v)
    gx, gy = gain * gu * K[0] / z, gain * gv * K[1] / z
    # the point moves by -R^T (v + omega x X) in the camera, for a left perturbation of T
    J0 = -gx * (T[0, 0] - x * T[0, 2]) - gy * (T[0, 1] - y * T[0, 2])
    J1 = -gx * (T[1, 0] - x * T[1, 2]) - gy * (T[1, 1] - y * T[1, 2])
    J2 = -gx * (T[2, 0] - x * T[2, 2]) - gy * (T[2, 1] - y * T[2, 2])
    p0, p1, p2 = points[i, 0], points[i, 1], points[i, 2]
    J = (J0, J1, J2, p1 * J2 - p2 * J1, p2 * J0 - p0 * J2, p0 * J1 - p1 * J0)
    return True, value, w, r, J, row_time


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
    """Point i of a model where the camera at T sees it, and when.

    Args:
        T: T_model_camera when the middle row of the colour image is read, float64 [4, 4].
        points: float64 [N, 3] of the model.
        i: which of them.
        K: fx, fy, cx, cy.
        height: of the image, pixels.
        twist: float64 [6], velocity of the camera.
        readout_time: seconds from the first row to the last.
        delay: seconds from the colour image to this one.

    Returns:
        x, y, z in the optical frame when the shutter is at the point's row, and that row's part
        of the shutter's way; a z that is not positive for a point behind the camera.
    """
    d0, d1, d2 = points[i, 0] - T[0, 3], points[i, 1] - T[1, 3], points[i, 2] - T[2, 3]
    z = T[0, 2] * d0 + T[1, 2] * d1 + T[2, 2] * d2
    if z < NEAREST_M:
        return 0.0, 0.0, -1.0, 0.0
    x = T[0, 0] * d0 + T[1, 0] * d1 + T[2, 0] * d2
    y = T[0, 1] * d0 + T[1, 1] * d1 + T[2, 1] * d2
    sx, sy, sz, row_time = x, y, z, 0.0
    # the row tells the time and the time the row; a second look is within a hundredth of a pixel
    for _ in range(2):
        row_time = (K[1] * sy / sz + K[3]) / height - 0.5
        sx, sy, sz = displaced_point(x, y, z, -(delay + row_time * readout_time), twist)
        if sz < NEAREST_M:
            return 0.0, 0.0, -1.0, 0.0
    return sx, sy, sz, row_time


@compiled
def measured_point(
    depth: Float32, K: Float64, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """The measured point on the ray through x, y, z; its z is NaN where depth is unknown."""
    rx, ry = x / z, y / z
    measured = sample_depth(depth, K[0] * rx + K[2], K[1] * ry + K[3])
    return rx * measured, ry * measured, measured


@compiled
def plane_variance(
    nx: float, ny: float, nz: float, x: float, y: float, z: float, K: Float64
) -> float:
    """Variance, m², of a measured point x, y, z along a normal, both in the optical frame.

    Depth noise along the ray, and lateral blur.
    """
    along = depth_sigma(z) * (nx * x + ny * y + nz * z) / z
    lateral = _LATERAL_SIGMA_PX * z / K[0]
    return float(along * along + lateral * lateral * (nx * nx + ny * ny))


@compiled
def inside(image: UInt8, u: float, v: float) -> bool:
    """Whether the brightness at pixel (u, v) and its gradient can be read."""
    height, width = image.shape
    return bool(u >= 1.0 and v >= 1.0 and u < width - 2.0 and v < height - 2.0)


@compiled
def brightness_at(image: UInt8, u: float, v: float) -> float:
    """Bilinear brightness at pixel (u, v), which must be ``inside``."""
    u0, v0 = int(u), int(v)
    a, b = u - u0, v - v0
    top = (1 - a) * image[v0, u0] + a * image[v0, u0 + 1]
    bottom = (1 - a) * image[v0 + 1, u0] + a * image[v0 + 1, u0 + 1]
    return float((1 - b) * top + b * bottom)


@compiled
def gradient_at(image: UInt8, u: float, v: float) -> tuple[float, float]:
    """Central differences of the brightness at pixel (u, v), which must be ``inside``."""
    gu = 0.5 * (brightness_at(image, u + 1.0, v) - brightness_at(image, u - 1.0, v))
    gv = 0.5 * (brightness_at(image, u, v + 1.0) - brightness_at(image, u, v - 1.0))
    return gu, gv


@compiled
def is_occluded(depth: Float32, K: Float64, x: float, y: float, z: float) -> bool:
    """Whether another surface is seen where a point is expected, in the depth image's own frame.

    Where depth is unknown, nothing says so.
    """
    if z < NEAREST_M:
        return False
    row, column = int(K[1] * y / z + K[3] + 0.5), int(K[0] * x / z + K[2] + 0.5)
    if row < 0 or column < 0 or row >= depth.shape[0] or column >= depth.shape[1]:
        return False
    return bool(abs(depth[row, column] - z) > surface_tolerance(z))
