"""ICL-NUIM as its "TUM compatible PNGs" are packed: ``associations.txt`` and ``*.gt.freiburg``.

Similar to TUM's layout, but frames are numbered and not stamped, and the poses are those of a world
whose y axis points up, the mirror image of the one that the images show.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rgbd_glue_ros.files.reading import visible
from rgbd_glue_ros.recordings import depth_encoding
from rgbd_glue_ros.recordings.folder.lists import read_association
from rgbd_glue_ros.recordings.frame_times import frame_stamp_ns
from rgbd_glue_ros.recordings.image_sequence import ImageSequence
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import NANOSECONDS, CameraIntrinsics, Float64, Trajectory

ASSOCIATIONS, TRUTH = "associations.txt", "*.gt.freiburg"

CAMERA = CameraIntrinsics(640, 480, 481.2, 480.0, 319.5, 239.5)
"""With a positive fy: the published -480 belongs to the rows of other files, counted upward."""

_MIRROR = np.diag([1.0, -1.0, 1.0, 1.0])


def matches(folder: Path) -> bool:
    """Whether the folder has this layout."""
    return (folder / ASSOCIATIONS).is_file() and any(visible(folder, TRUTH))


def open_icl_nuim(folder: Path, calibration: CameraIntrinsics | None = None) -> ImageSequence:
    """The sequence in ``folder``; frame i is at (i + 1) / 30 s.

    Raises:
        InputError: a list cannot be read, or names nothing.
    """
    found = read_association(folder / ASSOCIATIONS)
    numbered = read_tum(min(visible(folder, TRUTH)))
    stamps = [frame_stamp_ns(round(number / NANOSECONDS)) for number in numbered.stamps_ns]
    truth = Trajectory(np.array(stamps, np.int64), mirrored(numbered.poses))
    return ImageSequence(
        folder.resolve().name,
        found.pairs,
        depth_encoding.TUM,
        calibration or CAMERA,
        truth,
        left_out=found.left_out,
    )


def mirrored(poses: Float64) -> Float64:
    """The poses [N, 4, 4] in the mirror image of their world, with y inverted."""
    result: Float64 = _MIRROR @ poses @ _MIRROR
    return result
