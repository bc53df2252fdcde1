"""ScanNet as written by its exporter: ``color/0.jpg``, ``depth/0.png``, ``pose/0.txt``."""

from __future__ import annotations

from pathlib import Path

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import visible
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
from rgbd_glue_ros.recordings.sens import SUFFIX, SensSequence, is_sens
from rgbd_glue_ros.types import CameraIntrinsics

_INTRINSICS = Path("intrinsic/intrinsic_depth.txt")
_COLOR_TYPES = (".jpg", ".png")


def matches(path: Path) -> bool:
    """Whether ``path`` is a sensor stream, or a folder with one or with its images."""
    return is_sens(path) or _is_exported(path) or len(_streams(path)) == 1


def open_scannet(
    path: Path, calibration: CameraIntrinsics | None = None
) -> ImageSequence | SensSequence:
    """The scan at ``path``.

    Args:
        path: a sensor stream, the folder of a scan with one, or one of exported images.
        calibration: of the depth camera; None uses the scan's.

    Raises:
        InputError: the scan is unusable.
    """
    if is_sens(path):
        return SensSequence(path, calibration)
    if _is_exported(path):
        return _open_exported(path, calibration)
    return SensSequence(_streams(path)[0], calibration)


def _streams(folder: Path) -> list[Path]:
    return [path for path in visible(folder, f"*{SUFFIX}") if is_sens(path)]


def _is_exported(folder: Path) -> bool:
    return all((folder / part).is_dir() for part in ("color", "depth", "pose"))


def _open_exported(folder: Path, calibration: CameraIntrinsics | None) -> ImageSequence:
    """Frame i of a scan is in files named i; those without depth are left out.

    Those without a finite pose have no ground truth.
    """
    files = [p for p in visible(folder / "color") if p.suffix in _COLOR_TYPES]
    pairs: list[ImagePair] = []
    poses: list[tuple[int, Path]] = []
    for number, color in sorted((_number(path), path) for path in files):
        stamp = frame_stamp_ns(number)
        depth, pose = folder / f"depth/{number}.png", folder / f"pose/{number}.txt"
        if depth.is_file():
            pairs.append(ImagePair(stamp, color, stamp, depth))
            poses.append((stamp, pose))
    if not pairs:
        raise InputError(
            folder, "has no colour image with depth of its number", "export the scan again"
        )
    images = {COLOR: len(files), DEPTH: len(list(visible(folder / "depth", "*.png")))}
    found = ImagePairs.of(pairs, images, 0)
    _, color_image, depth_image = first_readable(found.pairs)
    return ImageSequence(
        folder.resolve().name,
        found.pairs,
        MILLIMETRES,
        calibration or _camera(folder, *depth_image.shape[1::-1]),
        ground_truth(poses),
        color_image.shape[1::-1],
        left_out=found.left_out,
    )


def _number(path: Path) -> int:
    try:
        return int(path.stem)
    except ValueError as error:
        raise InputError(
            path, "has a name that is not a number", "name it 0.jpg, 1.jpg…"
        ) from error


def _camera(folder: Path, width: int, height: int) -> CameraIntrinsics:
    path = folder / _INTRINSICS
    return camera_of_matrix(path, matrix(path, 4), width, height)
