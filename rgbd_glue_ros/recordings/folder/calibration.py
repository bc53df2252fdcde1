"""Calibration files in the folder of a recording, and above it."""

from __future__ import annotations

import logging
from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import visible
from rgbd_glue_ros.recordings.calibration import Calibration, read_calibration

logger = logging.getLogger(__name__)

NAMES = (
    "camera_info.yaml",
    "calibration.txt",
    "calibration.yaml",
    "camera_intrinsic.json",
    "camera_intrinsics.json",
    "intrinsic.json",
    "intrinsics.json",
    "cam_params.json",
    "metadata",
    "metadata.json",
    "camera_matrix.csv",
    "camera-intrinsics.txt",
    "camera_intrinsics.txt",
    "intrinsics.txt",
    "intrinsic.txt",
    "K.txt",
    "k.txt",
    "intrinsic/intrinsic_color.txt",
    "intrinsic/intrinsic_depth.txt",
)
"""Names that programs write, the plainest first."""

# A file for each frame, of which the first is used
_FOR_EACH_FRAME = "*_intrinsics/*.pincam"
_OTHERS = ("*.yaml", "*.yml", "*calib*.json", "*intrinsic*.json", "*intrinsic*.txt")


def calibration_of(folder: Path) -> Calibration | None:
    """The calibration in a folder, or otherwise in the one above it; None if neither has any.

    Other files are ignored, with a warning if they have the name of one.

    Raises:
        InputError: several files there contain different cameras.
    """
    for place in (folder, folder.resolve().parent):
        named = [place / name for name in NAMES if (place / name).is_file()]
        found = next((c for c in map(_read, named) if c is not None), None)
        if found is not None:
            return found
        # files with any name may belong to anything: only files of the recording itself
        if place == folder:
            found = _the_only(folder) or _of_first_frame(folder)
            if found is not None:
                return found
    return None


def _read(path: Path) -> Calibration | None:
    try:
        return read_calibration(path)
    except InputError as error:
        level = logging.WARNING if path.name in NAMES else logging.DEBUG
        logger.log(level, "%s; ignored", error)
        return None


def _of_first_frame(folder: Path) -> Calibration | None:
    first = min(visible(folder, _FOR_EACH_FRAME), default=None)
    return None if first is None else _read(first)


def _the_only(folder: Path) -> Calibration | None:
    paths = sorted({path for pattern in _OTHERS for path in visible(folder, pattern)})
    read = {path.name: _read(path) for path in paths}
    found = {name: calibration for name, calibration in read.items() if calibration is not None}
    if len({calibration.intrinsics for calibration in found.values()}) > 1:
        raise InputError(
            folder,
            f"{', '.join(found)} are of different cameras",
            "give that of the colour images (--calibration FILE)",
        )
    return next(iter(found.values()), None)
