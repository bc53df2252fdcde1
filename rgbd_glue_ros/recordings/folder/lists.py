"""Lists of images: ``stamp file`` on each line, or ``stamp file stamp file`` of both images."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import inside, visible
from rgbd_glue_ros.files.stamp_text import stamps_ns
from rgbd_glue_ros.files.text_lines import Line, read_lines
from rgbd_glue_ros.parameters import metres_per_unit
from rgbd_glue_ros.printable import counted
from rgbd_glue_ros.recordings.frame_times import frame_stamp_ns
from rgbd_glue_ros.recordings.image_sequence import ImagePair, ImagePairs
from rgbd_glue_ros.recordings.left_out import COLOR, DEPTH
from rgbd_glue_ros.trajectories.association import MAX_TIME_DIFFERENCE_S, associate
from rgbd_glue_ros.types import Int64

logger = logging.getLogger(__name__)

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
        duplicates: how many lines repeat a stamp; the first one counts.
    """

    stamps_ns: Int64
    files: tuple[Path, ...]
    duplicates: int = 0


def lists_in(folder: Path) -> tuple[Path, Path] | None:
    """The lists of colour and depth images in a folder; None if either is missing."""
    color = next((folder / name for name in COLOR_LISTS if (folder / name).is_file()), None)
    depth = next((folder / name for name in DEPTH_LISTS if (folder / name).is_file()), None)
    return None if color is None or depth is None else (color, depth)


def association_in(folder: Path) -> Path | None:
    """The file in a folder that lists both images of every frame; None if there is none."""
    names = sorted(p for p in visible(folder, "*.txt") if ASSOCIATIONS.fullmatch(p.name))
    return next((path for path in names if _is_association(path)), None)


def scale_in_comments(depth_list: Path) -> float | None:
    """Metres per unit, if a comment of a list gives them: ``# depth scale: 1000``."""
    comments, _ = read_lines(depth_list)
    found = next(filter(None, map(_SCALE.search, comments)), None)
    try:
        return None if found is None else metres_per_unit(float(found[1]))
    except ValueError:
        return None


def paired(color_list: Path, depth_list: Path) -> ImagePairs:
    """The frames of two lists, one-to-one by time.

    Raises:
        InputError: a list cannot be read or names nothing, or no images pair up.
    """
    color, depth = read_list(color_list), read_list(depth_list)
    rows = zip(*associate(color.stamps_ns, depth.stamps_ns), strict=True)
    pairs = [
        ImagePair(int(color.stamps_ns[i]), color.files[i], int(depth.stamps_ns[j]), depth.files[j])
        for i, j in rows
    ]
    if not pairs:
        raise InputError(
            color_list.parent,
            f"no colour and depth images are within {MAX_TIME_DIFFERENCE_S} s of each other",
            f"check the stamps in {color_list.name} and {depth_list.name}",
        )
    images = {COLOR: len(color.files), DEPTH: len(depth.files)}
    return ImagePairs.of(pairs, images, max(color.duplicates, depth.duplicates))


def read_list(path: Path) -> ListedImages:
    """The images named by lines of a stamp and a file; other lines are skipped and logged.

    Raises:
        InputError: the file cannot be read, or has no such line.
    """
    rows = _rows(path, 2)
    files: dict[int, Path] = {}
    for stamp, (_, name) in zip(stamps_ns([stamp for stamp, _ in rows]), rows, strict=True):
        files.setdefault(stamp, _listed(path, name))
    stamps = np.array(list(files), np.int64)
    return ListedImages(stamps, tuple(files.values()), len(rows) - len(files))


def read_association(path: Path) -> ImagePairs:
    """The frames of lines of two stamps and files, colour or depth first; others are skipped.

    Depth is identified by its name. Stamps that are whole numbers starting from a small one are
    numbers of frames. Of lines with one stamp of colour, the first is taken.

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
    frames: dict[int, ImagePair] = {}
    for c, d, row in zip(color_ns, depth_ns, rows, strict=True):
        of_color, of_depth = (_listed(path, row[at + 1]) for at in (color, depth))
        frames.setdefault(c, ImagePair(c, of_color, d, of_depth))
    in_order = sorted(frames.values(), key=lambda pair: pair.stamp_ns)
    images = {COLOR: len(frames), DEPTH: len(frames)}
    return ImagePairs.of(in_order, images, len(rows) - len(frames))


def _listed(path: Path, name: str) -> Path:
    """The file that a list names, which may have been written on Windows."""
    file = inside(path.parent, name)
    is_from_windows = "\\" in name and not file.exists()
    return inside(path.parent, name.replace("\\", "/")) if is_from_windows else file


def _rows(path: Path, columns: int) -> list[tuple[str, ...]]:
    """The stamps and files at the start of every line, as many as columns."""
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
            "%s: %s skipped; the first: line %d",
            path,
            counted(len(skipped), "line names no image and was", "lines name no image and were"),
            skipped[0],
        )
    return rows


def _stamp_first(line: Line, columns: int) -> tuple[str, ...] | None:
    """Stamps and files in turn, as many as columns; None where a line does not begin with these."""
    found: list[str] = []
    words = list(line.words)
    try:
        while len(found) < columns:
            stamps_ns(words[:1])
            count, name = _first_file(words[1:])
            found += words[0], name
            words = words[1 + count :]
    except (ValueError, ArithmeticError, IndexError):
        return None
    return tuple(found)


def _first_file(words: list[str]) -> tuple[int, str]:
    """The file that words begin with, which may have blanks in its name and stand in quotes.

    Returns:
        Of how many words it is, and its name.

    Raises:
        ValueError: they begin with none.
    """
    for count in range(1, len(words) + 1):
        name = " ".join(words[:count]).strip("\"'")
        if _is_file(name):
            return count, name
    raise ValueError("no file")


def _is_file(word: str) -> bool:
    return re.search(r"\.[a-z]+\d?$", word, re.IGNORECASE) is not None


def _is_association(path: Path) -> bool:
    try:
        _, lines = read_lines(path)
    except InputError:
        return False
    return any(_stamp_first(line, 4) is not None for line in lines[:10])
