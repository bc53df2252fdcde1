"""The RGB-D odometries of OpenCV's contributed modules (Apache licence)."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any

import cv2
import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.experiments.peers.base import NoTransformError
from rgbd_glue_ros.types import Float64, View


class OpenCvOdometry:
    """Direct alignment of two frames; its default limits are 7 cm in depth, 15 cm and 15 deg."""

    def __init__(self, name: str, method: str) -> None:
        try:
            create: Callable[[], Any] = getattr(import_module("cv2.rgbd"), f"{method}_create")
        except ImportError as error:
            raise InputError(
                f"the peer {name}",
                f"OpenCV {cv2.__version__} lacks the contributed modules",
                "install the same release of opencv-contrib-python-headless over it",
            ) from error
        self._create = create

    def prepare(self, view: View) -> View:
        """Nothing: the library has no call that caches a frame for Python."""
        return view

    def register(self, source: View, target: View) -> Float64:
        """T_target_source; the frames are of one camera."""
        odometry = self._create()
        odometry.setCameraMatrix(target.intrinsics.matrix)
        try:
            found, T = odometry.compute(
                source.grey, source.depth, _known(source), target.grey, target.depth, _known(target)
            )
        except cv2.error as error:
            raise NoTransformError(f"OpenCV refuses the frames: {error}") from error
        if not found:
            raise NoTransformError("too few pixels correspond, or the motion is beyond the limits")
        return np.array(T, np.float64)


def opencv_rgbd() -> OpenCvOdometry:
    """Photometric (Steinbruecker, Sturm and Cremers 2011)."""
    return OpenCvOdometry("opencv_rgbd", "RgbdOdometry")


def opencv_icp() -> OpenCvOdometry:
    """Projective point-to-plane ICP (Newcombe et al. 2011)."""
    return OpenCvOdometry("opencv_icp", "ICPOdometry")


def opencv_rgbd_icp() -> OpenCvOdometry:
    """Both together."""
    return OpenCvOdometry("opencv_rgbd_icp", "RgbdICPOdometry")


def _known(view: View) -> Any:
    return np.where(np.isfinite(view.depth), np.uint8(255), np.uint8(0))
