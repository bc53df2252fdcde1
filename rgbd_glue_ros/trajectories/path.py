"""Poses in their order, and the path through them."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from rgbd_glue_ros.types import Float64, Trajectory


def trajectory_of(poses: Iterable[tuple[int, Float64 | None]]) -> Trajectory:
    """The trajectory through poses, without those that are not known.

    Args:
        poses: a stamp in nanoseconds and T_world_body [4, 4] of each; None if it is not known.
    """
    known = [(stamp_ns, T) for stamp_ns, T in poses if T is not None]
    return Trajectory(
        np.array([stamp_ns for stamp_ns, _ in known], np.int64),
        np.array([T for _, T in known], np.float64).reshape(-1, 4, 4),
    )


def path_length(poses: Float64) -> float:
    """Length of the path through poses [N, 4, 4], metres."""
    return float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
