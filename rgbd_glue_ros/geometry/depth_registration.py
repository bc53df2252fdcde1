"""Transfers a depth image to the view of the colour camera: other lens, resolution and pose.

Neighbouring depth pixels on one surface span triangles, which are drawn into the colour image with
a z-buffer. Along a triangle the inverse depth is interpolated, which is exact for planes, so a
surface has no steps where the colour image is finer and no averages where it is coarser. Edges
are not spanned: what only one of the two cameras sees remains unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry.depth import DEPTH_EDGE_SIGMAS, depth_sigma
from rgbd_glue_ros.geometry.lens import rays
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64, LensModel

_Point = tuple[float, float, float]
"""A point's pixel (u, v) in the colour image and its depth z."""

# No surface is this many times nearer to the colour camera than to the depth camera, and appears
# as many times larger; if one seems to be, numbers are wrong.
NEARER = 4.0
# Triangles that share an edge miss no pixel on it.
_ROUNDING = 1e-4
# Beyond the image a lens model may fold back and produce points in the image that are not there.
_LENS_MARGIN = 1.05
# The number of lens coefficients that the projection takes: k1 k2 p1 p2 k3 k4 k5 k6.
_COEFFICIENTS = 8


@dataclass(frozen=True)
class DepthCamera:
    """The camera that took a depth image which is not registered to colour.

    Attributes:
        intrinsics: of the depth image.
        T_color_depth: float64 [4, 4], its optical frame in that of the colour camera.
    """

    intrinsics: CameraIntrinsics
    T_color_depth: Float64


def can_project(color: CameraIntrinsics) -> bool:
    """Whether ``registered`` supports the lens of a colour camera."""
    if not any(color.distortion):
        return True
    is_known = color.lens is LensModel.BROWN_CONRADY
    return is_known and not any(color.distortion[_COEFFICIENTS:])


def registered(depth: Float32, camera: DepthCamera, color: CameraIntrinsics) -> Float32:
    """The depth image that the colour camera would have taken.

    Args:
        depth: float32 [h, w], metres along the depth camera's axis, NaN where unknown.
        camera: the one that took it.
        color: intrinsics of the colour camera, which ``can_project``; its distortion is kept.

    Returns:
        float32 [H, W] of the colour camera's size, metres along its axis; the nearest surface
        if several are behind one pixel, NaN where none was seen.
    """
    focal, distortion, reach = _lens(color)
    points = _seen(depth, rays(camera.intrinsics), camera.T_color_depth, focal, distortion, reach)
    span = NEARER * max(1.0, color.fx / camera.intrinsics.fx, color.fy / camera.intrinsics.fy)
    image = np.full((color.height, color.width), np.inf, np.float32)
    _draw(depth, points, span, image)
    image[np.isinf(image)] = np.nan
    return image


@lru_cache(maxsize=4)
def _lens(camera: CameraIntrinsics) -> tuple[Float64, Float64, float]:
    """Focal lengths and centre [4], k1 k2 p1 p2 k3 k4 k5 k6 [8], and the limit of its rays."""
    seen = rays(camera)
    border = np.concatenate([seen[0], seen[-1], seen[:, 0], seen[:, -1]])
    # rays that a lens cannot have are NaN
    reach = float(np.nanmax(np.linalg.norm(border, axis=1))) * _LENS_MARGIN
    focal = camera.focal_and_centre
    distortion = np.zeros(_COEFFICIENTS)
    given = camera.distortion[:_COEFFICIENTS]
    distortion[: len(given)] = given
    return focal, distortion, reach


