"""Lens models: the ray of a pixel, and images as a camera without a lens would have taken them."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np

from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64, LensModel, UInt8

_CRITERIA = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-8)
# The tangent of 89.9 degrees: beside and behind the camera, no pinhole sees anything.
_SIDEWAYS = 1000.0


@lru_cache(maxsize=4)
def rays(camera: CameraIntrinsics) -> Float64:
    """The ray of every pixel, with its lens: x / z and y / z, [h, w, 2].

    NaN where a ray points sideways or backwards.
    """
    v, u = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([u, v], axis=-1).reshape(-1, 1, 2).astype(np.float64)
    distortion = np.array(camera.distortion or (0.0,) * 5)
    if camera.lens is LensModel.KANNALA_BRANDT:
        seen = cv2.fisheye.undistortPoints(pixels, camera.matrix, _of_fisheye(camera))
    elif camera.lens is LensModel.INVERSE_BROWN_CONRADY:
        seen = _bent((pixels - [camera.cx, camera.cy]) / [camera.fx, camera.fy], distortion)
    else:
        # without a rotation and a new camera matrix
        seen = cv2.undistortPointsIter(pixels, camera.matrix, distortion, None, None, _CRITERIA)
    directions = np.array(seen, np.float64).reshape(camera.height, camera.width, 2)
    directions[~(np.abs(directions) < _SIDEWAYS).all(axis=2)] = np.nan
    return directions


def undistorted(color: UInt8, camera: CameraIntrinsics) -> tuple[UInt8, CameraIntrinsics]:
    """A colour image [H, W] or [H, W, 3] without lens distortion, interpolated; and its camera."""
    if not any(camera.distortion):
        return color, camera
    straight = cv2.remap(color, *undistortion_maps(camera), cv2.INTER_LINEAR)
    return np.asarray(straight, np.uint8), without_distortion(camera)


def without_distortion(camera: CameraIntrinsics) -> CameraIntrinsics:
    """The camera of an image whose distortion was removed."""
    return replace(camera, distortion=(), lens=LensModel.BROWN_CONRADY)


@lru_cache(maxsize=4)
def undistortion_maps(camera: CameraIntrinsics) -> tuple[Float32, Float32]:
    """Column and row, float32 [H, W] each, in the distorted image of every undistorted pixel."""
    K, size = camera.matrix, (camera.width, camera.height)
    distortion = np.array(camera.distortion)
    if camera.lens is LensModel.KANNALA_BRANDT:
        maps = cv2.fisheye.initUndistortRectifyMap(
            K, _of_fisheye(camera), np.eye(3), K, size, cv2.CV_32FC1
        )
    elif camera.lens is LensModel.INVERSE_BROWN_CONRADY:
        straight = rays(without_distortion(camera)).reshape(-1, 1, 2)
        # removing the polynomial is the same as applying its inverse
        bent = cv2.undistortPointsIter(straight, np.eye(3), distortion, None, None, _CRITERIA)
        columns_rows = bent * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        maps = np.moveaxis(columns_rows.reshape(camera.height, camera.width, 2), 2, 0)
    else:
        maps = cv2.initUndistortRectifyMap(K, distortion, np.eye(3), K, size, cv2.CV_32FC1)
    return np.asarray(maps[0], np.float32), np.asarray(maps[1], np.float32)


def _of_fisheye(camera: CameraIntrinsics) -> Float64:
    """The coefficients as OpenCV's fisheye module needs them, always four."""
    return np.array((*camera.distortion, 0.0, 0.0, 0.0, 0.0)[:4])


def _bent(points: Float64, distortion: Float64) -> Float64:
    """Points [N, 1, 2] of the plane z = 1, moved by the polynomial of Brown and Conrady."""
    in_space = cv2.convertPointsToHomogeneous(points)
    moved, _ = cv2.projectPoints(in_space, np.zeros(3), np.zeros(3), np.eye(3), distortion)
    return np.asarray(moved, np.float64)
