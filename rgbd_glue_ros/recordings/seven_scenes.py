"""7-Scenes, 3DMatch and BundleFusion: a folder of ``frame-%06d.{color,depth,pose}.*``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.recordings.calibration import (
    OF_DEPTH,
    Calibration,
    calibration_among,
    say_unit,
)
from rgbd_glue_ros.recordings.depth_encoding import MILLIMETRES
from rgbd_glue_ros.recordings.frame_times import frame_stamp_ns
from rgbd_glue_ros.recordings.image_sequence import (
    ImagePair,
    ImagePairs,
    ImageSequence,
    camera_of_matrix,
    first_readable,
    ground_truth,
    matrix,
)
from rgbd_glue_ros.recordings.left_out import COLOR, DEPTH
from rgbd_glue_ros.types import CameraIntrinsics

_INTRINSICS = "camera-intrinsics.txt"
_INFOS = ("info.txt", "_info.txt")
"""Of BundleFusion, and of ScanNet's reader, which exports its layout: the images are aligned."""
_WIDTH, _HEIGHT = 640, 480
# 7-Scenes comes without a file of intrinsics; its page gives these for every scene
_SCENES = ("chess", "fire", "heads", "office", "pumpkin", "redkitchen", "stairs")
_SEVEN_SCENES = CameraIntrinsics(_WIDTH, _HEIGHT, 585.0, 585.0, 320.0, 240.0)


def matches(folder: Path) -> bool:
    """Whether the folder has this layout."""
    return any(folder.glob("frame-*.color.*"))


def open_seven_scenes(folder: Path, calibration: CameraIntrinsics | None = None) -> ImageSequence:
    """The sequence in ``folder``; the data has no stamps, so frame i is at (i + 1) / 30 s.

    Args:
        folder: of the frames.
        calibration: of the camera; None reads ``camera-intrinsics.txt`` there or one level up, or
            BundleFusion's ``info.txt``, or uses 7-Scenes' own below a folder named after one of its
            scenes.

    Raises:
        InputError: no frame has depth, a pose is malformed, or the camera is not known. A frame
            without depth is left out; one whose pose is missing or not finite has no ground truth.
    """
    pairs: list[ImagePair] = []
    poses: list[tuple[int, Path]] = []
    colors = sorted(folder.glob("frame-*.color.*"))
    depths = {path.name.split(".")[0]: path for path in folder.glob("frame-*.depth.*")}
    for color in colors:
        stem = color.name.split(".")[0]
        stamp = _stamp(color, stem)
        depth, pose = depths.get(stem), folder / f"{stem}.pose.txt"
        if depth is not None:
            pairs.append(ImagePair(stamp, color, stamp, depth))
            poses.append((stamp, pose))
    if not pairs:
        raise InputError(
            folder, "has no colour image with depth beside it", "restore frame-000000.depth.png…"
        )
    images = {COLOR: len(colors), DEPTH: len(depths)}
    found = ImagePairs.of(pairs, images, 0)
    told = _told(folder) if calibration is None else Calibration(calibration)
    sequence = ImageSequence(
        *(_name(folder.resolve()), found.pairs, MILLIMETRES, told.intrinsics, ground_truth(poses)),
        color_size=None if told.depth_scale is None else _color_size(found.pairs),
        left_out=found.left_out,
    )
    say_unit(sequence.name, told, MILLIMETRES.units_per_metre)
    return sequence.with_calibration_depth_scale(told.depth_scale)


def _color_size(pairs: Iterable[ImagePair]) -> tuple[int, int]:
    _, color, _ = first_readable(pairs)
    return color.shape[1], color.shape[0]


def _name(folder: Path) -> str:
    """The folder's name, preceded by the scene's if it is not unique."""
    return f"{folder.parent.name}/{folder.name}" if folder.name.startswith("seq-") else folder.name


def _stamp(path: Path, stem: str) -> int:
    try:
        number = int(stem.removeprefix("frame-"))
    except ValueError as error:
        raise InputError(path, "has no number in its name", "name it frame-000000…") from error
    return frame_stamp_ns(number)


def _told(folder: Path) -> Calibration:
    """The camera of the depth images; BundleFusion tells the unit of depth too."""
    folder = folder.resolve()
    for path in (folder / _INTRINSICS, folder.parent / _INTRINSICS):
        if path.is_file():
            return Calibration(camera_of_matrix(path, matrix(path, 3), _WIDTH, _HEIGHT))
    if folder.parent.name in _SCENES:
        return Calibration(_SEVEN_SCENES)
    for path in (folder / name for name in _INFOS):
        if path.is_file():
            return calibration_among(path, OF_DEPTH)
    raise InputError(
        folder,
        f"has no {_INTRINSICS}, nor has the folder above, and no {_INFOS[0]} of BundleFusion",
        "give the calibration (--calibration camera_info.yaml)",
    )
