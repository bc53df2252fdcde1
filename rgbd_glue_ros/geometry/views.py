"""Frames as views: without lens distortion, in grey, with depth in range."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from rgbd_glue_ros.geometry.contrast import contrast_of
from rgbd_glue_ros.geometry.depth import limit_depth
from rgbd_glue_ros.geometry.depth_noise import depth_noise_of
from rgbd_glue_ros.geometry.lens import undistorted, undistortion_maps
from rgbd_glue_ros.parameters import CameraConfig
from rgbd_glue_ros.types import RgbdFrame, UInt8, View


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
