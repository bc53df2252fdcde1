"""The figures of every part of a benchmark, with the names of ``metrics.json``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rgbd_glue_ros.evaluation.consistency import normalised_errors
from rgbd_glue_ros.evaluation.trajectory_errors import error_figures, evaluated
from rgbd_glue_ros.trajectories import path
from rgbd_glue_ros.types import NANOSECONDS, OdometryEstimate, TrackingState, Trajectory


def times(milliseconds: Sequence[float]) -> dict[str, float]:
    """Median and 95th percentile of at least one time."""
    p50, p95 = np.percentile(milliseconds, [50, 95])
    return {"p50": float(p50), "p95": float(p95)}


def errors(trajectory: Trajectory, truth: Trajectory | None) -> dict[str, Any]:
    """APE and RPE; nothing without ground truth, or with too few poses to compare."""
    evaluation = evaluated(trajectory, truth)
    return {} if evaluation is None else error_figures(evaluation)


def honesty(estimates: Sequence[OdometryEstimate], truth: Trajectory | None) -> dict[str, Any]:
    """Mean and median of the normalised errors (NEES); nothing if none is known."""
    nees = normalised_errors(estimates, truth) if truth is not None else np.empty(0)
    if not len(nees):
        return {}
    return {
        "nees": {
            "mean": float(nees.mean()),
            "median": float(np.median(nees)),
            "count": len(nees),
        }
    }


def losses(estimates: Sequence[OdometryEstimate]) -> dict[str, Any]:
    """How often the odometry was lost, how long at most, and how often it had to restart."""
    longest_ns, last_ns, is_lost = 0, None, False
    for estimate in estimates:
        is_lost = is_lost or estimate.state is TrackingState.LOST
        if is_lost and last_ns is not None:
            longest_ns = max(longest_ns, estimate.stamp_ns - last_ns)
        if estimate.T_odom_camera is not None:
            last_ns, is_lost = estimate.stamp_ns, False
    posed = [e for e in estimates if e.T_odom_camera is not None]
    return {
        "frames": len(estimates),
        "lost": len(estimates) - len(posed),
        "longest_without_pose_s": longest_ns / NANOSECONDS,
        # a restart has no velocity, and neither does the very first frame
        "restarts": max(0, sum(e.twist is None for e in posed) - 1),
    }


def trajectory_of(estimates: list[OdometryEstimate]) -> Trajectory:
    """The poses of all frames that have one."""
    return path.trajectory_of((e.stamp_ns, e.T_odom_camera) for e in estimates)
