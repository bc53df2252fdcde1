"""TUM RGB-D data sets, and others in that layout such as ICL-NUIM.

A folder with ``rgb.txt`` and ``depth.txt`` (lines ``stamp file``), and ``groundtruth.txt``.
"""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import visible
from rgbd_glue_ros.files.stamp_text import stamps_ns
from rgbd_glue_ros.files.text_lines import Line, finite_numbers, read_lines
from rgbd_glue_ros.messages.imu import ImuReading, imu_samples
from rgbd_glue_ros.printable import counted
from rgbd_glue_ros.recordings import depth_encoding, icl_nuim
from rgbd_glue_ros.recordings.calibration import Calibration, say_unit
from rgbd_glue_ros.recordings.folder.calibration import calibration_of
from rgbd_glue_ros.recordings.folder.lists import (
    association_in,
    lists_in,
    paired,
    scale_in_comments,
)
from rgbd_glue_ros.recordings.folder.truth import truth_of
from rgbd_glue_ros.recordings.image_sequence import ImageSequence
from rgbd_glue_ros.types import CameraIntrinsics, ImuSamples

logger = logging.getLogger(__name__)

COLOR_LIST, DEPTH_LIST, GROUND_TRUTH = "rgb.txt", "depth.txt", "groundtruth.txt"

ACCELEROMETER = "accelerometer.txt"
"""Lines of a stamp and an acceleration, m/s²; if present, it shows which way is up."""

R_OPTICAL_ACCELEROMETER = np.diag([-1.0, -1.0, 1.0])
"""From the axes of a Kinect's accelerometer, which are x left, y up, z forward."""

CALIBRATION = "camera_info.yaml"
"""Not part of the published layout; used if present."""

# Names of depth images in its sequences: the time, in seconds since 1970
_STAMPED = re.compile(r"\d{10}\.\d{6}\.png")

_RECORDED_BY = "openni_rgb_optical_frame"
"""The frame in TUM's own bags of its sequences, which were taken with Kinects and Xtions."""

# The benchmark recommends the driver's default for freiburg1 and 2: the depth images were
# registered with it, and undistorting them afterwards is not possible.
_DRIVER_DEFAULT = CameraIntrinsics(640, 480, 525.0, 525.0, 319.5, 239.5)
_CAMERAS = {
    "freiburg1": _DRIVER_DEFAULT,
    "freiburg2": _DRIVER_DEFAULT,
    "freiburg3": CameraIntrinsics(640, 480, 535.4, 539.2, 320.1, 247.6),
    # with its distortion, as its page gives it for the colour camera
    "rgbd_bonn": CameraIntrinsics(
        *(640, 480, 542.822841, 542.576870, 315.593520, 237.756098),
        distortion=(0.039903, -0.099343, -0.000730, -0.000144, 0.0),
    ),
    "icl": icl_nuim.CAMERA,
    "living_room_traj": icl_nuim.CAMERA,
    "living_room_kt": icl_nuim.CAMERA,
    "office_kt": icl_nuim.CAMERA,
}
"""By the words that name a data set: the same letters inside of another word mean nothing, as in
``vehicle``, and a living room may be anybody's."""


def _words(name: str) -> re.Pattern[str]:
    """Finds a name that stands by itself in another one, maybe with a number: ``office_kt0``."""
    pattern = re.sub("[_ ]", "[-_. ]", name).replace("freiburg", "fr(?:eiburg)?")
    number = "" if name[-1].isdigit() else r"(?:\d+n?)?"
    return re.compile(rf"(?<![a-z0-9]){pattern}{number}(?![a-z0-9])", re.IGNORECASE)


_NAMES = {name: _words(name) for name in _CAMERAS}
_FREIBURG = re.compile(r"(?<![a-z0-9])fr(?:eiburg)?[123](?![a-z0-9])", re.IGNORECASE)


def matches(folder: Path) -> bool:
    """Whether the folder has this layout, possibly without one of its lists."""
    listed = [(folder / name).is_file() for name in (COLOR_LIST, DEPTH_LIST)]
    if not any(listed):
        return False
    images = all((folder / name).is_dir() for name in ("rgb", "depth"))
    is_damaged = images and (folder / GROUND_TRUTH).is_file() and not association_in(folder)
    return all(listed) or is_damaged


