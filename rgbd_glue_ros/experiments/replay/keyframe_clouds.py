"""A coloured cloud from the keyframes of a replay."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.slam.cloud import ColoredCloud, cloud_of, fused
from rgbd_glue_ros.types import Float64, OdometryEstimate, RgbdFrame


class KeyframeClouds:
    """A ``FrameSink``: the cloud of every keyframe, and its pose."""

    def __init__(self) -> None:
        self._parts: list[list[tuple[ColoredCloud, Float64]]] = [[]]
        self._poses = [0]

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Takes a frame."""
        if estimate.T_odom_camera is None:
            return
        self._poses[-1] += 1
        if estimate.is_keyframe:
            self._parts[-1].append((cloud_of(frame), estimate.T_odom_camera))

    def start_anew(self) -> None:
        """Begins another part."""
        self._parts.append([])
        self._poses.append(0)

    def close(self) -> None:
        """Nothing: the cloud is in memory."""

    def fused(self) -> ColoredCloud:
        """All clouds of the longest part as one, in its odom frame."""
        longest = self._parts[int(np.argmax(self._poses))]
        poses = np.array([T for _, T in longest]).reshape(-1, 4, 4)
        return fused([cloud for cloud, _ in longest], poses)
