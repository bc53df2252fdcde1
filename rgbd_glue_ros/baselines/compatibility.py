"""What a rigid motion leaves as it was: the lengths between matched points."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from rgbd_glue_ros.estimation import distances, procrustes
from rgbd_glue_ros.types import Correspondences, Float32, Float64

_REFINEMENTS = 20


def length_differences(matches: Correspondences) -> Float32:
    """| |p_i - p_j| - |q_i - q_j| | of every two matches, float32 [N, N], metres."""
    source, target = (cdist(points, points) for points in (matches.source, matches.target))
    return np.asarray(np.abs(source - target), np.float32)


def refined(T: Float64, matches: Correspondences, threshold: float) -> Float64:
    """T fitted again to its inliers, the nearer ones weighing more, until these are the same.

    Args:
        T: T_target_source, float64 [4, 4].
        matches: all.
        threshold: distance of an inlier, metres.
    """
    count = 0
    for _ in range(_REFINEMENTS):
        apart = distances(T, matches)
        inliers = apart < threshold
        if inliers.sum() <= max(count, 2):
            break
        count = int(inliers.sum())
        weights = 1 / (1 + (apart[inliers] / threshold) ** 2)
        T = procrustes(matches.source[inliers], matches.target[inliers], weights)
    return T
