"""Trajectories that nobody recorded."""

from __future__ import annotations

import numpy as np

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import NANOSECONDS, Int64, Trajectory


def stamps(length: int, rate_hz: int = 30) -> Int64:
    # a rounded stamp misses its second by nanoseconds, as real ones do
    return 1_700_000_000 * NANOSECONDS + np.arange(length) * NANOSECONDS // rate_hz


def wandering(seed: int, length: int = 90, step: float = 0.02) -> Trajectory:
    rng = np.random.default_rng(seed)
    poses = [np.eye(4)]
    for _ in range(length - 1):
        poses.append(poses[-1] @ se3.exp(rng.normal(0, step, 6)))
    return Trajectory(stamps(length), np.stack(poses))


def line(velocity: float, length: int = 90) -> Trajectory:
    times = stamps(length)
    poses = np.tile(np.eye(4), (length, 1, 1))
    poses[:, 0, 3] = velocity * (times - times[0]) / NANOSECONDS
    return Trajectory(times, poses)