def has_lost_its_lists(folder: Path) -> bool:
    """Whether images in TUM's folders, with TUM's names, lack their lists.

    Others use these names too, with millimetres: TUM's other files decide, or its name.
    """
    depth = next(visible(folder / "depth", "*"), None)
    if depth is None or not (_STAMPED.fullmatch(depth.name) and (folder / "rgb").is_dir()):
        return False
    if lists_in(folder) or association_in(folder):
        return False
    others = any((folder / name).is_file() for name in (GROUND_TRUTH, ACCELEROMETER))
    return others or _data_set_of(folder.resolve().name) is not None


def open_tum(folder: Path, calibration: CameraIntrinsics | None = None) -> ImageSequence:
    """The sequence in ``folder``; a frame has the stamp of its colour image.

    Args:
        folder: of the data set.
        calibration: of the camera; None uses that of a file in the folder, or else that of the data
            set according to the name of the folder or of the source bag in ``rgb.txt``.

    Raises:
        InputError: a list names no image, no images pair up, or the camera is not known.
    """
    found = paired(folder / COLOR_LIST, folder / DEPTH_LIST)
    told = _camera(folder) if calibration is None else Calibration(calibration)
    sequence = ImageSequence(
        folder.resolve().name,
        found.pairs,
        depth_encoding.TUM,
        told.intrinsics,
        truth_of(folder, found.pairs),
        frame_id=_RECORDED_BY if _FREIBURG.search(folder.resolve().name) else "",
        imu=_accelerations(folder / ACCELEROMETER),
        left_out=found.left_out,
    )
    say_unit(sequence.name, told, depth_encoding.TUM_UNITS_PER_METRE)
    return sequence.with_calibration_depth_scale(
        told.depth_scale or scale_in_comments(folder / DEPTH_LIST)
    )


def _accelerations(path: Path) -> ImuSamples | None:
    """The samples of an accelerometer; None without one. Other lines are skipped."""
    if not path.is_file():
        return None
    lines = read_lines(path)[1]
    readings = [reading for reading in map(_reading, lines) if reading is not None]
    if len(readings) < len(lines):
        skipped = len(lines) - len(readings)
        lines_without = counted(skipped, "line holds", "lines hold")
        logger.warning("%s: %s no acceleration, skipped", path, lines_without)
    return imu_samples(readings).rotated(R_OPTICAL_ACCELEROMETER) if readings else None


def _reading(line: Line) -> ImuReading | None:
    try:
        (stamp,) = stamps_ns(line.words[:1])
        return ImuReading(stamp, np.full(3, np.nan), finite_numbers(list(line.words[1:4]), 3))
    except (ValueError, ArithmeticError):
        return None


def _camera(folder: Path) -> Calibration:
    """The camera from a file in the folder, its name, or the bag named in its list."""
    told = calibration_of(folder)
    if told is not None:
        return told
    own = folder.resolve().name
    for name in (own, *_bags_named(folder / COLOR_LIST)):
        data_set = _data_set_of(name)
        if data_set is not None:
            what = "the folder's name" if name == own else f"{COLOR_LIST} ({name})"
            logger.info(
                "%s: no file describes its camera; taking that of %s, which %s contains "
                "(--calibration gives another)",
                *(folder, data_set, what),
            )
            return Calibration(_CAMERAS[data_set])
    raise InputError(
        folder,
        f"no file there describes its camera, and its name contains none of {', '.join(_CAMERAS)}",
        "give the calibration (--calibration camera_info.yaml)",
    )


def _data_set_of(name: str) -> str | None:
    """The key in ``_CAMERAS`` of the data set that a name contains as words; None without one."""
    return next((key for key, words in _NAMES.items() if words.search(name)), None)


def _bags_named(path: Path) -> list[str]:
    """The comments of a list that name the bag it was made of."""
    comments, _ = read_lines(path)
    return [comment for comment in comments if comment.startswith("file:")]
