"""Poses recorded as they come: complete at any moment, and no file without one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.trajectories.recorder import PoseRecorder
from rgbd_glue_ros.trajectories.tum import read_tum


def test_poses_are_in_a_new_file_in_a_new_folder_as_they_come(tmp_path: Path) -> None:
    path = tmp_path / "out" / "trajectory.txt"
    with PoseRecorder(path) as recorder:
        for stamp_ns in (10**9, 2 * 10**9):
            recorder.append(stamp_ns, np.eye(4))
            assert read_tum(path).stamps_ns[-1] == stamp_ns
    assert recorder.count == len(read_tum(path)) == 2


def test_without_a_pose_there_is_no_file_in_the_end(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    with PoseRecorder(path) as recorder:
        recorder.begin_anew()
        assert path.exists()
    assert not path.exists()


def test_a_file_that_exists_is_refused_and_stays_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_text("mine")
    with pytest.raises(InputError, match=r"trajectory.txt: exists already; give a new file"):
        PoseRecorder(path)
    assert path.read_text() == "mine"


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"cannot be written \(.*\); give another path"):
        PoseRecorder(tmp_path / "file" / "trajectory.txt")


def test_where_the_odometry_begins_anew_a_comment_says_so(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    with PoseRecorder(path) as recorder:
        recorder.append(10**9, np.eye(4))
        recorder.begin_anew()
        recorder.append(2 * 10**9, np.eye(4))
    _, first, comment, second = path.read_text().splitlines()
    assert comment.startswith("# the odometry began anew")
    assert first.split()[1:] == second.split()[1:]
    np.testing.assert_array_equal(read_tum(path).stamps_ns, [10**9, 2 * 10**9])
