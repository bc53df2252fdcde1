"""Ground truth in the folder of a recording: stamped, one per line, or a file for each frame."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import visible
from rgbd_glue_ros.files.text_lines import Line, read_lines
from rgbd_glue_ros.recordings.folder.names import frames_of
from rgbd_glue_ros.recordings.image_sequence import ImagePair
from rgbd_glue_ros.trajectories.pose_text import MATRIX_SHAPES, parse_matrix
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import Float64, Int64, Trajectory

logger = logging.getLogger(__name__)

NAMES = (
    "groundtruth.txt",
    "ground_truth.txt",
    "gt.txt",
    "groundtruth.csv",
    "gt.csv",
    "traj.txt",
    "trajectory.txt",
    "trajectory.log",
    "poses.txt",
    "pose.txt",
    "odometry.csv",
    "mav0/state_groundtruth_estimate0/data.csv",
    "state_groundtruth_estimate0/data.csv",
)
FOLDERS = ("pose", "poses", "camera_pose")
_EXTRINSICS = "extrinsics"  # SUN3D: a file of all poses; the newest is the best


def truth_of(folder: Path, frames: Sequence[ImagePair]) -> Trajectory | None:
    """The poses T_world_camera in a folder; None if it has none.

    An unusable file is logged, and leaves the recording without ground truth.

    Args:
        folder: of the recording.
        frames: of the recording, in order of time; poses without stamps belong to these in turn.
    """
    found = [folder / name for name in NAMES if (folder / name).is_file()]
    found += sorted(visible(folder / _EXTRINSICS, "*.txt"), reverse=True)[:1]
    try:
        if found:
            return _of_file(found[0], frames)
        for name in FOLDERS:
            if (folder / name).is_dir():
                return _of_files(folder / name, frames)
    except InputError as error:
        logger.warning("%s; continuing without ground truth", error)
    return None


def _of_file(path: Path, frames: Sequence[ImagePair]) -> Trajectory:
    _, lines = read_lines(path)
    poses = _matrices(lines)
    if poses is None:
        return read_tum(path)
    if len(poses) == len(frames):
        return Trajectory(_stamps(frames), np.stack(poses))
    # missing images show in the numbers of the others
    numbers = frames_of([pair.color for pair in frames])
    if None in numbers or max(filter(None, numbers), default=0) >= len(poses):
        raise InputError(
            path,
            f"holds {len(poses)} poses without stamps, but there are {len(frames)} frames",
            "give a trajectory with stamps (--ground-truth FILE)",
        )
    return Trajectory(_stamps(frames), np.stack([poses[n] for n in numbers if n is not None]))


def _matrices(lines: list[Line]) -> list[Float64] | None:
    """The poses of matrices on one line each, or one row per line with frame numbers between."""
    widths = {len(line.words) for line in lines}
    try:
        if widths in ({12}, {16}):
            return [parse_matrix(line.words) for line in lines]
        if widths in ({4}, {3, 4}):
            words = [word for line in lines if len(line.words) == 4 for word in line.words]
            # rows of four matrices [3, 4] are those of three [4, 4], but for what they hold
            size = next(n for n in (16, 12) if _are_matrices(words, n))
            return [parse_matrix(words[i : i + size]) for i in range(0, len(words), size)]
    except (ValueError, StopIteration):
        return None
    return None


def _are_matrices(words: list[str], size: int) -> bool:
    if len(words) % size:
        return False
    last = [float(word) for word in words[size - 4 : size]]
    return last == [0, 0, 0, 1] if size == 16 else size in MATRIX_SHAPES


def _of_files(folder: Path, frames: Sequence[ImagePair]) -> Trajectory | None:
    files = list(visible(folder, "*.txt"))
    by_frame = dict(zip(frames_of(files), files, strict=True))
    stamps, poses = [], []
    for pair, frame in zip(frames, frames_of([pair.color for pair in frames]), strict=True):
        path = None if frame is None else by_frame.get(frame)
        pose = None if path is None else _of_frame(path)
        if pose is not None:
            stamps.append(pair.stamp_ns)
            poses.append(pose)
    if not poses:
        raise InputError(folder, "holds no pose of any frame", "name its files like the images")
    if len(poses) < len(frames):
        logger.warning(
            "%s: %d of %d frames have no pose", folder, len(frames) - len(poses), len(frames)
        )
    return Trajectory(np.array(stamps, np.int64), np.stack(poses))


def _of_frame(path: Path) -> Float64 | None:
    """The matrix in a file; None if tracking was lost, which some write without numbers."""
    _, lines = read_lines(path)
    try:
        return parse_matrix([word for line in lines for word in line.words])
    except ValueError:
        return None


def _stamps(frames: Sequence[ImagePair]) -> Int64:
    return np.array([pair.stamp_ns for pair in frames], np.int64)
