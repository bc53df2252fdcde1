"""Lists of images: ``stamp file`` on each line, or ``stamp file stamp file`` of both images."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory import MAX_TIME_DIFFERENCE_S, associate
from rgbd_glue_ros.evaluation.trajectory_text import Line, read_lines, stamps_ns
from rgbd_glue_ros.files.reading import inside
from rgbd_glue_ros.parameters import metres_per_unit
from rgbd_glue_ros.recordings.image_sequence import ImagePair
from rgbd_glue_ros.types import NANOSECONDS, Int64

logger = logging.getLogger(__name__)

RATE_HZ = 30
"""Assumed rate of numbered images, which have no stamps."""

COLOR_LISTS = ("rgb.txt", "color.txt", "colour.txt", "image.txt", "images.txt")
DEPTH_LISTS = ("aligned_depth.txt", "depth_aligned.txt", "depth.txt")
ASSOCIATIONS = re.compile(r"assoc\w*(-\w+)?\.txt|\w*associat\w*\.txt|rgbd(_assoc)?\.txt", re.I)

_SCALE = re.compile(r"(?:depth[ _]?)?(?:scale|factor)[ _a-z]*[:= ]\s*([\d.]+(?:e-?\d+)?)", re.I)
_IS_DEPTH = re.compile("depth", re.IGNORECASE)


@dataclass(frozen=True)
class ListedImages:
    """The images named by a list.

    Attributes:
        stamps_ns: of each, int64 [N].
        files: of each.
    """

    stamps_ns: Int64
    files: tuple[Path, ...]


def lists_in(folder: Path) -> tuple[Path, Path] | None:
    """The lists of colour and depth images in a folder; None if either is missing."""
    color = next((folder / name for name in COLOR_LISTS if (folder / name).is_file()), None)
    depth = next((folder / name for name in DEPTH_LISTS if (folder / name).is_file()), None)
    return None if color is None or depth is None else (color, depth)


def association_in(folder: Path) -> Path | None:
    """The file in a folder that lists both images of every frame; None if there is none."""
    names = sorted(p for p in folder.glob("*.txt") if ASSOCIATIONS.fullmatch(p.name))
    return next((path for path in names if _is_association(path)), None)


def scale_in_comments(depth_list: Path) -> float | None:
    """Metres per unit, if a comment of a list gives them: ``# depth scale: 1000``."""
    comments, _ = read_lines(depth_list)
    found = next(filter(None, map(_SCALE.search, comments)), None)
    try:
        return None if found is None else metres_per_unit(float(found[1]))
    except ValueError:
        return None


def paired(color_list: Path, depth_list: Path) -> tuple[ImagePair, ...]:
    """The frames of two lists, one-to-one by time.

    Raises:
        InputError: a list cannot be read or names nothing, or no images pair up.
    """
    color, depth = read_list(color_list), read_list(depth_list)
    rows = zip(*associate(color.stamps_ns, depth.stamps_ns), strict=True)
    pairs = tuple(
        ImagePair(int(color.stamps_ns[i]), color.files[i], int(depth.stamps_ns[j]), depth.files[j])
        for i, j in rows
    )
    if not pairs:
        raise InputError(
            color_list.parent,
            f"no colour and depth images are within {MAX_TIME_DIFFERENCE_S} s of each other",
            f"check the stamps in {color_list.name} and {depth_list.name}",
        )
    return pairs


def read_list(path: Path) -> ListedImages:
    """The images named by lines of a stamp and a file; other lines are skipped and logged.

    Raises:
        InputError: the file cannot be read, or has no such line.
    """
    rows = _rows(path, 2)
    stamps = stamps_ns([stamp for stamp, _ in rows])
    return ListedImages(
        np.array(stamps, np.int64), tuple(inside(path.parent, name) for _, name in rows)
    )


def read_association(path: Path) -> tuple[ImagePair, ...]:
    """The frames in lines of two stamps and files, colour or depth first; others are skipped.

    Depth is identified by its name. Stamps that are whole numbers starting from a small one are
    numbers of frames, at ``RATE_HZ`` per second.

    Raises:
        InputError: the file cannot be read, has no such line, or depth cannot be identified.
    """
    rows = _rows(path, 4)
    first, second = (any(_IS_DEPTH.search(row[i]) for row in rows) for i in (1, 3))
    if first == second:
        raise InputError(
            path,
            f"does not show which of {rows[0][1]} and {rows[0][3]} is depth",
            "rename the folder of the depth images to depth",
        )
    color, depth = (2, 0) if first else (0, 2)
    times = [[row[at] for row in rows] for at in (color, depth)]
    numbers = [stamp for texts in times for stamp in texts]
    is_numbered = all(re.fullmatch(r"\d{1,7}", text) for text in numbers)
    color_ns, depth_ns = (
        [frame_stamp_ns(int(text)) for text in texts] if is_numbered else stamps_ns(texts)
        for texts in times
    )
    frames = [
        ImagePair(c, inside(path.parent, row[color + 1]), d, inside(path.parent, row[depth + 1]))
        for c, d, row in zip(color_ns, depth_ns, rows, strict=True)
    ]
    return tuple(sorted(frames, key=lambda pair: pair.stamp_ns))


def frame_stamp_ns(number: int) -> int:
    """When a numbered frame was taken; from 1/30 s on, since a stamp of zero means none in ROS."""
    return (number + 1) * NANOSECONDS // RATE_HZ


def _rows(path: Path, columns: int) -> list[tuple[str, ...]]:
    """The first words of every line, as many as columns, if every other one is a number."""
    _, lines = read_lines(path)
    rows = []
    skipped = []
    for line in lines:
        words = _stamp_first(line, columns)
        if words is None:
            skipped.append(line.number)
        else:
            rows.append(words)
    if not rows:
        kind = "a stamp and a file" if columns == 2 else "stamp, file, stamp, file"
        raise InputError(path, f"holds no lines of {kind}", "restore the file")
    # a header line is not counted as lost
    if skipped and skipped != [lines[0].number]:
        logger.warning(
            "%s: %d lines name no image and were skipped; the first: line %d",
            path,
            len(skipped),
            skipped[0],
        )
    return rows


def _stamp_first(line: Line, columns: int) -> tuple[str, ...] | None:
    words = line.words[:columns]
    if len(words) < columns:
        return None
    try:
        for at in range(0, columns, 2):
            if not _is_file(words[at + 1]):
                return None
            stamps_ns([words[at]])
    except (ValueError, ArithmeticError):
        return None
    return words


def _is_file(word: str) -> bool:
    return re.search(r"\.[a-z]+\d?$", word, re.IGNORECASE) is not None


def _is_association(path: Path) -> bool:
    try:
        _, lines = read_lines(path)
    except InputError:
        return False
    return any(_stamp_first(line, 4) is not None for line in lines[:10])
