"""Trajectories survive their files; bad lines are named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.trajectories.tum import TumWriter, read_tum, write_tum
from rgbd_glue_ros.types import NANOSECONDS, Trajectory


def random_trajectory(seed: int, length: int = 20) -> Trajectory:
    rng = np.random.default_rng(seed)
    poses = np.stack([se3.exp(rng.normal(0, 1, 6)) for _ in range(length)])
    return Trajectory(np.sort(rng.integers(0, 2**61, length)), poses)


@given(st.integers(0, 1000))
@settings(max_examples=20)
def test_a_trajectory_survives_a_tum_file(
    tmp_path_factory: pytest.TempPathFactory, seed: int
) -> None:
    path = tmp_path_factory.mktemp("tum") / "trajectory.txt"
    written = random_trajectory(seed)
    write_tum(path, written)
    read = read_tum(path)
    np.testing.assert_array_equal(read.stamps_ns, written.stamps_ns)
    np.testing.assert_allclose(read.poses, written.poses, atol=1e-13)


def test_a_pose_is_on_disk_as_soon_as_it_is_appended(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    with TumWriter(path) as writer:
        writer.append(1_500_000_000, np.eye(4))
        assert path.read_text().splitlines()[-1] == "1.500000000 0 0 0 0 0 0 1"


def test_comments_commas_and_empty_lines_in_a_tum_file_are_no_poses(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    path.write_text("# stamp tx …\n\n1,0,0,0,0,0,0,2\n")
    trajectory = read_tum(path)
    np.testing.assert_array_equal(trajectory.poses, [np.eye(4)])


@pytest.mark.parametrize(
    ("line", "cause"),
    [
        ("1.5 0 0 nan 0 0 0 1", "not finite"),
        ("1.5 0 0 inf 0 0 0 1", "not finite"),
        ("1.5 0 0 0 0 0 0 0", "quaternion of zeros"),
        ("1.5 0 0 0", "4 values instead of 8"),
        ("now 0 0 0 0 0 0 1", "not a number"),
        ("nan 0 0 0 0 0 0 1", "not finite"),
        ("inf 0 0 0 0 0 0 1", "not finite"),
        ("1.5 0 0 zero 0 0 0 1", "'zero'"),
    ],
)
def test_a_bad_line_is_skipped_and_named_and_refused_where_it_is_all_there_is(
    tmp_path: Path, line: str, cause: str, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "groundtruth.txt"
    path.write_text(f"# comment\n1.0 0 0 0 0 0 0 1\n{line}\n")
    assert list(read_tum(path).stamps_ns) == [NANOSECONDS]
    assert f"{path}:3" in caplog.text
    assert cause in caplog.text
    path.write_text(f"# stamp and pose\n{line}\n{line}\n")
    with pytest.raises(InputError):
        read_tum(path)


def test_a_missing_a_binary_and_an_empty_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "binary").write_bytes(b"\x89PNG\xff")
    (tmp_path / "empty").write_text("# nothing\n")
    for name, cause in (("none", "No such file"), ("binary", "not a text"), ("empty", "no pose")):
        with pytest.raises(InputError, match=cause):
            read_tum(tmp_path / name)
