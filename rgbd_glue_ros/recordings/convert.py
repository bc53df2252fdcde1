"""Converts recordings: a bag becomes a TUM RGB-D folder, all others a bag."""

from __future__ import annotations

import heapq
import logging
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from functools import partial
from itertools import chain
from operator import itemgetter
from pathlib import Path

import numpy as np
from tqdm import tqdm

from rgbd_glue_ros.closing import uninterrupted
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.writing import NewFolder, not_written
from rgbd_glue_ros.messages.fields import DEPTH_UNITS_PER_METRE
from rgbd_glue_ros.recordings import Recording, imu_of
from rgbd_glue_ros.recordings.bag.recording import BagRecording
from rgbd_glue_ros.recordings.bag.writer import (
    AS_REALSENSE,
    COMPRESSED,
    RAW,
    BagWriter,
    WrittenTopics,
)
from rgbd_glue_ros.recordings.depth_encoding import TUM_UNITS_PER_METRE
from rgbd_glue_ros.recordings.prefetch import mapped_ahead
from rgbd_glue_ros.recordings.tum import DEPTH_LIST
from rgbd_glue_ros.recordings.tum_writer import TumFolderWriter
from rgbd_glue_ros.recordings.wrapped import unwrapped
from rgbd_glue_ros.types import ImuSamples, RgbdFrame, Trajectory

# When, and how
_Write = tuple[int, Callable[[], None]]

logger = logging.getLogger(__name__)

# Progress is shown to those who wait longer than this.
_PROGRESS_AFTER_S = 2.0

# With a larger share of the known depth of a frame beyond TUM's unit, another one is used
_MOST_TOO_FAR = 0.01


def convert(
    source: Recording, target: Path, compressed: bool, topics: WrittenTopics = AS_REALSENSE
) -> None:
    """Writes a recording in another format, with its camera, true poses and IMU.

    A folder holds the accelerations of an IMU alone; that angular velocities are lost is logged.

    The target appears once it is written. However that ends, the frames written are there and
    readable.

    Args:
        source: a bag, for a TUM RGB-D folder; or any other, for a rosbag2.
        target: a folder that does not exist.
        compressed: whether images in a bag are JPEG and compressedDepth; raw ones are lossless. In
            a folder, images are always PNG.
        topics: names of the topics of a bag.

    Raises:
        InputError: the target exists or cannot be written, or a frame cannot be read; the frames
            before it were written.
    """
    new = NewFolder(target)
    try:
        _convert(source, new.path, compressed, topics)
    except OSError as error:
        problem = not_written(target, error)
        if not new.path.exists():
            raise problem from error
        remedy = f"{problem.remedy}; it holds what was written before: remove it first"
        raise InputError(problem.where, problem.cause, remedy) from error
    except KeyboardInterrupt:
        what = f"the frames written so far are in {target}" if new.path.exists() else "no frame yet"
        logger.warning("interrupted; %s", what)
        raise
    finally:
        new.close()


def _convert(source: Recording, target: Path, compressed: bool, topics: WrittenTopics) -> None:
    frames = iter(source)
    first = next(frames, None)
    if first is None:
        raise InputError(source.name, "holds no frames", "give a recording with RGB-D frames")
    progress = _shown(chain([first], frames), source)
    if is_bag(source):
        if not _wrote_folder(source, target, first, progress, TUM_UNITS_PER_METRE):
            progress.close()
            shutil.rmtree(target)
            _wrote_folder(source, target, first, _shown(source, source), DEPTH_UNITS_PER_METRE)
    else:
        with BagWriter(target, COMPRESSED if compressed else RAW, topics) as bag:
            write_bag(progress, source.ground_truth, bag, imu_of(source), first.frame_id)


def _shown(frames: Iterable[RgbdFrame], source: Recording) -> tqdm[RgbdFrame]:
    """The frames of a recording with a bar of progress."""
    return tqdm(
        frames, total=source.frame_count, unit=" frames", delay=_PROGRESS_AFTER_S, disable=None
    )


def _wrote_folder(
    source: Recording, target: Path, first: RgbdFrame, frames: Iterable[RgbdFrame], units: int
) -> bool:
    """Writes a folder with depth in units of a metre; False where depth goes beyond TUM's unit.

    That unit, which others take for granted, is kept where few pixels are beyond it.
    """
    imu = imu_of(source)
    with (
        TumFolderWriter(target, first.intrinsics, source.ground_truth, imu, units) as folder,
        closing(mapped_ahead(folder.encode, frames)) as encoded,
    ):
        for files in encoded:
            is_far = files.too_far > _MOST_TOO_FAR * files.known
            if is_far and units == TUM_UNITS_PER_METRE:
                logger.warning(
                    "%s: depth goes beyond %.1f m, where TUM's unit of 1/%d m ends, so it is "
                    "written in units of 1/%d m, as %s says in a comment: tell programs that "
                    "assume TUM's",
                    *(target.name, folder.farthest_m, units, DEPTH_UNITS_PER_METRE, DEPTH_LIST),
                )
                return False
            folder.write(files)
        folder.say_what_is_lost()
    return True


def is_bag(recording: Recording) -> bool:
    """Whether the frames come from a bag, whatever they went through since."""
    return isinstance(unwrapped(recording), BagRecording)


def write_bag(
    frames: Iterable[RgbdFrame],
    truth: Trajectory | None,
    bag: BagWriter,
    imu: ImuSamples | None = None,
    imu_frame: str = "",
) -> None:
    """Writes frames, poses and samples of an IMU, merged in order of time.

    Args:
        frames: of the recording.
        truth: T_world_camera of the optical frame, None if not known.
        bag: to write to.
        imu: the samples in the axes of the camera's optical frame, None if there are none.
        imu_frame: name of that frame; "" if not known.
    """
    streams: list[Iterable[_Write]] = [
        ((f.stamp_ns, partial(bag.write, f)) for f in mapped_ahead(bag.encode, frames))
    ]
    if truth is not None:
        streams.append(_poses(truth, bag))
    if imu is not None:
        streams.append(_samples(imu, imu_frame, bag))
    for _, write in heapq.merge(*streams, key=itemgetter(0)):
        with uninterrupted():  # a bag holds no half of a message
            write()


def _poses(truth: Trajectory, bag: BagWriter) -> Iterator[_Write]:
    for row in np.argsort(truth.stamps_ns, kind="stable"):
        stamp_ns = int(truth.stamps_ns[row])
        yield stamp_ns, partial(bag.write_pose, stamp_ns, truth.poses[row])


def _samples(imu: ImuSamples, frame_id: str, bag: BagWriter) -> Iterator[_Write]:
    for index, stamp_ns in enumerate(imu.stamps_ns.tolist()):
        yield stamp_ns, partial(bag.write_imu, imu, index, frame_id)
