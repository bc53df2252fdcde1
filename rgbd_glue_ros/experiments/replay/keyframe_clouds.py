"""A coloured cloud from the keyframes of a replay."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.slam.cloud import ColoredCloud, cloud_of, fused
from rgbd_glue_ros.types import Float64, OdometryEstimate, RgbdFrame


class KeyframeClouds:
    """The cloud of every keyframe, and its pose."""

    def __init__(self) -> None:
        self._clouds: list[ColoredCloud] = []
        self._poses: list[Float64] = []

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Takes a frame."""
        if estimate.is_keyframe and estimate.T_odom_camera is not None:
            self._clouds.append(cloud_of(frame))
            self._poses.append(estimate.T_odom_camera)

    def fused(self) -> ColoredCloud:
        """All clouds as one, in the odom frame."""
        return fused(self._clouds, np.array(self._poses).reshape(-1, 4, 4))
