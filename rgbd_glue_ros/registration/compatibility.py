"""What a rigid motion preserves: the lengths between matched points."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.compiled import compiled
from rgbd_glue_ros.geometry.fitting import distances, procrustes
from rgbd_glue_ros.types import Correspondences, Float32, Float64

# Fits to inliers, at most: as many as the publication of SC2-PCR takes.
_MAX_FITS = 20


def length_differences(matches: Correspondences) -> Float32:
    """| |p_i - p_j| - |q_i - q_j| | for every two matches, float32 [N, N], metres."""
    return _length_differences(
        np.ascontiguousarray(matches.source.T, np.float32),
        np.ascontiguousarray(matches.target.T, np.float32),
    )


@compiled
def _length_differences(p: Float32, q: Float32) -> Float32:
    n = p.shape[1]
    differences = np.empty((n, n), np.float32)
    for i in range(n):
        for j in range(n):
            dx, dy, dz = p[0, i] - p[0, j], p[1, i] - p[1, j], p[2, i] - p[2, j]
            ex, ey, ez = q[0, i] - q[0, j], q[1, i] - q[1, j], q[2, i] - q[2, j]
            length_p = np.sqrt(dx * dx + dy * dy + dz * dz)
            length_q = np.sqrt(ex * ex + ey * ey + ez * ez)
            differences[i, j] = abs(length_p - length_q)
    return differences


def refined(T: Float64, matches: Correspondences, threshold: float) -> Float64:
    """T fitted repeatedly to its inliers, nearer ones weighing more, until they are constant.

    Args:
        T: T_target_source, float64 [4, 4].
        matches: all matches.
        threshold: maximum distance of an inlier, metres.
    """
    count = 0
    for _ in range(_MAX_FITS):
        apart = distances(T, matches)
        inliers = apart < threshold
        if inliers.sum() <= max(count, 2):
            break
        count = int(inliers.sum())
        weights = 1 / (1 + (apart[inliers] / threshold) ** 2)
        T = procrustes(matches.source[inliers], matches.target[inliers], weights)
    return T
