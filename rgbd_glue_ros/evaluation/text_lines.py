"""Lines of numbers in text files; errors name the line by its number."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import read_text
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float64

Row = TypeVar("Row")

_FARTHEST_M = 1e9
# the squares of other numbers are zero, or infinite
_SQUARED = (1e-100, 1e100)


def parsed_lines(
    path: Path, parse: Callable[[list[str]], Row], remedy: str, comment: str = "#"
) -> Iterator[Row]:
    """The result of ``parse`` for the words of each line that is neither empty nor a comment.

    Args:
        path: of the file.
        parse: raises ValueError, ArithmeticError or IndexError if a line is malformed.
        remedy: what to do then.
        comment: what a comment begins with.

    Raises:
        InputError: the file cannot be read, or a line in it is malformed.
    """
    for number, line in enumerate(read_text(path).splitlines(), 1):
        words = line.replace(",", " ").split()
        if not words or line.lstrip().startswith(comment):
            continue
        try:
            yield parse(words)
        except (ValueError, ArithmeticError, IndexError) as error:
            reason = str(error) if isinstance(error, ValueError) else "not a number"
            raise InputError(f"{path}:{number}", reason, remedy) from error


def parse_pose(words: list[str]) -> Float64:
    """The pose [4, 4] written as x y z qx qy qz qw.

    Raises:
        ValueError: the text is not a pose.
    """
    numbers = finite_numbers(words, 7)
    position, turn = numbers[:3], numbers[3:]
    check_position(position)
    length = np.abs(turn).max()
    if length == 0:
        raise ValueError("a quaternion of zeros")
    if not _SQUARED[0] < length < _SQUARED[1]:
        turn = turn / length
    return se3.from_translation_quaternion(position, turn)


def check_position(position: Float64) -> None:
    """Refuses a position beyond the moon, which would overflow in an alignment.

    Raises:
        ValueError: the position is that far away.
    """
    if np.abs(position).max() > _FARTHEST_M:
        raise ValueError(f"a position more than {_FARTHEST_M:g} m away")


def finite_numbers(words: list[str], count: int) -> Float64:
    """A given number of finite numbers, float64 [count].

    Raises:
        ValueError: there are more or fewer, or one is not finite.
    """
    if len(words) != count:
        raise ValueError(f"{len(words)} values instead of {count}")
    numbers = np.array([float(word) for word in words])
    if not np.isfinite(numbers).all():
        raise ValueError("a value that is not finite")
    return numbers


def pose_text(T: Float64) -> str:
    """X y z qx qy qz qw of a pose [4, 4]."""
    return numbers_text(np.concatenate([T[:3, 3], se3.quaternion(T)]))


def numbers_text(row: Float64) -> str:
    """Numbers [N] separated by blanks."""
    # 15 significant digits: shorter than an exact float, and far finer than any measurement
    return " ".join(f"{value:.15g}" for value in row)
