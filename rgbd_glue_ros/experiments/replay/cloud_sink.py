"""A coloured cloud of what the keyframes of a replay saw."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rgbd_glue_ros.slam.cloud import ColoredCloud, cloud_of, fused, write_ply
from rgbd_glue_ros.types import Float64, OdometryEstimate, RgbdFrame


class CloudSink:
    """Fuses the keyframes where the odometry put them, and writes a PLY file in the end."""

    def __init__(self, file: Path) -> None:
        """Takes the file to write."""
        self._file = file
        self._clouds: list[ColoredCloud] = []
        self._poses: list[Float64] = []

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Takes a frame."""
        if estimate.is_keyframe and estimate.T_odom_camera is not None:
            self._clouds.append(cloud_of(frame))
            self._poses.append(estimate.T_odom_camera)

    def close(self) -> None:
        """Writes the file; raises InputError if it cannot be written."""
        write_ply(self._file, fused(self._clouds, np.array(self._poses).reshape(-1, 4, 4)))
