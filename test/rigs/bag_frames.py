"""The frames of the bundled recording, a quarter as large, and where they were taken."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import islice
from pathlib import Path

import cv2
import make_bag
import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.recordings import open_recording
from rgbd_glue_ros.recordings.bag.writer import RAW, BagWriter
from rgbd_glue_ros.types import Float32, Float64, OdometryEstimate, RgbdFrame, UInt8


@lru_cache(maxsize=1)
def recorded_frames() -> tuple[RgbdFrame, ...]:
    """3.5 s of hand-held motion at 30 Hz, back to where it began."""
    with open_recording(make_bag.FOLDER) as sequence:
        return tuple(halved(frame) for frame in sequence)


def true_poses() -> Float64:
    """Of the recorded frames, relative to the first, float64 [N, 4, 4]."""
    poses = np.array([make_bag.true_pose(i) for i in range(make_bag.FRAME_COUNT)])
    relative: Float64 = np.linalg.inv(poses[0]) @ poses
    return relative


def write_small_bag(folder: Path, count: int) -> Path:
    """The first recorded frames, uncompressed, with the true poses."""
    with BagWriter(folder, RAW) as writer:
        for frame, T in islice(zip(recorded_frames(), true_poses(), strict=True), count):
            writer.write(writer.encode(frame))
            writer.write_pose(frame.stamp_ns, T)
    return folder


def errors(estimates: Sequence[OdometryEstimate], truth: Float64) -> tuple[Float64, Float64]:
    """Distance in metres and angle in radians to the true poses; NaN where there is no pose."""
    apart = [
        np.full((4, 4), np.nan) if e.T_odom_camera is None else se3.inverse(T) @ e.T_odom_camera
        for e, T in zip(estimates, truth, strict=True)
    ]
    cosine = (np.trace(np.array(apart), axis1=1, axis2=2) - 2) / 2
    metres = np.linalg.norm([T[:3, 3] for T in apart], axis=1)
    return metres, np.arccos(np.clip(cosine, -1, 1))


def halved(frame: RgbdFrame) -> RgbdFrame:
    """Pixel i of the smaller images is centred on pixel 2 i."""
    K = frame.intrinsics
    color: UInt8 = np.asarray(cv2.pyrDown(frame.color), np.uint8)
    depth: Float32 = np.ascontiguousarray(frame.depth[::2, ::2])
    camera = replace(
        K,
        width=K.width // 2,
        height=K.height // 2,
        fx=K.fx / 2,
        fy=K.fy / 2,
        cx=K.cx / 2,
        cy=K.cy / 2,
    )
    return replace(frame, color=color, depth=depth, intrinsics=camera)
