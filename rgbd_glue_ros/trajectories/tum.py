"""Reads and writes trajectories in TUM's format."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.stamp_text import format_stamp
from rgbd_glue_ros.files.writing import not_written, write_whole
from rgbd_glue_ros.trajectories.columns import stamped_poses
from rgbd_glue_ros.trajectories.pose_text import pose_text
from rgbd_glue_ros.types import Float64, Trajectory

TUM_HEADER = "# timestamp tx ty tz qx qy qz qw"


def read_tum(path: str | Path) -> Trajectory:
    """The trajectory in a text file of a stamp and a pose on each line.

    The format is TUM's (``stamp tx ty tz qx qy qz qw``; # starts a comment), or a similar one:
    EuRoC's, matrices after a stamp, columns in the order of a line of names; with commas or
    semicolons.

    Raises:
        InputError: the file cannot be read, or none of its lines contains a stamp and a pose.
            Single lines without one are skipped, with a warning.
    """
    stamps, poses = stamped_poses(Path(path))
    return Trajectory(np.array(stamps, np.int64), np.stack(poses))


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Writes a TUM file, which ``read_tum`` reads back to the nanosecond.

    Raises:
        InputError: the file cannot be written.
    """
    rows = zip(trajectory.stamps_ns, trajectory.poses, strict=True)
    lines = [TUM_HEADER, *(_tum_line(int(stamp), T) for stamp, T in rows)]
    write_whole(Path(path), "".join(f"{line}\n" for line in lines))


def _tum_line(stamp_ns: int, T_world_body: Float64) -> str:
    return f"{format_stamp(stamp_ns)} {pose_text(T_world_body)}"


class TumWriter(Closing):
    """Writes a TUM file pose by pose; appended poses are on disk, whatever happens afterwards.

    Its lines are complete, even if the disk is full.
    """

    def __init__(self, path: Path, *, must_be_new: bool = False) -> None:
        """Creates the file.

        Args:
            path: of the file.
            must_be_new: whether a file that exists is left alone; otherwise it is replaced.

        Raises:
            InputError: it cannot be written, or exists and must be new.
        """
        self._path = path
        try:
            self._file = path.open("xb" if must_be_new else "wb", buffering=0)
        except FileExistsError as error:
            raise InputError(path, "exists already", "give a new file") from error
        except OSError as error:
            raise not_written(path, error) from error
        self._append(TUM_HEADER)

    def append(self, stamp_ns: int, T_world_body: Float64) -> None:
        """Adds one pose [4, 4]; raises InputError if it cannot be written."""
        self._append(_tum_line(stamp_ns, T_world_body))

    def note(self, text: str) -> None:
        """Adds a comment of one line; raises InputError if it cannot be written."""
        self._append(f"# {text}")

    def _append(self, text: str) -> None:
        line = f"{text}\n".encode()
        end = self._file.tell()
        try:
            # the last bytes that fit are written without an error
            while line:
                line = line[self._file.write(line) :]
        except OSError as error:
            # a number without its last digits is another number
            self._file.truncate(end)
            raise not_written(self._path, error) from error

    def close(self) -> None:
        """Closes the file."""
        self._file.close()