@compiled
def _seen(
    depth: Float32, rays: Float64, T: Float64, focal: Float64, lens: Float64, reach: float
) -> Float64:
    """Pixel and depth (u, v, z) of every depth pixel in the colour camera, NaN outside its view."""
    height, width = depth.shape
    points = np.full((height, width, 3), np.nan)
    k1, k2, p1, p2, k3, k4, k5, k6 = lens
    for row in range(height):
        for column in range(width):
            d = float(depth[row, column])
            if not d > 0.0:
                continue
            rx, ry = rays[row, column]
            z = d * (T[2, 0] * rx + T[2, 1] * ry + T[2, 2]) + T[2, 3]
            if not z > 0.0:
                continue
            x = (d * (T[0, 0] * rx + T[0, 1] * ry + T[0, 2]) + T[0, 3]) / z
            y = (d * (T[1, 0] * rx + T[1, 1] * ry + T[1, 2]) + T[1, 3]) / z
            r2 = x * x + y * y
            if not r2 < reach * reach:
                continue
            # the model of OpenCV and of sensor_msgs/CameraInfo
            radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)))
            x_lens = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
            y_lens = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
            points[row, column, 0] = focal[0] * x_lens + focal[2]
            points[row, column, 1] = focal[1] * y_lens + focal[3]
            points[row, column, 2] = z
    return points


@compiled
def _draw(depth: Float32, points: Float64, span: float, image: Float32) -> None:
    """Draws triangles between neighbours, and points without neighbours, into a z-buffer."""
    height, width = depth.shape
    is_spanned = np.zeros((height, width), np.bool_)
    for row in range(height - 1):
        for column in range(width - 1):
            # two triangles, each turning from u to v as seen by the depth camera
            for turn in range(2):
                a = (row + turn, column + turn)
                b = (row + turn, column + 1 - turn)
                c = (row + 1 - turn, column + turn)
                if _is_one_surface(depth[a], depth[b], depth[c]):
                    _triangle(_point(points, a), _point(points, b), _point(points, c), span, image)
                    is_spanned[a] = is_spanned[b] = is_spanned[c] = True
    for row in range(height):
        for column in range(width):
            u, v, z = _point(points, (row, column))
            if z > 0.0 and not is_spanned[row, column]:
                i, j = round(v), round(u)
                if 0 <= i < image.shape[0] and 0 <= j < image.shape[1]:
                    image[i, j] = min(image[i, j], z)


@compiled
def _is_one_surface(a: float, b: float, c: float) -> bool:
    limit = DEPTH_EDGE_SIGMAS * depth_sigma(min(a, b, c))
    # a comparison with NaN is false: nothing is spanned next to unknown depth
    return bool(abs(a - b) < limit and abs(b - c) < limit and abs(c - a) < limit)


@compiled
def _point(points: Float64, at: tuple[int, int]) -> _Point:
    return points[at[0], at[1], 0], points[at[0], at[1], 1], points[at[0], at[1], 2]


@compiled
def _triangle(a: _Point, b: _Point, c: _Point, span: float, image: Float32) -> None:
    """Draws a triangle, unless it is seen from behind or larger than ``span`` pixels."""
    ub, vb, uc, vc = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    area = ub * vc - uc * vb
    left, right = min(0.0, ub, uc), max(0.0, ub, uc)
    top, bottom = min(0.0, vb, vc), max(0.0, vb, vc)
    if not (area > 0.0 and right - left < span and bottom - top < span):
        return
    height, width = image.shape
    first_column = max(math.ceil(left + a[0] - _ROUNDING), 0)
    last_column = min(math.floor(right + a[0] + _ROUNDING), width - 1)
    first_row = max(math.ceil(top + a[1] - _ROUNDING), 0)
    last_row = min(math.floor(bottom + a[1] + _ROUNDING), height - 1)
    for row in range(first_row, last_row + 1):
        v = row - a[1]
        for column in range(first_column, last_column + 1):
            u = column - a[0]
            # barycentric coordinates of the pixel's centre
            at_b, at_c = (u * vc - uc * v) / area, (ub * v - u * vb) / area
            at_a = 1.0 - at_b - at_c
            if min(at_a, at_b, at_c) >= -_ROUNDING:
                z = 1.0 / (at_a / a[2] + at_b / b[2] + at_c / c[2])
                image[row, column] = min(image[row, column], z)
