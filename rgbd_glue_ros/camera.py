"""From pixels to points: back-projection, depth at keypoints, depth noise, rectification."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from numba import njit

from rgbd_glue_ros.config import CameraConfig
from rgbd_glue_ros.types import (
    CameraIntrinsics,
    Float32,
    Float64,
    Int64,
    RgbdFrame,
    UInt8,
    View,
)

# A bilinear depth over a step larger than this many sigma would lie on neither surface.
DEPTH_EDGE_SIGMAS = 6.0


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def depth_sigma(z: float) -> float:
    """Standard deviation of a structured-light depth z, metres (Khoshelham and Elberink 2012).

    The form 0.0012 + 0.0019 (z - 0.4)^2 is that of Nguyen, Izadi and Lovell (3DIMPVT 2012).
    """
    return 0.0012 + 0.0019 * (z - 0.4) ** 2


def grey(color: UInt8) -> UInt8:
    """The luminance, uint8 [H, W], of an image [H, W] or [H, W, 3] RGB."""
    if color.ndim == 2:
        # a copy, as compiled code is compiled anew for arrays that cannot be written
        return np.array(color, np.uint8, order="C")
    return np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), np.uint8)


def limit_depth(depth: Float32, limits: CameraConfig) -> Float32:
    """A copy of ``depth`` with values outside [depth_min, depth_max] unknown (NaN)."""
    with np.errstate(invalid="ignore"):
        known = (depth >= limits.depth_min) & (depth <= limits.depth_max)
    return np.where(known, depth, np.float32(np.nan))


def back_project(uv: Float32 | Float64, z: Float64, intrinsics: CameraIntrinsics) -> Float64:
    """Points [N, 3] in the optical frame at pixels uv [N, 2] and depths z [N], metres."""
    x = (uv[:, 0] - intrinsics.cx) / intrinsics.fx * z
    y = (uv[:, 1] - intrinsics.cy) / intrinsics.fy * z
    return np.stack([x, y, z], axis=1).astype(np.float64)


def shutter_part(rows: Float32 | Float64 | Int64, view: View) -> Float64:
    """When a rolling shutter is at rows [N], in parts of its way: 0 at the middle row."""
    return np.asarray(rows / view.intrinsics.height - 0.5, np.float64)


def apparent_velocity(points: Float64, twist: Float64) -> Float64:
    """How much later-seen points [N, 3] of a still room have to be moved, m/s, to lie together.

    A camera that moves with ``twist`` [6] sees a point pass by with the opposite velocity.
    """
    velocity: Float64 = twist[:3] + np.cross(twist[3:], points)
    return velocity


def at_middle_row(points: Float64, part: Float64, view: View) -> Float64:
    """Points [N, 3] seen at parts [N] of the shutter's way, where the middle row would see them."""
    time = view.readout * part[:, np.newaxis]
    moved: Float64 = points + time * apparent_velocity(points, view.twist)
    return moved


def points_at(uv: Float32, z: Float64, view: View) -> Float64:
    """Points [N, 3] at pixels uv [N, 2] and depths z [N], as seen when the middle row is read."""
    return at_middle_row(back_project(uv, z, view.intrinsics), shutter_part(uv[:, 1], view), view)


def project(points: Float64, intrinsics: CameraIntrinsics) -> Float64:
    """Pixels [N, 2] of points [N, 3] in the optical frame; NaN for points not in front."""
    z = np.where(points[:, 2] > 1e-6, points[:, 2], np.nan)
    u = intrinsics.fx * points[:, 0] / z + intrinsics.cx
    v = intrinsics.fy * points[:, 1] / z + intrinsics.cy
    return np.stack([u, v], axis=1)


