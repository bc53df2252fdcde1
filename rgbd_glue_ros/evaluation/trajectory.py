"""Reads and writes trajectories (TUM, KITTI), and pairs stamps."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.evaluation.text_lines import (
    finite_numbers,
    numbers_text,
    parsed_lines,
    pose_text,
)
from rgbd_glue_ros.evaluation.trajectory_text import stamped_poses, stamps_ns
from rgbd_glue_ros.files.writing import not_written, write_whole
from rgbd_glue_ros.types import NANOSECONDS, Float64, Int64, Trajectory

MAX_TIME_DIFFERENCE_S = 0.02
"""Stamps further apart than this are not of the same moment (the TUM tools' value)."""

TUM_HEADER = "# timestamp tx ty tz qx qy qz qw"


def parse_stamp(text: str) -> int:
    """Nanoseconds from a decimal number of seconds, without passing through a float.

    A number too large for seconds is in milli-, micro- or nanoseconds, as in ``stamps_ns``.

    Raises:
        ValueError: the number is not finite.
        ArithmeticError: the text is not a number.
    """
    (stamp_ns,) = stamps_ns([text])
    return stamp_ns


def format_stamp(stamp_ns: int) -> str:
    """Seconds with nine decimals; ``parse_stamp`` gives the same nanoseconds back."""
    seconds, nanoseconds = divmod(abs(int(stamp_ns)), NANOSECONDS)
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{nanoseconds:09d}"


def associate(
    first_ns: Int64, second_ns: Int64, max_difference_s: float = MAX_TIME_DIFFERENCE_S
) -> tuple[Int64, Int64]:
    """Pairs stamps one-to-one, the nearest pair first, as the TUM benchmark's tools do.

    Args:
        first_ns: int64 [N], in any order.
        second_ns: int64 [M], in any order.
        max_difference_s: maximum difference within a pair, seconds.

    Returns:
        The rows of ``first_ns`` and of ``second_ns`` that belong together, in order of
        ``first_ns``' time.
    """
    window = round(max_difference_s * NANOSECONDS)
    order = np.argsort(second_ns, kind="stable")
    start = np.searchsorted(second_ns, first_ns - window, "left", sorter=order)
    stop = np.searchsorted(second_ns, first_ns + window, "right", sorter=order)
    candidates = sorted(
        (abs(int(first_ns[i]) - int(second_ns[j])), i, int(j))
        for i in range(len(first_ns))
        for j in order[start[i] : stop[i]]
    )
    pairs: dict[int, int] = {}
    taken: set[int] = set()
    for _, i, j in candidates:
        if i not in pairs and j not in taken:
            pairs[i] = j
            taken.add(j)
    rows = np.fromiter(pairs, np.int64, len(pairs))
    rows = rows[np.argsort(first_ns[rows], kind="stable")]
    return rows, np.array([pairs[int(i)] for i in rows], np.int64)


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

    def __init__(self, path: Path) -> None:
        """Creates the file; raises InputError if it cannot be written."""
        self._path = path
        try:
            self._file = path.open("wb", buffering=0)
        except OSError as error:
            raise not_written(path, error) from error
        self._append(TUM_HEADER)

    def append(self, stamp_ns: int, T_world_body: Float64) -> None:
        """Adds one pose [4, 4]; raises InputError if it cannot be written."""
        self._append(_tum_line(stamp_ns, T_world_body))

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


def read_kitti(path: Path) -> Float64:
    """The poses [N, 4, 4] in a KITTI file: the upper three rows of each matrix, no stamps.

    Raises:
        InputError: the file cannot be read, or a line does not contain twelve finite numbers.
    """
    poses = list(parsed_lines(path, _kitti_row, "write the upper 3x4 of the matrix on each line"))
    return np.stack(poses) if poses else np.empty((0, 4, 4))


def write_kitti(path: Path, poses: Float64) -> None:
    """Writes poses [N, 4, 4] as a KITTI file."""
    rows = np.asarray(poses)[:, :3, :].reshape(-1, 12)
    write_whole(path, "".join(numbers_text(row) + "\n" for row in rows))


def _kitti_row(words: list[str]) -> Float64:
    T = np.eye(4)
    T[:3] = finite_numbers(words, 12).reshape(3, 4)
    return T
