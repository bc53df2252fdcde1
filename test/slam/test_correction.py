"""Frames follow their keyframes, without a jump."""

from __future__ import annotations

import numpy as np
from rigs.pose_graphs import random_walk

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.slam.correction import corrected
from rgbd_glue_ros.types import NANOSECONDS, Float64, Trajectory

STAMPS = np.arange(101) * NANOSECONDS // 30
KEYFRAMES = np.arange(10, 100, 20)


def drifted(poses: Float64, drift: Float64) -> Float64:
    """Poses that turn and move away as time goes by, as odometry does."""
    return np.array([se3.exp(drift * i / 100) @ T for i, T in enumerate(poses)])


def test_keyframes_come_to_where_they_were_put_and_frames_between_them_nearly() -> None:
    true = random_walk(np.random.default_rng(0), 101)
    odometry = drifted(true, np.array([0.3, -0.2, 0.1, 0.02, 0.05, -0.03]))
    found = corrected(
        Trajectory(STAMPS, odometry),
        Trajectory(STAMPS[KEYFRAMES], odometry[KEYFRAMES]),
        Trajectory(STAMPS[KEYFRAMES], true[KEYFRAMES]),
    )
    np.testing.assert_array_equal(found.stamps_ns, STAMPS)
    np.testing.assert_allclose(found.poses[KEYFRAMES], true[KEYFRAMES], atol=1e-12)
    inside = slice(KEYFRAMES[0], KEYFRAMES[-1] + 1)
    np.testing.assert_allclose(found.poses[inside], true[inside], atol=2e-4)
    # outside, the drift since the last keyframe remains, and no more
    moved = se3.inverse(found.poses[-1]) @ true[-1]
    assert np.linalg.norm(moved[:3, 3]) < 0.06


def test_poses_stay_where_they_are_when_no_keyframe_moves() -> None:
    poses = random_walk(np.random.default_rng(1), 101)
    keyframes = Trajectory(STAMPS[KEYFRAMES], poses[KEYFRAMES])
    found = corrected(Trajectory(STAMPS, poses), keyframes, keyframes)
    np.testing.assert_allclose(found.poses, poses, atol=1e-12)


def test_a_correction_of_one_keyframe_moves_all_poses() -> None:
    poses = random_walk(np.random.default_rng(2), 101)
    T = se3.exp(np.array([1.0, 2, 3, 0.1, 0.2, 0.3]))
    found = corrected(
        Trajectory(STAMPS, poses),
        Trajectory(STAMPS[:1], poses[:1]),
        Trajectory(STAMPS[:1], T @ poses[:1]),
    )
    np.testing.assert_allclose(found.poses, T @ poses, atol=1e-12)
