"""Trajectories in and out of files (TUM, KITTI, g2o), and pairing of stamps."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import NANOSECONDS, Float64, Int64, Trajectory

Row = TypeVar("Row")

MAX_TIME_DIFFERENCE_S = 0.02
"""Stamps further apart than this are not of the same moment (the TUM tools' value)."""

TUM_HEADER = "# timestamp tx ty tz qx qy qz qw"


def parse_stamp(text: str) -> int:
    """Nanoseconds from a decimal number of seconds, without passing through a float.

    Raises:
        ValueError: it is no finite number.
        ArithmeticError: it is no number at all, or an infinite one.
    """
    return int((Decimal(text) * NANOSECONDS).to_integral_value())


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
        max_difference_s: pairs further apart than this are not made.

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


def read_tum(path: Path) -> Trajectory:
    """The trajectory in a TUM file: lines ``stamp tx ty tz qx qy qz qw``; # starts a comment.

    Raises:
        InputError: the file cannot be read, holds no pose, or a line is not such a line.
    """
    rows = list(_parsed(path, _tum_row, f"write '{TUM_HEADER[2:]}' on each line"))
    if not rows:
        raise InputError(path, "holds no pose", "give a trajectory in TUM format")
    return Trajectory(
        np.array([stamp for stamp, _ in rows], np.int64), np.stack([T for _, T in rows])
    )


def write_tum(path: Path, trajectory: Trajectory) -> None:
    """Writes a TUM file, which ``read_tum`` reads back to the nanosecond."""
    with TumWriter(path) as writer:
        for stamp, T in zip(trajectory.stamps_ns, trajectory.poses, strict=True):
            writer.append(int(stamp), T)


class TumWriter:
    """Writes a TUM file pose by pose; what was appended is on disk, whatever happens after."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", encoding="ascii", buffering=1)
        self._file.write(TUM_HEADER + "\n")

    def append(self, stamp_ns: int, T_world_body: Float64) -> None:
        """Adds one pose [4, 4]."""
        self._file.write(f"{format_stamp(stamp_ns)} {_pose_text(T_world_body)}\n")

    def close(self) -> None:
        """Closes the file."""
        self._file.close()

    def __enter__(self) -> TumWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def read_kitti(path: Path) -> Float64:
    """The poses [N, 4, 4] in a KITTI file: the upper three rows of each matrix, no stamps.

    Raises:
        InputError: the file cannot be read, or a line does not hold twelve finite numbers.
    """
    poses = list(_parsed(path, _kitti_row, "write the upper 3x4 of the matrix on each line"))
    return np.stack(poses) if poses else np.empty((0, 4, 4))


def write_kitti(path: Path, poses: Float64) -> None:
    """Writes poses [N, 4, 4] as a KITTI file."""
    rows = np.asarray(poses)[:, :3, :].reshape(-1, 12)
    path.write_text("".join(_numbers(row) + "\n" for row in rows), encoding="ascii")


@dataclass(frozen=True)
class PoseGraphEdge:
    """A measured transform between two keyframes.

    Attributes:
        parent: row of the keyframe whose frame the transform maps to.
        child: row of the keyframe whose frame it maps from.
        T_parent_child: float64 [4, 4].
        covariance: float64 [6, 6] of T_parent_child (x y z rx ry rz; m, rad; perturbation on the
            left, in the parent's frame), positive definite.
    """

    parent: int
    child: int
    T_parent_child: Float64
    covariance: Float64


@dataclass(frozen=True)
class PoseGraph:
    """Keyframes and what was measured between them.

    Attributes:
        keyframes: T_odom_camera of every keyframe.
        edges: between rows of ``keyframes``.
    """

    keyframes: Trajectory
    edges: tuple[PoseGraphEdge, ...]


_VERTEX = "VERTEX_SE3:QUAT"
_EDGE = "EDGE_SE3:QUAT"
_STAMP = "#stamp"
# g2o's residual is the translation and the vector part of the quaternion (half the rotation
# vector) of Z^-1 X, seen from the child: this scales a rotation vector to that
_TO_G2O = np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])
_UPPER = np.triu_indices(6)


def write_g2o(path: Path, graph: PoseGraph) -> None:
    """Writes a pose graph; vertex ids are rows, their stamps stand in comments.

    The information matrix is the one g2o defines for the edge: of translation and quaternion
    vector, perturbed on the right.
    """
    with path.open("w", encoding="ascii") as file:
        rows = zip(graph.keyframes.stamps_ns, graph.keyframes.poses, strict=True)
        for row, (stamp, T) in enumerate(rows):
            file.write(f"{_STAMP} {row} {format_stamp(stamp)}\n{_VERTEX} {row} {_pose_text(T)}\n")
        for edge in graph.edges:
            information = _g2o_information(edge)[_UPPER]
            file.write(
                f"{_EDGE} {edge.parent} {edge.child} {_pose_text(edge.T_parent_child)} "
                f"{_numbers(information)}\n"
            )


def read_g2o(path: Path) -> PoseGraph:
    """The pose graph in a file that ``write_g2o`` wrote.

    Raises:
        InputError: the file cannot be read, or a line in it is malformed.
    """
    stamps: dict[int, int] = {}
    poses: dict[int, Float64] = {}
    edges: list[PoseGraphEdge] = []

    def row(words: list[str]) -> None:
        if words[0] == _STAMP:
            stamps[int(words[1])] = parse_stamp(words[2])
        elif words[0] == _VERTEX:
            poses[int(words[1])] = _pose(words[2:])
        elif words[0] == _EDGE:
            edges.append(_g2o_edge(words))
        else:
            raise ValueError(f"unknown tag {words[0]}")

    for _ in _parsed(path, row, f"give {_VERTEX} and {_EDGE} lines", comment="# "):
        pass
    if sorted(poses) != list(range(len(poses))) or stamps.keys() != poses.keys():
        raise InputError(path, "its vertices are not 0, 1, 2… with stamps", "export it again")
    keyframes = Trajectory(
        np.array([stamps[i] for i in range(len(poses))], np.int64),
        np.array([poses[i] for i in range(len(poses))]).reshape(-1, 4, 4),
    )
    return PoseGraph(keyframes, tuple(edges))


def _g2o_information(edge: PoseGraphEdge) -> Float64:
    A = se3.adjoint(se3.inverse(edge.T_parent_child)) * _TO_G2O[:, None]
    return np.linalg.inv(A @ edge.covariance @ A.T)


def _g2o_edge(words: list[str]) -> PoseGraphEdge:
    T = _pose(words[3:10])
    upper = np.zeros((6, 6))
    upper[_UPPER] = _finite(words[10:], 21)
    information = upper + np.triu(upper, 1).T
    A = se3.adjoint(T) / _TO_G2O
    return PoseGraphEdge(int(words[1]), int(words[2]), T, A @ np.linalg.inv(information) @ A.T)


def _parsed(
    path: Path, parse: Callable[[list[str]], Row], remedy: str, comment: str = "#"
) -> Iterator[Row]:
    """What ``parse`` makes of the words of each line that is neither empty nor a comment."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "give a text file") from error
    except UnicodeDecodeError as error:
        raise InputError(path, "is no text", "give a text file") from error
    for number, line in enumerate(lines, 1):
        words = line.replace(",", " ").split()
        if not words or line.lstrip().startswith(comment):
            continue
        try:
            yield parse(words)
        except (ValueError, ArithmeticError, IndexError) as error:
            reason = str(error) if isinstance(error, ValueError) else "not a number"
            raise InputError(f"{path}:{number}", reason, remedy) from error


def _tum_row(words: list[str]) -> tuple[int, Float64]:
    if len(words) != 8:
        raise ValueError(f"{len(words)} values where 8 belong")
    return parse_stamp(words[0]), _pose(words[1:])


def _kitti_row(words: list[str]) -> Float64:
    T = np.eye(4)
    T[:3] = _finite(words, 12).reshape(3, 4)
    return T


def _pose(words: list[str]) -> Float64:
    numbers = _finite(words, 7)
    if not np.any(numbers[3:]):
        raise ValueError("a quaternion of zeros")
    return se3.from_translation_quaternion(numbers[:3], numbers[3:])


def _finite(words: list[str], count: int) -> Float64:
    if len(words) != count:
        raise ValueError(f"{len(words)} values where {count} belong")
    numbers = np.array([float(word) for word in words])
    if not np.isfinite(numbers).all():
        raise ValueError("a value that is not finite")
    return numbers


def _pose_text(T: Float64) -> str:
    return _numbers(np.concatenate([T[:3, 3], se3.quaternion(T)]))


def _numbers(row: Float64) -> str:
    # 15 significant digits: shorter than an exact float, and far finer than any measurement
    return " ".join(f"{value:.15g}" for value in row)
