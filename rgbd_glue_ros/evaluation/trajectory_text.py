"""Trajectories as text, in any of the usual forms: the meaning of each column.

Columns are identified by a line of names if there is one, otherwise by their number. Stamps are
seconds, milli-, micro- or nanoseconds, depending on their magnitude.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.text_lines import check_position, finite_numbers, parse_pose
from rgbd_glue_ros.files.reading import read_text
from rgbd_glue_ros.types import NANOSECONDS, Float64

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

# Upper limits of stamps in these units; today's stamps in each are a thousand times those in the
# previous
_END_OF_TIME_NS = 2**63
_SECONDS_BELOW, _MILLISECONDS_BELOW, _MICROSECONDS_BELOW = Decimal("9.2e9"), Decimal(10**14), 10**17

MATRIX_SHAPES = {12: (3, 4), 16: (4, 4)}
"""Numbers on a line that form the upper rows of a pose, or all of it."""


@dataclass(frozen=True)
class Line:
    """A line of a text file that is not empty: its number from 1, and its words."""

    number: int
    words: tuple[str, ...]


def read_lines(path: Path) -> tuple[list[str], list[Line]]:
    """The comments of a text file without their mark, and its other lines.

    Raises:
        InputError: the file cannot be read, or is not a text.
    """
    text = read_text(path)
    comments: list[str] = []
    lines: list[Line] = []
    for number, line in enumerate(text.splitlines(), 1):
        plain = line.strip()
        if plain.startswith(("#", "%", "//")):
            comments.append(plain.lstrip("#%/ "))
        elif plain:
            lines.append(Line(number, split_words(plain)))
    return comments, lines


def split_words(line: str) -> tuple[str, ...]:
    """The words of a line, separated by blanks, commas or semicolons."""
    words = line.replace(";", " ").split()
    # a comma inside of a number and none behind it is what some write for a point; whole numbers
    # have none, as those of a trajectory's first pose
    if len(words) >= len(TUM_COLUMNS) and any(map(_is_decimal_comma, words)):
        return tuple(word.replace(",", ".") for word in words)
    return tuple(line.replace(";", " ").replace(",", " ").split())


def _is_decimal_comma(word: str) -> bool:
    return re.fullmatch(r"[-+]?\d+,\d+(e[-+]?\d+)?", word, re.IGNORECASE) is not None


def stamps_ns(texts: Sequence[str]) -> list[int]:
    """Stamps of one file as nanoseconds, without passing through a float.

    Args:
        texts: decimal numbers of seconds, or of smaller units according to their magnitude.

    Raises:
        ValueError: a number is not finite, or exceeds 64 bits.
        ArithmeticError: a text is not a
            number.
    """
    numbers = [Decimal(text) for text in texts]
    if any(not number.is_finite() for number in numbers):
        raise ValueError("a stamp that is not finite")
    largest = max(map(abs, numbers), default=Decimal(0))
    # an exponent of a million would create a whole number of a million digits
    if largest >= _END_OF_TIME_NS:
        raise ValueError("a stamp out of range")
    unit = _nanoseconds_of_unit(largest)
    return [int((number * unit).to_integral_value()) for number in numbers]


def _nanoseconds_of_unit(largest: Decimal) -> int:
    if largest < _SECONDS_BELOW:
        return NANOSECONDS
    if largest < _MILLISECONDS_BELOW:
        return NANOSECONDS // 10**3
    return NANOSECONDS // 10**6 if largest < _MICROSECONDS_BELOW else 1


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
    skipped: list[str] = []
    stamps: list[str] = []
    poses: list[Float64] = []
    for line in lines:
        try:
            stamp, pose = parse(line.words)
            stamps_ns([stamp])
        except (ValueError, ArithmeticError, IndexError) as error:
            reason = str(error) if isinstance(error, ValueError) else "not a number"
            skipped.append(f"{path}:{line.number}: {reason}")
            continue
        stamps.append(stamp)
        poses.append(pose)
    if not poses:
        place, reason = (skipped or [f"{path}: no line of numbers"])[0].rsplit(": ", 1)
        raise InputError(place, reason, f"write '{' '.join(TUM_COLUMNS)}' on each line")
    if skipped:
        logger.warning(
            "%d lines contain no pose and were skipped; the first: %s", *_counted(skipped)
        )
    return _without_duplicates(path, stamps_ns(stamps), poses)


def _counted(skipped: list[str]) -> tuple[int, str]:
    return len(skipped), skipped[0]


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
        logger.warning("%s: %d lines repeat a stamp and were skipped", path, count)
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


def parse_matrix(words: Sequence[str]) -> Float64:
    """The pose [4, 4] written as the rows of a matrix, with or without the last.

    Raises:
        ValueError: the text is not a pose.
    """
    if len(words) not in MATRIX_SHAPES:
        raise ValueError(f"{len(words)} values instead of 12 or 16")
    T = np.eye(4)
    rows, columns = MATRIX_SHAPES[len(words)]
    T[:rows] = finite_numbers(list(words), rows * columns).reshape(rows, columns)
    if abs(np.linalg.det(T[:3, :3]) - 1) > 0.1:
        raise ValueError("a matrix that is not a rotation")
    check_position(T[:3, 3])
    return T


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
