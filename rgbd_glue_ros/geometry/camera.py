"""The pinhole camera: projection and back-projection, and a frame prepared as a view."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from rgbd_glue_ros.geometry.contrast import contrast_of
from rgbd_glue_ros.geometry.depth import limit_depth
from rgbd_glue_ros.geometry.depth_noise import depth_noise_of
from rgbd_glue_ros.geometry.lens import undistorted, undistortion_maps
from rgbd_glue_ros.parameters import CameraConfig
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64, RgbdFrame, UInt8, View


def view_of(frame: RgbdFrame, camera: CameraConfig) -> View:
    """The frame without lens distortion, in grey, with depth in range.

    The view is that of a camera at rest: twist and row times are not set.
    """
    frame = rectified(frame)
    image, depth = grey(frame.color), limit_depth(frame.depth, camera)
    contrast = contrast_of(image, camera.well_lit_gradient)
    noise = depth_noise_of(depth)
    return View(image, depth, frame.intrinsics, contrast=contrast, depth_noise=noise)


def grey(color: UInt8) -> UInt8:
    """The luminance, uint8 [H, W], of an image [H, W] or [H, W, 3] RGB."""
    if color.ndim == 2:
        # a copy, since read-only arrays would need another compilation
        return np.array(color, np.uint8, order="C")
    return np.asarray(cv2.cvtColor(color, cv2.COLOR_RGB2GRAY), np.uint8)


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


def rectified(frame: RgbdFrame) -> RgbdFrame:
    """The frame without lens distortion; the same object if it has none.

    Colour is interpolated, depth takes the nearest pixel so that edges are not smeared.
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
