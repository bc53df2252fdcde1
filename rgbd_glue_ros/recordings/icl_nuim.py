"""ICL-NUIM as its "TUM compatible PNGs" are packed: ``associations.txt`` and ``*.gt.freiburg``.

Not quite the layout of TUM: frames are numbered and not stamped, and the poses are those of a world
whose y axis points up, as the mirror image of the one that the images show.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory import read_tum
from rgbd_glue_ros.input_files import inside, read_text
from rgbd_glue_ros.recordings.image_sequence import DepthEncoding, ImagePair, ImageSequence
from rgbd_glue_ros.recordings.sens import stamp_ns
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, Float64, Trajectory

ASSOCIATIONS, TRUTH = "associations.txt", "*.gt.freiburg"

CAMERA = CameraIntrinsics(640, 480, 481.2, 480.0, 319.5, 239.5)
"""With a positive fy: the published -480 belongs to the rows of other files, counted upward."""

_DEPTH = DepthEncoding(units_per_metre=5000.0, invalid=(0,))
_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


def matches(folder: Path) -> bool:
    """Whether the folder is laid out so."""
    return (folder / ASSOCIATIONS).is_file() and any(folder.glob(TRUTH))


def open_icl_nuim(folder: Path, calibration: CameraIntrinsics | None = None) -> ImageSequence:
    """The sequence in ``folder``; frame i is at (i + 1) / 30 s.

    Raises:
        InputError: a list is malformed or empty.
    """
    pairs = [_pair(folder, *line) for line in _lines(folder / ASSOCIATIONS)]
    if not pairs:
        raise InputError(folder / ASSOCIATIONS, "names no frame", "restore the file")
    numbered = read_tum(next(iter(sorted(folder.glob(TRUTH)))))
    stamps = [stamp_ns(round(number / NANOSECONDS)) for number in numbered.stamps_ns]
    truth = Trajectory(np.array(stamps, np.int64), mirrored(numbered.poses))
    return ImageSequence(
        folder.resolve().name,
        tuple(sorted(pairs, key=lambda pair: pair.stamp_ns)),
        _DEPTH,
        calibration or CAMERA,
        truth,
    )


def mirrored(poses: Float64) -> Float64:
    """The poses [N, 4, 4] as they are in the mirror image of their world, y turned around."""
    result: Float64 = _MIRROR @ poses @ _MIRROR
    return result


def _pair(folder: Path, where: str, line: str) -> ImagePair:
    """The frame of a line ``i depth/i.png i rgb/i.png``."""
    try:
        number, depth, same, color = line.split()
        if int(number) != int(same):
            raise ValueError(line)  # noqa: TRY301 - as any other malformed line
    except ValueError as error:
        raise InputError(
            where, "is not a number and a depth image and the same and colour", "restore the line"
        ) from error
    stamp = stamp_ns(int(number))
    return ImagePair(stamp, inside(folder, color), stamp, inside(folder, depth))


def _lines(path: Path) -> list[tuple[str, str]]:
    """Every line with its place."""
    return [
        (f"{path}:{number}", line)
        for number, line in enumerate(read_text(path).splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
