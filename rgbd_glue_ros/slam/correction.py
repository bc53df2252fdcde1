"""A trajectory after its keyframes were moved."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Trajectory


def corrected(odometry: Trajectory, before: Trajectory, after: Trajectory) -> Trajectory:
    """Moves every pose as the keyframes before and after it were moved, in proportion of time.

    So there is no jump where the next keyframe begins. Before the first keyframe and after the
    last, poses move with that one.

    Args:
        odometry: T_odom_camera of every frame.
        before: T_odom_camera of the keyframes, one at least, stamps increasing.
        after: T_map_camera of the same keyframes.

    Returns:
        T_map_camera of every frame.
    """
    moves = after.poses @ se3.inverse(before.poses)
    stamps = before.stamps_ns
    last = len(stamps) - 1
    poses = []
    for stamp, T in zip(odometry.stamps_ns, odometry.poses, strict=True):
        right = int(np.searchsorted(stamps, stamp, "left").clip(0, last))
        left = max(right - 1, 0) if stamps[right] > stamp else right
        gap = int(stamps[right]) - int(stamps[left])
        part = min(max((int(stamp) - int(stamps[left])) / gap, 0.0), 1.0) if gap else 0.0
        # in the camera's frame, where a correction is small whatever the distance to the origin
        a, b = (se3.log(se3.inverse(T) @ moves[row] @ T) for row in (left, right))
        poses.append(T @ se3.exp((1 - part) * a + part * b))
    return Trajectory(odometry.stamps_ns, np.array(poses).reshape(-1, 4, 4))
