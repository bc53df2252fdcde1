"""Planes of a depth image on a grid of pixels."""

from __future__ import annotations

import math

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry.depth import RECEDING, depth_sigma
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64, Int64, View

REFERENCE_PX = 640 * 480
"""The size of the image that distances in pixels refer to."""

# A plane is fitted to this many pixels to each side of a grid point, every second one.
_HALF_WINDOW = 6
_STRIDE = 2
_MIN_POINTS = 12
# Depth that is off a plane by more standard deviations is not of the plane.
_PLANE_SIGMAS = 4.0
# The cosine between normal and ray at 80 degrees; depth of surfaces seen flatter is unreliable.
_MIN_COSINE = 0.17


def relative_edge(view: View) -> float:
    """The edge length of an image relative to one of 640x480 pixels, for any aspect ratio."""
    height, width = view.grey.shape
    return math.sqrt(width * height / REFERENCE_PX)


def spacing_px(view: View, step: int) -> int:
    """The spacing of a grid with the same number of points in an image of any size.

    The cost and meaning of their counts then do not depend on the resolution.

    Args:
        view: a frame.
        step: the spacing in an image of 640x480, pixels.
    """
    return max(1, round(step * relative_edge(view)))


def widened_px(view: View, step: int) -> int:
    """The spacing that gives no more points in an image larger than 640x480.

    In a smaller one it stays the same: denser points are as much noise as scene.

    Args:
        view: a frame.
        step: the spacing in an image of 640x480, pixels.
    """
    return max(step, spacing_px(view, step))


def grid_points_and_normals(
    depth: Float32, intrinsics: CameraIntrinsics, step: int, noise: float = 1.0
) -> tuple[Float64, Float64]:
    """Every ``step``-th pixel as a point with the normal of the plane around it.

    Points lie on their planes, which averages depth noise.

    Args:
        depth: float32 [H, W], metres, NaN where unknown.
        intrinsics: of the depth image.
        step: pixels between grid points.
        noise: of depth, relative to ``depth_sigma``.

    Returns:
        Points and unit normals towards the camera, float64 [rows, columns, 3] in the optical
        frame; NaN where the surface is unknown, an edge, or seen too flat.
    """
    K = intrinsics
    return _points_and_normals(depth, K.fx, K.fy, K.cx, K.cy, step, noise)


@compiled
def _points_and_normals(
    depth: Float32, fx: float, fy: float, cx: float, cy: float, step: int, noise: float
) -> tuple[Float64, Float64]:
    height, width = depth.shape
    rows, columns = height // step, width // step
    points = np.full((rows, columns, 3), np.nan)
    normals = np.full((rows, columns, 3), np.nan)
    reach, stride = _HALF_WINDOW, _STRIDE
    for r in range(rows):
        v0 = r * step + step // 2
        for c in range(columns):
            u0 = c * step + step // 2
            z0 = depth[v0, u0]
            if not z0 > 0.0:
                continue
            # The inverse depth of a plane is linear in the pixel: 1/z = a + b du + d dv. Least
            # squares in inverse depth also has the right weights, as its noise hardly depends on z.
            gate = _PLANE_SIGMAS * noise * depth_sigma(z0) + RECEDING * z0
            n = 0
            su = sv = suu = suv = svv = sw = suw = svw = 0.0
            for v in range(max(0, v0 - reach), min(height, v0 + reach + 1), stride):
                for u in range(max(0, u0 - reach), min(width, u0 + reach + 1), stride):
                    z = depth[v, u]
                    if not abs(z - z0) < gate:
                        continue
                    du, dv, w = float(u - u0), float(v - v0), 1.0 / z
                    n += 1
                    su += du
                    sv += dv
                    suu += du * du
                    suv += du * dv
                    svv += dv * dv
                    sw += w
                    suw += du * w
                    svw += dv * w
            if n < _MIN_POINTS:
                continue
            mu, mv, mw = su / n, sv / n, sw / n
            cuu, cuv, cvv = suu / n - mu * mu, suv / n - mu * mv, svv / n - mv * mv
            cuw, cvw = suw / n - mu * mw, svw / n - mv * mw
            determinant = cuu * cvv - cuv * cuv
            if determinant < 1.0:
                continue
            b = (cuw * cvv - cvw * cuv) / determinant
            d = (cvw * cuu - cuw * cuv) / determinant
            a = mw - b * mu - d * mv
            if a <= 0.0:
                continue
            # 1/z = a + b du + d dv is n·X = -1 with the normal below, up to scale
            nx, ny = -b * fx, -d * fy
            nz = -(a - b * (u0 - cx) - d * (v0 - cy))
            length = math.sqrt(nx * nx + ny * ny + nz * nz)
            z = 1.0 / a
            if abs(z - z0) > gate:
                continue
            x, y = (u0 - cx) / fx * z, (v0 - cy) / fy * z
            cosine = -(nx * x + ny * y + nz * z) / (length * math.sqrt(x * x + y * y + z * z))
            if cosine < _MIN_COSINE:
                continue
            points[r, c, 0], points[r, c, 1], points[r, c, 2] = x, y, z
            normals[r, c, 0] = nx / length
            normals[r, c, 1] = ny / length
            normals[r, c, 2] = nz / length
    return points, normals


@compiled
def normals_of_nine(
    depth: Float32, K: tuple[float, ...], rows: Int64, columns: Int64, noise: float
) -> Float64:
    """Normals at given pixels, of the plane through a pixel and the eight at half a window from it.

    Near the border it is that of the nearest pixel that has eight others.

    Noisier than those of ``grid_points_and_normals``, but whatever the angle that a surface is seen
    at, noise does not decide which depths belong to it.

    Args:
        depth: float32 [H, W], metres, NaN where unknown.
        K: fx, fy, cx, cy of the depth image.
        rows: int64 [N].
        columns: int64 [N].
        noise: of depth, relative to ``depth_sigma``.

    Returns:
        Unit normals towards the camera, float64 [3, N] in the optical frame; NaN where one of the
        nine is unknown or not on the plane.
    """
    (fx, fy, cx, cy), (height, width), step = K, depth.shape, _HALF_WINDOW
    normals = np.full((3, len(rows)), np.nan)
    if height <= 2 * step or width <= 2 * step:
        return normals
    nine = np.empty((3, 3))
    for i in range(len(rows)):
        v0 = min(max(rows[i], step), height - 1 - step)
        u0 = min(max(columns[i], step), width - 1 - step)
        for r in range(3):
            for c in range(3):
                nine[r, c] = 1.0 / depth[v0 + (r - 1) * step, u0 + (c - 1) * step]
        # least squares as above: 1/z = a + b du + d dv
        a = nine.mean()
        b = (nine[:, 2].sum() - nine[:, 0].sum()) / (6 * step)
        d = (nine[2].sum() - nine[0].sum()) / (6 * step)
        gate = _PLANE_SIGMAS * noise * depth_sigma(1.0 / a) * a * a
        is_plane = True
        for r in range(3):
            for c in range(3):
                on_plane = a + step * (b * (c - 1) + d * (r - 1))
                # false for NaN
                is_plane &= abs(nine[r, c] - on_plane) < gate
        if not is_plane:
            continue
        nx, ny, nz = -b * fx, -d * fy, -(a - b * (u0 - cx) - d * (v0 - cy))
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        normals[0, i], normals[1, i], normals[2, i] = nx / length, ny / length, nz / length
    return normals
