"""Samples of a frame's images: brightness, its gradient, and the measured surface."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.compiled import compiled, inlined
from rgbd_glue_ros.geometry.depth import surface_tolerance
from rgbd_glue_ros.geometry.motion_compensation import displaced_point
from rgbd_glue_ros.refinement.level_problem import LevelProblem
from rgbd_glue_ros.refinement.projection import NEAREST_M, Projection
from rgbd_glue_ros.types import Float32, Float64, Mask, UInt8


@compiled
def is_inside(image: UInt8, u: float, v: float) -> bool:
    """Whether brightness and gradient can be sampled at pixel (u, v)."""
    height, width = image.shape
    return bool(u >= 1.0 and v >= 1.0 and u < width - 2.0 and v < height - 2.0)


@compiled
def brightness_and_gradient(image: UInt8, u: float, v: float) -> tuple[float, float, float]:
    """Bilinear brightness at pixel (u, v), and its central differences; only if ``is_inside``.

    A difference of bilinear values at points one pixel apart is bilinear in those of pixels.
    """
    u1, v1 = int(u), int(v)
    u0, u2, u3, v0, v2, v3 = u1 - 1, u1 + 1, u1 + 2, v1 - 1, v1 + 1, v1 + 2
    a, b = u - u1, v - v1
    c11, c12 = float(image[v1, u1]), float(image[v1, u2])
    c21, c22 = float(image[v2, u1]), float(image[v2, u2])
    brightness = _bilinear(a, b, c11, c12, c21, c22)
    along_u = _bilinear(
        a, b, c12 - image[v1, u0], image[v1, u3] - c11, c22 - image[v2, u0], image[v2, u3] - c21
    )
    along_v = _bilinear(
        a, b, c21 - image[v0, u1], c22 - image[v0, u2], image[v3, u1] - c11, image[v3, u2] - c12
    )
    return brightness, 0.5 * along_u, 0.5 * along_v


@inlined
def _bilinear(a: float, b: float, c00: float, c01: float, c10: float, c11: float) -> float:
    """The value between those of four pixels, a to the right and b below the first."""
    return (1 - b) * ((1 - a) * c00 + a * c01) + b * ((1 - a) * c10 + a * c11)


@compiled
def shows_another_surface(
    depth: Float32, K: tuple[float, ...], x: float, y: float, z: float, noise: float
) -> bool:
    """Whether depth shows another surface at the point x, y, z, in the depth camera's frame.

    That surface may be nearer, or farther if the point's own has moved away. False if depth is
    unknown. ``noise`` is that of depth, relative to ``depth_sigma``.
    """
    if z < NEAREST_M:
        return False
    row, column = int(K[1] * y / z + K[3] + 0.5), int(K[0] * x / z + K[2] + 0.5)
    if row < 0 or column < 0 or row >= depth.shape[0] or column >= depth.shape[1]:
        return False
    return bool(abs(depth[row, column] - z) > surface_tolerance(z, noise))


@compiled
def sample_visible(seen: Projection, problem: LevelProblem) -> tuple[Mask, Float64, Float64]:
    """Brightness and its gradient where pixels of a model are visible.

    Args:
        seen: the pixels in the image.
        problem: the frame at the image's level.

    Returns:
        Which pixels [M] are in the image, on the surface that it shows; the brightness [M] there,
        and its gradient [2, M]; 0 elsewhere.
    """
    image, depth = problem.image, problem.depth
    (fx, fy, cx, cy), twist = problem.image_exposure.K, problem.image_exposure.twist
    K_depth, depth_delay = problem.depth_exposure.K, problem.depth_exposure.delay
    size = len(seen.u)
    is_visible = np.zeros(size, np.bool_)
    brightness, gradient = np.zeros(size), np.zeros((2, size))
    for i in range(size):
        u, v, z = seen.u[i], seen.v[i], seen.z[i]
        if not is_inside(image, u, v):
            continue
        x, y = (u - cx) / fx * z, (v - cy) / fy * z
        x, y, z = displaced_point(x, y, z, -depth_delay, twist)
        if shows_another_surface(depth, K_depth, x, y, z, problem.depth_noise):
            continue
        is_visible[i] = True
        brightness[i], gradient[0, i], gradient[1, i] = brightness_and_gradient(image, u, v)
    return is_visible, brightness, gradient
