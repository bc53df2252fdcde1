"""Trajectories as text, in any of the usual forms: the meaning of each column.

Columns are identified by a line of names if there is one, otherwise by their number. Stamps are
seconds, milli-, micro- or nanoseconds, depending on their magnitude.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.stamp_text import stamps_ns
from rgbd_glue_ros.files.text_lines import Line, read_lines, split_words
from rgbd_glue_ros.printable import counted
from rgbd_glue_ros.trajectories.pose_text import MATRIX_SHAPES, parse_matrix, parse_pose
from rgbd_glue_ros.types import Float64

logger = logging.getLogger(__name__)

TUM_COLUMNS = ("stamp", "x", "y", "z", "qx", "qy", "qz", "qw")
_W_FIRST = ("stamp", "x", "y", "z", "qw", "qx", "qy", "qz")
# EuRoC's ground truth has velocities and biases after the pose
_EUROC_WIDTH = 17

_NAMES = {
    "stamp": r"#?\s*(time_?stamp|time|stamp|t|secs?|seconds)(_?(n|u|m)?s(ec)?)?",
    **{axis: rf"((p|t|pos|pose|position|trans|translation)(_.*)?_?)?{axis}" for axis in "xyz"},
    **{f"q{axis}": rf"(q|quat|quaternion|rot|orientation)(_.*)?_?{axis}" for axis in "xyzw"},
}


def stamped_poses(path: Path) -> tuple[list[int], list[Float64]]:
    """Stamps (nanoseconds) and poses [4, 4] of a file with one pose per line.

    Lines without a pose are skipped and counted in one warning; of lines with the same stamp, the
    first is used.

    Raises:
        InputError: the file cannot be read, or none of its lines contains a stamp and a pose.
    """
    comments, lines = read_lines(path)
    if not lines:
        raise InputError(path, "holds no pose", "give a trajectory in TUM format")
    names = [split_words(comment) for comment in comments]
    if _is_bare_header(lines[0]):
        names.append(lines[0].words)
        lines = lines[1:]
    parse = _parser(path, lines, names)
    skipped: list[tuple[str, str]] = []
    stamps: list[str] = []
    poses: list[Float64] = []
    for line in lines:
        try:
            stamp, pose = parse(line.words)
            stamps_ns([stamp])
        except (ValueError, ArithmeticError, IndexError) as error:
            reason = str(error) if isinstance(error, ValueError) else "not a number"
            skipped.append((f"{path}:{line.number}", reason))
            continue
        stamps.append(stamp)
        poses.append(pose)
    if not poses:
        place, reason = skipped[0] if skipped else (str(path), "no line of numbers")
        raise InputError(place, reason, f"write '{' '.join(TUM_COLUMNS)}' on each line")
    if skipped:
        logger.warning(
            "%s skipped; the first: %s: %s",
            counted(len(skipped), "line is no pose and was", "lines are no poses and were"),
            *skipped[0],
        )
    return _without_duplicates(path, stamps_ns(stamps), poses)


def _without_duplicates(
    path: Path, stamps: list[int], poses: list[Float64]
) -> tuple[list[int], list[Float64]]:
    first: dict[int, Float64] = {}
    for stamp, pose in zip(stamps, poses, strict=True):
        first.setdefault(stamp, pose)
    count = len(stamps) - len(first)
    # stamps that lost digits stay in order; those of a bag in a loop do not
    if count > len(first) and stamps == sorted(stamps):
        raise InputError(
            path,
            f"its {len(stamps)} poses have only {len(first)} different stamps",
            "write stamps with all their digits",
        )
    if count:
        said = counted(count, "line repeats a stamp and was", "lines repeat a stamp and were")
        logger.warning("%s: %s skipped", path, said)
    return list(first), list(first.values())


def _is_bare_header(line: Line) -> bool:
    return not any(_is_number(word) for word in line.words)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


_Parser = Callable[[tuple[str, ...]], tuple[str, Float64]]


def _parser(path: Path, lines: list[Line], names: list[tuple[str, ...]]) -> _Parser:
    """A function that extracts stamp and pose from the words of a line."""
    width = max((len(line.words) for line in lines), default=0)
    for words in names:
        order = _named_columns(words)
        if order is not None:
            return _of_columns(order)
    if width in MATRIX_SHAPES:
        raise InputError(
            path,
            f"its {width} numbers per line are poses without stamps (KITTI)",
            "give a trajectory with a stamp before each pose (TUM)",
        )
    if width == 4:
        raise InputError(
            path, "holds positions without orientations", "give a trajectory in TUM format"
        )
    if width - 1 in MATRIX_SHAPES and not _is_euroc(lines):
        return _stamp_and_matrix
    if width == _EUROC_WIDTH:
        return _of_columns([_W_FIRST.index(name) for name in TUM_COLUMNS])
    # there may be another column before or after: a quaternion has unit length
    start = 1 if width == 9 and not _has_quaternions(lines, 0) and _has_quaternions(lines, 1) else 0
    return _of_columns(range(start, start + 8))


def _named_columns(words: tuple[str, ...]) -> list[int] | None:
    """Positions of the TUM columns in a line of names; None if it does not name them all."""
    plain = [word.lower() for word in words if not word.startswith("[")]
    columns = []
    for name in TUM_COLUMNS:
        at = [i for i, word in enumerate(plain) if re.fullmatch(_NAMES[name], word)]
        if len(at) != 1:
            return None
        columns.append(at[0])
    return columns


def _of_columns(columns: Sequence[int]) -> _Parser:
    def parse(words: tuple[str, ...]) -> tuple[str, Float64]:
        if len(words) <= max(columns):
            raise ValueError(f"{len(words)} values instead of {max(columns) + 1}")
        stamp, *pose = (words[i] for i in columns)
        return stamp, parse_pose(pose)

    return parse


def _stamp_and_matrix(words: tuple[str, ...]) -> tuple[str, Float64]:
    return words[0], parse_matrix(words[1:])


def _is_euroc(lines: list[Line]) -> bool:
    """Whether lines as long as a stamp and a matrix [4, 4] do not end in a matrix row."""
    return len(lines[0].words) == _EUROC_WIDTH and [
        float(word) for word in lines[0].words[-4:] if _is_number(word)
    ] != [0, 0, 0, 1]


def _has_quaternions(lines: list[Line], start: int) -> bool:
    try:
        numbers = [[float(word) for word in line.words[start + 4 : start + 8]] for line in lines]
        return bool(np.median(np.abs(np.linalg.norm(numbers, axis=1) - 1)) < 0.01)
    except ValueError:
        return False
