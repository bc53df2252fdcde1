"""Poses between those of a trajectory."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from rgbd_glue_ros.types import NANOSECONDS, Float64, Int64, Trajectory

# motion between poses further apart than this cannot be interpolated
_MAX_GAP_NS = NANOSECONDS // 10


def interpolated(reference: Trajectory, stamps_ns: Int64) -> Float64:
    """Poses [N, 4, 4] at any stamps; NaN outside, and if neighbours are too far apart in time.

    Positions are interpolated linearly, rotations along the shortest path. At the stamp of a pose,
    the result is that pose.
    """
    poses = np.full((len(stamps_ns), 4, 4), np.nan)
    stamps, rows = np.unique(reference.stamps_ns, return_index=True)
    if not len(stamps):
        return poses
    known = reference.poses[rows]
    nearest = np.searchsorted(stamps, stamps_ns).clip(0, len(stamps) - 1)
    exact = stamps[nearest] == stamps_ns
    poses[exact] = known[nearest[exact]]
    if len(stamps) < 2:
        return poses
    after = np.searchsorted(stamps, stamps_ns).clip(1, len(stamps) - 1)
    gap = stamps[after] - stamps[after - 1]
    inside = (stamps_ns >= stamps[0]) & (stamps_ns <= stamps[-1]) & (gap <= _MAX_GAP_NS)
    inside &= ~exact
    if not inside.any():
        return poses  # older versions of scipy refuse an empty interpolation
    # floats can represent microseconds since the first stamp, but not since 1970
    times, wanted = (np.asarray(s - stamps[0], np.float64) for s in (stamps, stamps_ns[inside]))
    poses[inside] = np.eye(4)
    poses[inside, :3, :3] = Slerp(times, Rotation.from_matrix(known[:, :3, :3]))(wanted).as_matrix()
    poses[inside, :3, 3] = np.stack([np.interp(wanted, times, x) for x in known[:, :3, 3].T], 1)
    return poses
