"""TUM RGB-D data sets, and others in that layout such as ICL-NUIM.

A folder with ``rgb.txt`` and ``depth.txt`` (lines ``stamp file``), and ``groundtruth.txt``.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.evaluation.trajectory import (
    MAX_TIME_DIFFERENCE_S,
    associate,
    parse_stamp,
    read_tum,
)
from rgbd_glue_ros.recordings import icl_nuim
from rgbd_glue_ros.recordings.calibration import load_calibration
from rgbd_glue_ros.recordings.image_sequence import DepthEncoding, ImagePair, ImageSequence
from rgbd_glue_ros.types import CameraIntrinsics, Int64

COLOR_LIST, DEPTH_LIST, GROUND_TRUTH = "rgb.txt", "depth.txt", "groundtruth.txt"

CALIBRATION = "camera_info.yaml"
"""Not part of the layout as published; where it is there, it is believed."""

UNITS_PER_METRE = 5000

_DEPTH = DepthEncoding(units_per_metre=UNITS_PER_METRE, invalid=(0,))

_RECORDED_BY = "openni_rgb_optical_frame"
"""The frame in TUM's own bags of its sequences, which were taken with Kinects and Xtions."""

# The benchmark recommends the driver's default for freiburg1 and 2: the depth images were
# registered with it, and undistorting them afterwards is not possible.
_DRIVER_DEFAULT = CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
_CAMERAS = {
    "freiburg1": _DRIVER_DEFAULT,
    "freiburg2": _DRIVER_DEFAULT,
    "freiburg3": CameraIntrinsics(640, 480, 535.4, 539.2, 320.1, 247.6),
    "icl": icl_nuim.CAMERA,
    "living_room": icl_nuim.CAMERA,
    "office_kt": icl_nuim.CAMERA,
}


def matches(folder: Path) -> bool:
    """Whether the folder is laid out so."""
    return (folder / COLOR_LIST).is_file() and (folder / DEPTH_LIST).is_file()


def open_tum(folder: Path, calibration: CameraIntrinsics | None = None) -> ImageSequence:
    """The sequence in ``folder``; a frame bears the stamp of its colour image.

    Args:
        folder: of the data set.
        calibration: of the camera; None takes it from ``CALIBRATION`` in the folder, or else
            from the folder's name.

    Raises:
        InputError: a list is malformed, no images pair up, or the camera is not known.
    """
    color_ns, color = _read_list(folder / COLOR_LIST)
    depth_ns, depth = _read_list(folder / DEPTH_LIST)
    rows = zip(*associate(color_ns, depth_ns), strict=True)
    pairs = tuple(
        ImagePair(int(color_ns[i]), color[i], int(depth_ns[j]), depth[j]) for i, j in rows
    )
    if not pairs:
        raise InputError(
            folder,
            f"no colour and depth image lie within {MAX_TIME_DIFFERENCE_S} s of each other",
            f"check the stamps in {COLOR_LIST} and {DEPTH_LIST}",
        )
    truth = folder / GROUND_TRUTH
    return ImageSequence(
        folder.resolve().name,
        pairs,
        _DEPTH,
        calibration or _camera(folder),
        read_tum(truth) if truth.is_file() else None,
        frame_id=_RECORDED_BY if "freiburg" in folder.resolve().name.lower() else "",
    )


def _camera(folder: Path) -> CameraIntrinsics:
    if (folder / CALIBRATION).is_file():
        return load_calibration(folder / CALIBRATION)
    name = folder.resolve().name.lower()
    for part, camera in _CAMERAS.items():
        if part in name:
            return camera
    raise InputError(
        folder,
        f"its name holds none of {', '.join(_CAMERAS)}, so its camera is not known",
        "give the calibration (--calibration camera_info.yaml)",
    )


def _read_list(path: Path) -> tuple[Int64, list[Path]]:
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(path, f"cannot be read ({error})", "restore the file") from error
    stamps: list[int] = []
    files: list[Path] = []
    for number, line in enumerate(lines, 1):
        if not line.strip() or line.startswith("#"):
            continue
        try:
            stamp, file = line.split()
            stamps.append(parse_stamp(stamp))
        except (ValueError, ArithmeticError) as error:
            raise InputError(
                f"{path}:{number}", "is not a stamp and a file", "restore the line"
            ) from error
        files.append(path.parent / file)
    return np.array(stamps, np.int64), files
