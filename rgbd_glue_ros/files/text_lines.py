"""Lines of numbers in text files; errors name the line by its number."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import read_text
from rgbd_glue_ros.types import Float64

Row = TypeVar("Row")

# A stamp and a pose.
_WORDS_OF_A_POSE = 8


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
    if len(words) >= _WORDS_OF_A_POSE and any(map(_is_decimal_comma, words)):
        return tuple(word.replace(",", ".") for word in words)
    return tuple(line.replace(";", " ").replace(",", " ").split())


def _is_decimal_comma(word: str) -> bool:
    return re.fullmatch(r"[-+]?\d+,\d+(e[-+]?\d+)?", word, re.IGNORECASE) is not None


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


def numbers_text(row: Float64) -> str:
    """Numbers [N] separated by blanks."""
    # 15 significant digits: shorter than an exact float, and far finer than any measurement
    return " ".join(f"{value:.15g}" for value in row)
