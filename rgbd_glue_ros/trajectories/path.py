"""The path of a body through its poses."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.types import Float64


def path_length(poses: Float64) -> float:
    """Length of the path through poses [N, 4, 4], metres."""
    return float(np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1).sum())
