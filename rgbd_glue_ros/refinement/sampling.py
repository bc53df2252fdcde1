"""Samples of a frame's images: brightness, its gradient, and the measured surface."""

from __future__ import annotations

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry.depth import sample_depth, surface_tolerance
from rgbd_glue_ros.types import Float32, Float64, UInt8

# Points nearer than this are not visible.
NEAREST_M = 0.05


@compiled
def inside(image: UInt8, u: float, v: float) -> bool:
    """Whether brightness and gradient can be sampled at pixel (u, v)."""
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
def measured_point(
    depth: Float32, K: Float64, x: float, y: float, z: float
) -> tuple[float, float, float]:
    """The measured point on the ray through x, y, z; its z is NaN if depth is unknown."""
    rx, ry = x / z, y / z
    measured = sample_depth(depth, K[0] * rx + K[2], K[1] * ry + K[3])
    return rx * measured, ry * measured, measured


@compiled
def is_occluded(depth: Float32, K: Float64, x: float, y: float, z: float) -> bool:
    """Whether depth shows another surface at the point x, y, z, in the depth camera's frame.

    That surface may be nearer, or farther if the point's own has moved away. False if depth is
    unknown.
    """
    if z < NEAREST_M:
        return False
    row, column = int(K[1] * y / z + K[3] + 0.5), int(K[0] * x / z + K[2] + 0.5)
    if row < 0 or column < 0 or row >= depth.shape[0] or column >= depth.shape[1]:
        return False
    return bool(abs(depth[row, column] - z) > surface_tolerance(z))
