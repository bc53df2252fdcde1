"""Stray Scanner's recordings of iPhones: ``rgb.mp4`` beside ``depth/000000.png``, and odometry.

Frame i of the video belongs to the depth image of number i. Colour is larger than depth, of the
same view, and is reduced to its size.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import open_file, refuse_stand_in, visible
from rgbd_glue_ros.messages.camera_info import of_image_size
from rgbd_glue_ros.recordings.depth_encoding import MILLIMETRES
from rgbd_glue_ros.recordings.faults import readable
from rgbd_glue_ros.recordings.folder.calibration import calibration_of
from rgbd_glue_ros.recordings.frame_times import frame_stamp_ns
from rgbd_glue_ros.recordings.image_sequence import (
    ImagePair,
    ImageSequence,
    read_image,
    to_rgb,
)
from rgbd_glue_ros.recordings.left_out import FrameGaps, warn_of_left_out
from rgbd_glue_ros.recordings.recording import selected
from rgbd_glue_ros.recordings.wrapped import WrappedRecording
from rgbd_glue_ros.trajectories.tum import read_tum
from rgbd_glue_ros.types import CameraIntrinsics, RgbdFrame, Trajectory, UInt8

logger = logging.getLogger(__name__)

VIDEOS = ("rgb.mp4", "rgb.mov", "color.mp4", "video.mp4")
ODOMETRY = "odometry.csv"

_MP4 = b"ftyp"


def matches(folder: Path) -> bool:
    """Whether there is a video beside numbered depth images, and no colour images."""
    return _video(folder) is not None and bool(_depth_images(folder))


def open_images(folder: Path, calibration: CameraIntrinsics | None = None) -> ImageSequence:
    """The depth images and other files in ``folder``; the colour of every pair is the video.

    Args:
        folder: of the recording.
        calibration: of the colour camera; None uses that of a file in the folder.

    Raises:
        InputError: the camera is not known, or does not fit the images.
    """
    video, depth = _video(folder), _depth_images(folder)
    if video is None or not depth:
        raise InputError(folder, "has no video beside depth images", "give another folder")
    if calibration is None:
        told = calibration_of(folder)
        if told is None:
            raise InputError(
                folder, "no file there describes its camera", "give the calibration (--calibration)"
            )
        calibration = told.intrinsics
    truth = _odometry(folder)
    stamps = [frame_stamp_ns(number) for number in depth]
    if truth is not None and len(truth.stamps_ns) > max(depth):
        stamps = [int(truth.stamps_ns[number]) for number in depth]
    pairs = tuple(
        ImagePair(stamp, video, stamp, path)
        for stamp, path in zip(stamps, depth.values(), strict=True)
    )
    color = next(_frames(video)).shape[:2]
    camera = of_image_size(calibration, color, f"the calibration of {folder}", str(video))
    shape = read_image(pairs[0].depth).shape[:2]
    camera = of_image_size(camera, (shape[0], shape[1]), str(video), str(pairs[0].depth))
    return ImageSequence(
        folder.resolve().name, pairs, MILLIMETRES, camera, truth, (color[1], color[0])
    )


@dataclass(frozen=True)
class VideoSequence(WrappedRecording):
    """A ``Recording`` whose colour images are the frames of a video.

    Attributes:
        recording: of depth images; the colour of every pair is the video.
    """

    recording: ImageSequence

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames in order of time; those that cannot be read are skipped, counted and logged.

        Raises:
            InputError: the video cannot be read, or no depth image can.
        """
        gaps, length = FrameGaps(), 0
        video = self.recording.pairs[0].color
        pairs = {_number(pair.depth): pair for pair in self.recording.pairs}

        def tried() -> Iterator[RgbdFrame | InputError]:
            nonlocal length
            for number, color in enumerate(_frames(video)):
                length = number + 1
                if number in pairs:
                    try:
                        yield self.recording.frame(pairs[number], color)
                    except InputError as error:
                        yield error

        yield from readable(self.name, tried(), len(pairs), gaps)
        if gaps.is_empty:
            raise InputError(video, "has no frame for any depth image", "record again")
        warn_of_left_out(self.name, self.left_out, gaps)
        without = sum(number >= length for number in pairs)
        if without:
            logger.warning(
                "%s: has %d frames, so %d of %d depth images have none",
                *(video, length, without, len(pairs)),
            )

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these increasing numbers; all before the last of them are read too."""
        return selected(self, indices)


def _video(folder: Path) -> Path | None:
    return next((folder / name for name in VIDEOS if (folder / name).is_file()), None)


def _depth_images(folder: Path) -> dict[int, Path]:
    """The depth images in the folder, in the order of their numbers."""
    numbered = {_number(path): path for path in visible(folder / "depth", "*.png")}
    return {number: numbered[number] for number in sorted(n for n in numbered if n >= 0)}


def _number(path: Path) -> int:
    """The number in a file's name; -1 without one."""
    return int(path.stem) if re.fullmatch(r"\d+", path.stem) else -1


def _odometry(folder: Path) -> Trajectory | None:
    """The phone's own poses; None, which is logged, if they cannot be read."""
    if not (folder / ODOMETRY).is_file():
        return None
    try:
        return read_tum(folder / ODOMETRY)
    except InputError as error:
        logger.warning("%s; continuing without ground truth", error)
        return None


def _frames(video: Path) -> Iterator[UInt8]:
    """The frames of a video as RGB, as the sensor sees them.

    Raises:
        InputError: OpenCV cannot decode it.
    """
    with open_file(video) as file:
        head = file.read(256)
    refuse_stand_in(head, video)
    # otherwise OpenCV would accept a list of videos, and fetch what it names
    if head[4:8] != _MP4:
        raise InputError(video, "is not an MP4 video", "restore the file")
    capture = cv2.VideoCapture(str(video))
    # phones record how they were held, which depth does not follow
    capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
    try:
        is_read, image = capture.read()
        if not is_read:
            raise InputError(
                video,
                "cannot be decoded by the installed OpenCV",
                "extract its frames: ffmpeg -noautorotate -i rgb.mp4 -start_number 0 rgb/%06d.png",
            )
        while is_read:
            yield to_rgb(np.asarray(image), str(video))
            is_read, image = capture.read()
    finally:
        capture.release()
