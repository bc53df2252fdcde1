"""The path through poses."""

from __future__ import annotations

import numpy as np
import pytest
from rigs.trajectories import line

from rgbd_glue_ros.trajectories.path import path_length, trajectory_of


def test_the_length_of_a_path_is_the_sum_of_its_steps() -> None:
    assert path_length(line(0.5, 31).poses) == pytest.approx(0.5, abs=1e-8)
    assert path_length(np.empty((0, 4, 4))) == 0.0


def test_a_trajectory_leaves_out_poses_that_are_not_known() -> None:
    truth = line(0.5, 3)
    poses = [truth.poses[0], None, truth.poses[2]]
    found = trajectory_of(zip(truth.stamps_ns.tolist(), poses, strict=True))
    assert found.stamps_ns.tolist() == truth.stamps_ns[[0, 2]].tolist()
    np.testing.assert_array_equal(found.poses, truth.poses[[0, 2]])
    assert len(trajectory_of([(1, None)])) == len(trajectory_of([])) == 0
