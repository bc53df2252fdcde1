"""Results that are whole or as they were, of one run and no other."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rigs.disks import full_after

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.writing import NewFolder, ResultFolder, json_text, write_whole
from rgbd_glue_ros.slam.cloud import ColoredCloud, write_ply
from rgbd_glue_ros.trajectories.pose_graph import write_graph
from rgbd_glue_ros.trajectories.tum import TumWriter, read_tum, write_tum
from rgbd_glue_ros.types import PoseGraph, Trajectory

LONG = Trajectory(np.arange(1, 1001, dtype=np.int64) * 10**9, np.tile(np.eye(4), (1000, 1, 1)))
SHORT = Trajectory(LONG.stamps_ns[:2], LONG.poses[:2])


def test_a_pipe_is_not_replaced_by_a_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InputError, match="pipe: exists and is not a file; give another path"):
        write_whole(tmp_path / "pipe", "x")
    assert (tmp_path / "pipe").is_fifo()
    assert len(list(tmp_path.iterdir())) == 1


def cloud_of(points: int) -> ColoredCloud:
    return ColoredCloud(np.zeros((points, 3), np.float32), np.zeros((points, 3), np.uint8))


WRITERS = {
    "metrics.json": lambda path, size: write_whole(path, f"{'x' * size}\n"),
    "trajectory.txt": lambda path, size: write_tum(path, LONG if size > 10 else SHORT),
    "keyframes.g2o": lambda path, size: write_graph(
        path, PoseGraph(LONG if size > 10 else SHORT, ())
    ),
    "map.ply": lambda path, size: write_ply(path, cloud_of(size)),
}


@pytest.mark.parametrize("name", WRITERS)
def test_what_does_not_fit_on_the_disk_leaves_the_file_as_it_was(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    WRITERS[name](path, 2)
    before = path.read_bytes()
    with full_after(1000), pytest.raises(InputError, match=r"File too large.*free some space"):
        WRITERS[name](path, 10_000)
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == [name]
    WRITERS[name](path, 10_000)
    assert path.stat().st_size > 10_000


def test_a_place_that_can_hold_no_file_is_told_as_that(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for path in (tmp_path / "file" / "metrics.json", tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match="cannot be written"):
            write_whole(path, "{}")


def test_a_link_in_place_of_a_file_in_the_writing_is_not_followed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = tmp_path / "others"
    other.write_text("not ours")
    (tmp_path / ".metrics.json.1234abcd.part").symlink_to(other)
    write_whole(tmp_path / "metrics.json", "{}\n")
    monkeypatch.setattr("secrets.token_hex", lambda _: "1234abcd")
    with pytest.raises(InputError, match="cannot be written"):
        write_whole(tmp_path / "metrics.json", "[]\n")
    assert other.read_text() == "not ours"
    assert (tmp_path / "metrics.json").read_text() == "{}\n"
    assert not (tmp_path / "metrics.json").is_symlink()


def test_of_two_that_save_one_file_at_once_each_saves_it_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "map.ply"

    def meanwhile(_: int) -> None:
        monkeypatch.undo()
        write_whole(path, "the other's")
        assert path.read_text() == "the other's"

    monkeypatch.setattr("os.fsync", meanwhile)
    write_whole(path, "the first")
    assert path.read_text() == "the first"
    assert [file.name for file in tmp_path.iterdir()] == ["map.ply"]


def test_a_file_has_the_mode_that_the_user_wishes(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_whole(tmp_path / "a.txt", "x")
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o640


def test_a_trajectory_on_a_full_disk_ends_with_a_whole_line(tmp_path: Path) -> None:
    path = tmp_path / "trajectory.txt"
    T = np.eye(4)
    T[:3, 3] = 1 / 3

    def write() -> None:
        with TumWriter(path) as writer:
            for stamp in range(1, 100):
                writer.append(stamp, T)

    with full_after(1000), pytest.raises(InputError, match="too large"):
        write()
    text = path.read_text()
    assert text.endswith("\n")
    assert len({len(line.split()) for line in text.splitlines()[1:]}) == 1
    assert (read_tum(path).poses == read_tum(path).poses[0]).all()


def test_numbers_that_are_none_are_null_in_json() -> None:
    content = {"a": math.inf, "b": [1.0, math.nan], "c": {"d": -math.inf, "e": (2, 0.5)}}
    text = json_text(content)
    assert json.loads(text) == {"a": None, "b": [1.0, None], "c": {"d": None, "e": [2, 0.5]}}


def test_two_runs_do_not_write_to_one_folder(tmp_path: Path) -> None:
    with ResultFolder(tmp_path / "out", ()):
        with pytest.raises(InputError, match="another run is writing to it"):
            ResultFolder(tmp_path / "out", ())
        ResultFolder(tmp_path / "other", ()).close()
    ResultFolder(tmp_path / "out", ()).close()


KILLED_WHILE_WRITING = """
import os, sys
from pathlib import Path
from rgbd_glue_ros.files.writing import write_whole
os.fsync = lambda _: os.kill(os.getpid(), 9)
write_whole(Path(sys.argv[1]) / "a[1].txt", "new")
"""


def test_what_a_killed_writer_left_is_removed_by_the_next_run_and_nothing_else(
    tmp_path: Path,
) -> None:
    own = tmp_path / ".a1.txt.1234abcd.part"
    own.touch()
    script = [sys.executable, "-c", KILLED_WHILE_WRITING, str(tmp_path)]
    assert subprocess.run(script, check=False).returncode == -9
    assert len(list(tmp_path.iterdir())) == 2
    ResultFolder(tmp_path, ("a[1].txt",)).close()
    assert list(tmp_path.iterdir()) == [own]


KILLED = """
import os, sys
from pathlib import Path
from rgbd_glue_ros.files.writing import NewFolder, ResultFolder, write_whole
folder = Path(sys.argv[1])
results = ResultFolder(folder, ("a.txt", "b.txt"))
write_whole(folder / "a.txt", "new")
new = NewFolder(folder / "bag")
new.path.mkdir()
os.kill(os.getpid(), 9)
"""


def test_a_run_that_is_killed_leaves_no_results_of_another_and_the_next_one_starts_anew(
    tmp_path: Path,
) -> None:
    for name in ("a.txt", "b.txt", "own.txt"):
        (tmp_path / name).write_text("old")
    done = subprocess.run([sys.executable, "-c", KILLED, str(tmp_path)], check=False)
    assert done.returncode == -9
    left = {path.name: path.read_text() for path in tmp_path.iterdir() if path.is_file()}
    assert left == {"a.txt": "new", "own.txt": "old"}
    new = NewFolder(tmp_path / "bag")
    assert not new.path.exists()
    new.path.mkdir()
    new.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "bag", "own.txt"]


def test_a_new_folder_appears_when_it_is_written_and_replaces_nothing(tmp_path: Path) -> None:
    target = tmp_path / "deep" / "bag"
    new = NewFolder(target)
    new.path.mkdir()
    (new.path / "file").write_text("x")
    assert not target.exists()
    with pytest.raises(InputError, match="another run is writing"):
        NewFolder(target)
    new.close()
    assert (target / "file").read_text() == "x"
    assert os.listdir(target.parent) == ["bag"]  # noqa: PTH208
    with pytest.raises(InputError, match="exists already"):
        NewFolder(target)


def test_a_new_folder_whose_name_was_taken_meanwhile_is_kept_and_it_is_said_where(
    tmp_path: Path,
) -> None:
    new = NewFolder(tmp_path / "late")
    new.path.mkdir()
    (new.path / "file").write_text("x")
    (tmp_path / "late").mkdir()
    (tmp_path / "late" / "own").write_text("")
    with pytest.raises(InputError, match=f"cannot be written.*; it is in {new.path}: move it"):
        new.close()
    assert (tmp_path / "late" / "own").exists()
    assert (new.path / "file").read_text() == "x"
