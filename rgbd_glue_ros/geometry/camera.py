"""From pixels to points: back-projection, depth at keypoints, depth noise, rectification."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry.lens import undistorted, undistortion_maps
from rgbd_glue_ros.parameters import CameraConfig
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


@compiled
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
    return np.asarray(_limited(depth, limits.depth_min, limits.depth_max), np.float32)


@compiled
def _limited(depth: Float32, nearest: float, farthest: float) -> Float32:
    limited = np.empty(depth.shape, np.float32)
    for v in range(depth.shape[0]):
        for u in range(depth.shape[1]):
            z = depth[v, u]
            # both comparisons are made, so that there is no branch
            limited[v, u] = z if (z >= nearest) & (z <= farthest) else np.float32(np.nan)
    return limited


def back_project(uv: Float32 | Float64, z: Float64, intrinsics: CameraIntrinsics) -> Float64:
    """Points [N, 3] in the optical frame at pixels uv [N, 2] and depths z [N], metres."""
    x = (uv[:, 0] - intrinsics.cx) / intrinsics.fx * z
    y = (uv[:, 1] - intrinsics.cy) / intrinsics.fy * z
    return np.stack([x, y, z], axis=1).astype(np.float64)


def normalised_row_time(rows: Float32 | Float64 | Int64, view: View) -> Float64:
    """When a rolling shutter is at rows [N], in parts of its way: 0 at the middle row."""
    return np.asarray(rows / view.intrinsics.height - 0.5, np.float64)


def apparent_velocity(points: Float64, twist: Float64) -> Float64:
    """How much later-seen points [N, 3] of a still room have to be moved, m/s, to lie together.

    A camera that moves with ``twist`` [6] sees a point pass by with the opposite velocity.
    """
    velocity: Float64 = twist[:3] + np.cross(twist[3:], points)
    return velocity


def displaced_points(points: Float64, seconds: Float64, twist: Float64) -> Float64:
    """Points where a camera that moves with ``twist`` saw them some seconds before.

    Args:
        points: float64 [..., 3], metres.
        seconds: for each of them, float64 [...], or what broadcasts to it.
        twist: float64 [6], linear and angular velocity in the optical frame.
    """
    moved: Float64 = points + seconds[..., np.newaxis] * apparent_velocity(points, twist)
    return moved


def seconds_after_color(rows: Int64, view: View) -> Float64:
    """When the rows [N] of the depth image were read, from the middle row of colour on."""
    seconds: Float64 = view.depth_delay + view.readout_time * normalised_row_time(rows, view)
    return seconds


def keypoints_to_points(uv: Float32, view: View) -> tuple[Float64, NDArray[np.bool_]]:
    """Pixels of the colour image as points, where their depth is known.

    Args:
        uv: float32 [N, 2].
        view: the frame.

    Returns:
        Points [M, 3] as seen when the middle row is read, and which pixels [N] have one.
    """
    motion = view.twist * view.depth_delay
    z = _delayed_depth_at(view.depth, uv, view.intrinsics.focal_and_centre, motion)
    known = np.isfinite(z)
    points = back_project(uv[known], z[known], view.intrinsics)
    return displaced_points(
        points, view.readout_time * normalised_row_time(uv[known, 1], view), view.twist
    ), known


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


@compiled
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


@compiled
def depth_at(depth: Float32, uv: Float32) -> Float64:
    """``sample_depth`` at each of the pixels uv [N, 2]; float64 [N]."""
    z = np.empty(len(uv))
    for i in range(len(uv)):
        z[i] = sample_depth(depth, uv[i, 0], uv[i, 1])
    return z


@compiled
def displaced_point(
    x: float, y: float, z: float, seconds: float, twist: Float64
) -> tuple[float, float, float]:
    """``displaced_points`` of one point."""
    return (
        x + seconds * (twist[0] + twist[4] * z - twist[5] * y),
        y + seconds * (twist[1] + twist[5] * x - twist[3] * z),
        z + seconds * (twist[2] + twist[3] * y - twist[4] * x),
    )


@compiled
def _delayed_depth_at(depth: Float32, uv: Float32, K: Float64, motion: Float64) -> Float64:
    """Depth [N] at pixels uv [N, 2] of an image taken before the camera moved by ``motion`` [6]."""
    found = np.empty(len(uv))
    for i in range(len(uv)):
        rx, ry = (uv[i, 0] - K[2]) / K[0], (uv[i, 1] - K[3]) / K[1]
        z = sample_depth(depth, uv[i, 0], uv[i, 1])
        # where the depth image has what is at the pixel depends on how far that is
        for _ in range(2):
            x, y, later = displaced_point(rx * z, ry * z, z, -1.0, motion)
            if not later > 0.0:
                z = np.nan
                break
            measured = sample_depth(depth, K[0] * x / later + K[2], K[1] * y / later + K[3])
            _, _, z = displaced_point(
                x / later * measured, y / later * measured, measured, 1.0, motion
            )
        found[i] = z
    return found


def rectified(frame: RgbdFrame) -> RgbdFrame:
    """The frame without lens distortion; the same object if it has none.

    Colour is interpolated, depth takes the nearest pixel so that no edge is smeared.
    """
    if not any(frame.intrinsics.distortion):
        return frame
    map_x, map_y = undistortion_maps(frame.intrinsics)
    color, straight = undistorted(frame.color, frame.intrinsics)
    depth = cv2.remap(frame.depth, map_x, map_y, cv2.INTER_NEAREST, borderValue=(float("nan"),) * 4)
    return replace(
        frame,
        color=color,
        depth=np.asarray(depth, np.float32),
        intrinsics=straight,
    )
