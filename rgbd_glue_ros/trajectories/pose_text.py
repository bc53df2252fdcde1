"""Poses as text: position and quaternion, or the rows of a matrix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rgbd_glue_ros.files.text_lines import finite_numbers, numbers_text
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import Float64
from rgbd_glue_ros.types.checks import FARTHEST_READ_M

# the squares of other numbers are zero, or infinite
_SQUARED = (1e-100, 1e100)

MATRIX_SHAPES = {12: (3, 4), 16: (4, 4)}
"""Numbers on a line that form the upper rows of a pose, or all of it."""


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
    """Refuses a position too far away, which would overflow in an alignment.

    Raises:
        ValueError: the position is that far away.
    """
    if np.abs(position).max() > FARTHEST_READ_M:
        raise ValueError(f"a position more than {FARTHEST_READ_M:g} m away")


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


def pose_text(T: Float64) -> str:
    """X y z qx qy qz qw of a pose [4, 4]."""
    return numbers_text(np.concatenate([T[:3, 3], se3.quaternion(T)]))
