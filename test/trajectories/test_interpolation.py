"""Between poses a trajectory is known where these are near."""

from __future__ import annotations

import numpy as np
from rigs.trajectories import stamps, wandering

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.interpolation import interpolated
from rgbd_glue_ros.types import Trajectory


def test_interpolated_poses_of_a_steady_screw_are_exact_in_rotation_and_on_the_way() -> None:
    step = np.array([0.02, 0, 0, 0, 0, 0.05])
    poses = np.stack([se3.exp(i * step) for i in range(11)])
    truth = Trajectory(stamps(11), poses)
    between = (truth.stamps_ns[:-1] + truth.stamps_ns[1:]) // 2
    found = interpolated(truth, between)
    exact = np.stack([se3.exp((i + 0.5) * step) for i in range(10)])
    np.testing.assert_allclose(found[:, :3, :3], exact[:, :3, :3], atol=1e-7)
    # a chord of the arc, whose sagitta is that of an angle of 0.05 over 2 cm
    assert np.abs(found[:, :3, 3] - exact[:, :3, 3]).max() < 0.02 * 0.05 / 8 * 1.01


def test_at_its_own_stamps_an_interpolated_trajectory_is_itself() -> None:
    truth = wandering(5)
    order = np.random.default_rng(0).permutation(len(truth))
    shuffled = Trajectory(truth.stamps_ns[order], truth.poses[order])
    np.testing.assert_allclose(interpolated(shuffled, truth.stamps_ns), truth.poses, atol=1e-12)


def test_nothing_is_known_outside_the_truth_nor_in_its_gaps() -> None:
    truth = wandering(0, 60)
    kept = np.r_[0:20, 40:60]
    with_gap = Trajectory(truth.stamps_ns[kept], truth.poses[kept])
    wanted = np.r_[truth.stamps_ns[0] - 1, truth.stamps_ns[30], truth.stamps_ns[-1] + 1]
    assert np.isnan(interpolated(with_gap, wanted)).all()
    assert np.isnan(interpolated(Trajectory(truth.stamps_ns[:1], truth.poses[:1]), wanted)).all()


def test_a_truth_of_few_poses_is_known_at_their_very_stamps() -> None:
    truth = wandering(0, 60)
    rare = Trajectory(truth.stamps_ns[::20], truth.poses[::20])
    wanted = np.r_[truth.stamps_ns[20], truth.stamps_ns[21]]
    found = interpolated(rare, wanted)
    np.testing.assert_array_equal(found[0], truth.poses[20])
    assert np.isnan(found[1]).all()
