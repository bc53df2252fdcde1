"""The pinhole camera: projection and back-projection."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64


def back_project(uv: Float32 | Float64, z: Float64, intrinsics: CameraIntrinsics) -> Float64:
    """Points [N, 3] in the optical frame at pixels uv [N, 2] and depths z [N], metres."""
    x = (uv[:, 0] - intrinsics.cx) / intrinsics.fx * z
    y = (uv[:, 1] - intrinsics.cy) / intrinsics.fy * z
    return np.stack([x, y, z], axis=1).astype(np.float64)


def project(points: Float64, intrinsics: CameraIntrinsics) -> Float64:
    """Pixels [N, 2] of points [N, 3] in the optical frame; NaN for points not in front."""
    z = np.where(points[:, 2] > 1e-6, points[:, 2], np.nan)
    u = intrinsics.fx * points[:, 0] / z + intrinsics.cx
    v = intrinsics.fy * points[:, 1] / z + intrinsics.cy
    return np.stack([u, v], axis=1)


def cloud(depth: Float32, intrinsics: CameraIntrinsics) -> Float64:
    """All points [N, 3] of a depth image in the optical frame, metres, without unknown ones."""
    v, u = np.nonzero(np.isfinite(depth))
    uv = np.stack([u, v], axis=1).astype(np.float64)
    return back_project(uv, depth[v, u].astype(np.float64), intrinsics)
