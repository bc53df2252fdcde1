"""A recording with the truth of a file is otherwise the same."""

from __future__ import annotations

import numpy as np
from rigs.pan import Pan

from rgbd_glue_ros.recordings.other_truth import with_ground_truth
from rgbd_glue_ros.types import Trajectory


def test_the_truth_is_the_given_one_and_all_else_is_of_the_recording() -> None:
    pan, truth = Pan(3), Trajectory(np.array([7]), np.eye(4)[None])
    other = with_ground_truth(pan, truth)
    assert other.ground_truth is truth
    assert (other.name, other.frame_count) == (pan.name, 3)
    stamps = [frame.stamp_ns for frame in pan]
    assert [frame.stamp_ns for frame in other] == stamps
    assert [frame.stamp_ns for frame in other.select([0, 2])] == stamps[::2]


def test_without_a_truth_it_is_the_recording_itself() -> None:
    pan = Pan(3)
    assert with_ground_truth(pan, None) is pan
