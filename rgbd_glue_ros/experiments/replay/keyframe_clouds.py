"""A coloured cloud from the keyframes of a replay."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.experiments.replay.run_record import Run
from rgbd_glue_ros.slam.cloud import ColoredCloud, cloud_of, fused
from rgbd_glue_ros.types import Float64, OdometryEstimate, RgbdFrame


class KeyframeClouds:
    """A ``FrameSink``: the cloud of every keyframe, and its pose."""

    def __init__(self) -> None:
        self._parts: list[list[tuple[ColoredCloud, Float64]]] = [[]]

    def add(self, frame: RgbdFrame, estimate: OdometryEstimate) -> None:
        """Takes a frame."""
        if estimate.is_keyframe and estimate.T_odom_camera is not None:
            self._parts[-1].append((cloud_of(frame), estimate.T_odom_camera))

    def start_anew(self) -> None:
        """Begins another part."""
        self._parts.append([])

    def close(self) -> None:
        """Nothing: the cloud is in memory."""

    def longest(self, run: Run) -> ColoredCloud:
        """The clouds of the longest part of a run as one, in its odom frame."""
        part = self._parts[run.longest_row]
        poses = np.array([T for _, T in part]).reshape(-1, 4, 4)
        return fused([cloud for cloud, _ in part], poses)