def cloud(depth: Float32, intrinsics: CameraIntrinsics) -> Float64:
    """All points [N, 3] of a depth image in the optical frame, metres, unknown ones left out."""
    v, u = np.nonzero(np.isfinite(depth))
    uv = np.stack([u, v], axis=1).astype(np.float64)
    return back_project(uv, depth[v, u].astype(np.float64), intrinsics)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def sample_depth(depth: Float32, u: float, v: float) -> float:
    """Bilinear depth at pixel (u, v); NaN outside, next to unknown depth and across edges."""
    height, width = depth.shape
    if not (u >= 0.0 and v >= 0.0 and u <= width - 1.0 and v <= height - 1.0):
        return np.nan
    u0, v0 = min(int(u), width - 2), min(int(v), height - 2)
    a, b = u - u0, v - v0
    z00, z01 = depth[v0, u0], depth[v0, u0 + 1]
    z10, z11 = depth[v0 + 1, u0], depth[v0 + 1, u0 + 1]
    nearest = min(z00, z01, z10, z11)
    farthest = max(z00, z01, z10, z11)
    # a comparison with NaN is false, so that an unknown neighbour is refused here too
    if not farthest - nearest < DEPTH_EDGE_SIGMAS * depth_sigma(nearest):
        return np.nan
    z = (1 - b) * ((1 - a) * z00 + a * z01) + b * ((1 - a) * z10 + a * z11)
    return float(z)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def depth_at(depth: Float32, uv: Float32) -> Float64:
    """``sample_depth`` at each of the pixels uv [N, 2]; float64 [N]."""
    z = np.empty(len(uv))
    for i in range(len(uv)):
        z[i] = sample_depth(depth, uv[i, 0], uv[i, 1])
    return z


def moved_depth(depth: Float32, T: Float64, intrinsics: CameraIntrinsics) -> Float32:
    """The depth image that a camera sees from where T moves the points.

    Args:
        depth: float32 [H, W], metres, NaN where unknown.
        T: T_new_old, float64 [4, 4], a small motion.
        intrinsics: of both images.

    Returns:
        float32 [H, W]; the nearest surface where several fall on a pixel, NaN where none does.
    """
    K = intrinsics
    return np.asarray(_moved_depth(depth, T, K.fx, K.fy, K.cx, K.cy), np.float32)


@njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _moved_depth(depth: Float32, T: Float64, fx: float, fy: float, cx: float, cy: float) -> Float32:
    height, width = depth.shape
    moved = np.full((height, width), np.nan, np.float32)
    for v in range(height):
        for u in range(width):
            z = depth[v, u]
            if not z > 0.0:
                continue
            x, y = (u - cx) / fx, (v - cy) / fy
            new_z = z * (T[2, 0] * x + T[2, 1] * y + T[2, 2]) + T[2, 3]
            if new_z <= 0.0:
                continue
            new_x = z * (T[0, 0] * x + T[0, 1] * y + T[0, 2]) + T[0, 3]
            new_y = z * (T[1, 0] * x + T[1, 1] * y + T[1, 2]) + T[1, 3]
            column = round(fx * new_x / new_z + cx)
            row = round(fy * new_y / new_z + cy)
            # a comparison with NaN is false: an empty pixel takes any depth
            if 0 <= column < width and 0 <= row < height and not moved[row, column] <= new_z:
                moved[row, column] = new_z
    return moved


def rectified(frame: RgbdFrame) -> RgbdFrame:
    """The frame without lens distortion; the same object if it has none.

    Colour is interpolated, depth takes the nearest pixel so that no edge is smeared.
    """
    if not any(frame.intrinsics.distortion):
        return frame
    map_x, map_y = _undistortion_maps(frame.intrinsics)
    color = cv2.remap(frame.color, map_x, map_y, cv2.INTER_LINEAR)
    depth = cv2.remap(frame.depth, map_x, map_y, cv2.INTER_NEAREST, borderValue=(float("nan"),) * 4)
    return replace(
        frame,
        color=np.asarray(color, np.uint8),
        depth=np.asarray(depth, np.float32),
        intrinsics=replace(frame.intrinsics, distortion=()),
    )


@lru_cache(maxsize=4)
def _undistortion_maps(intrinsics: CameraIntrinsics) -> tuple[Float32, Float32]:
    K = intrinsics.matrix
    size = (intrinsics.width, intrinsics.height)
    distortion = np.array(intrinsics.distortion)
    maps = cv2.initUndistortRectifyMap(K, distortion, np.eye(3), K, size, cv2.CV_32FC1)
    return np.asarray(maps[0], np.float32), np.asarray(maps[1], np.float32)
