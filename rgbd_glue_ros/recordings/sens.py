"""ScanNet's sensor streams: a ``.sens`` file of version 4, read frame by frame."""

from __future__ import annotations

import os
import struct
import zlib
from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import open_file, refuse_stand_in
from rgbd_glue_ros.messages.image_codecs import check_size, decode
from rgbd_glue_ros.recordings.depth_encoding import DepthEncoding
from rgbd_glue_ros.recordings.faults import readable
from rgbd_glue_ros.recordings.frame_times import frame_stamp_ns
from rgbd_glue_ros.recordings.image_sequence import resized_to_camera, to_rgb
from rgbd_glue_ros.recordings.left_out import FrameGaps
from rgbd_glue_ros.recordings.prefetch import mapped_ahead
from rgbd_glue_ros.types import (
    CameraIntrinsics,
    Float32,
    Float64,
    RgbdFrame,
    Trajectory,
    UInt8,
)

SUFFIX = ".sens"
VERSION = 4

# After version and name: four 4x4 matrices (intrinsics and extrinsics of colour and depth), kinds
# of compression, sizes, units of depth to a metre, number of frames
_START = struct.Struct("<IQ")
_CALIBRATION = struct.Struct("<64f2i4IfQ")
_LONGEST_NAME = 1024
# Of a frame: T_world_camera, two stamps, sizes of the colour and depth data that follow
_FRAME = struct.Struct("<16f4Q")

_JPEG_OR_PNG = (1, 2)
_RAW, _ZLIB = 0, 1
# The maximum compression of zlib; the frames of a recording of hours
_MOST_DEFLATED, _MOST_FRAMES = 1100, 500_000


@dataclass(frozen=True)
class SensHeader:
    """The header of a file, for all its frames.

    Attributes:
        color_size: width and height of the colour images.
        camera: of the depth images.
        compression: kind of compression of the depth images.
        encoding: of the depth images.
        frame_count: declared number of frames.
        size: bytes of the header.
    """

    color_size: tuple[int, int]
    camera: CameraIntrinsics
    compression: int
    encoding: DepthEncoding
    frame_count: int
    size: int


@dataclass(frozen=True)
class _Place:
    """Where in the file a frame's images are, in bytes."""

    color: int
    color_size: int
    depth: int
    depth_size: int


class SensSequence(Closing):
    """The frames of a sensor stream; a truncated file gives the complete ones.

    Colour is reduced to the size of depth and has its camera: ScanNet publishes both images
    aligned. The stamps in these files are unreliable, and exported folders have none, so frame i
    is at (i + 1) / 30 s in both.

    Attributes:
        encoding: of the depth images: the file's, or another that is set before they are read.
    """

    def __init__(self, path: Path, calibration: CameraIntrinsics | None = None) -> None:
        """Opens the file and looks up where its frames are.

        Args:
            path: of the file.
            calibration: of the depth camera; None uses the file's.

        Raises:
            InputError: the file is not a sensor stream, has another version, or impossible values.
        """
        self.path = path
        with open_file(path) as file:
            self._file = os.dup(file.fileno())
        try:
            self._header = self._read_header()
            self._places, poses = self._read_index()
        except BaseException:
            self.close()
            raise
        self._camera = calibration or self._header.camera
        self.encoding = self._header.encoding
        known = np.isfinite(poses).all(axis=(1, 2))
        stamps = np.array([frame_stamp_ns(i) for i in range(len(poses))], np.int64)
        self.ground_truth: Trajectory | None = (
            Trajectory(stamps[known], poses[known]) if known.any() else None
        )

    @property
    def name(self) -> str:
        """The scan's name."""
        return self.path.stem

    @property
    def frame_count(self) -> int:
        """The number of frames, if the file is complete."""
        return min(self._header.frame_count, os.fstat(self._file).st_size // _FRAME.size)

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames in order of time; those that are damaged are skipped, counted and logged.

        Raises:
            InputError: at the end, if all are damaged, or the file is truncated.
        """
        complete = len(self._places)
        frames = mapped_ahead(self._try_frame, range(complete))
        yield from readable(self.name, frames, complete, FrameGaps())
        if complete < self._header.frame_count:
            raise self._truncated()

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these numbers, counted from 0, without reading any other.

        Raises:
            InputError: a frame is damaged, or beyond the end of a truncated file.
        """
        return mapped_ahead(self._frame, (i for i in indices if i < self._header.frame_count))

    def close(self) -> None:
        """Releases the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1

    def _bytes(self, position: int, size: int) -> bytes:
        # at an explicit position, so that threads can read in parallel
        return os.pread(self._file, size, position)

    def _read_header(self) -> SensHeader:
        refuse_stand_in(self._bytes(0, 256), self.path)
        start = self._bytes(0, _START.size)
        if len(start) < _START.size:
            raise self._unusable("is truncated in its header", "download it again")
        version, name_size = _START.unpack(start)
        if version != VERSION:
            raise self._unusable(
                f"is of version {version}, not {VERSION}", "give a sensor stream of ScanNet"
            )
        if name_size > _LONGEST_NAME:
            raise self._unusable(
                f"has a sensor name of {name_size} bytes", "give a sensor stream of ScanNet"
            )
        begin = _START.size + name_size
        data = self._bytes(begin, _CALIBRATION.size)
        if len(data) < _CALIBRATION.size:
            raise self._unusable("is truncated in its header", "download it again")
        *numbers, color, depth, cw, ch, dw, dh, units, frames = _CALIBRATION.unpack(data)
        check_size(cw, ch, f"{self.path}, colour")
        check_size(dw, dh, f"{self.path}, depth")
        if color not in _JPEG_OR_PNG or depth not in (_RAW, _ZLIB):
            raise self._unusable(
                f"holds images of types {color} and {depth}",
                "give colour as JPEG (2) or PNG (1) and depth as zlib (1) or raw (0)",
            )
        # the third matrix is the intrinsics of depth; extrinsics are not needed, since the images
        # are already aligned
        K = np.array(numbers[32:48], np.float64).reshape(4, 4)
        if not (np.isfinite(K).all() and K[0, 0] > 0 and K[1, 1] > 0 and units > 0):
            raise self._unusable("has no calibration of depth", "give it (--calibration)")
        return SensHeader(
            color_size=(cw, ch),
            camera=CameraIntrinsics(dw, dh, K[0, 0], K[1, 1], K[0, 2], K[1, 2]),
            compression=depth,
            encoding=DepthEncoding(units_per_metre=units),
            frame_count=frames,
            size=begin + _CALIBRATION.size,
        )

    def _read_index(self) -> tuple[list[_Place], Float64]:
        """Where the images of all complete frames are, and their poses T_world_camera [N, 4, 4]."""
        end = os.fstat(self._file).st_size
        places: list[_Place] = []
        poses = array("f")
        position = self._header.size
        camera = self._header.camera
        least = 2 * camera.width * camera.height // _MOST_DEFLATED
        while len(places) < self._header.frame_count:
            data = self._bytes(position, _FRAME.size)
            if len(data) < _FRAME.size:
                break
            *pose, _, _, color_size, depth_size = _FRAME.unpack(data)
            if color_size == 0 or depth_size < least:
                # a file of zeros has a frame without images in every hundred bytes
                break
            color = position + _FRAME.size
            depth = color + color_size
            position = depth + depth_size
            if position > end:
                break
            if len(places) == _MOST_FRAMES:
                raise self._unusable(f"holds more than {_MOST_FRAMES} frames", "cut it")
            places.append(_Place(color, color_size, depth, depth_size))
            poses.extend(pose)
        if not places:
            raise self._unusable("holds no complete frame", "download it again")
        return places, np.array(poses, np.float64).reshape(-1, 4, 4)

    def _try_frame(self, index: int) -> RgbdFrame | InputError:
        try:
            return self._frame(index)
        except InputError as error:
            return error

    def _frame(self, index: int) -> RgbdFrame:
        where = f"{self.path}, frame {index}"
        if index >= len(self._places):
            raise self._truncated()
        place = self._places[index]
        color = self._color(self._bytes(place.color, place.color_size), where)
        depth = self._depth(self._bytes(place.depth, place.depth_size), where)
        return RgbdFrame(frame_stamp_ns(index), color, depth, self._camera)

    def _color(self, data: bytes, where: str) -> UInt8:
        image: NDArray[Any] = decode(data, where)
        height, width = image.shape[:2]
        if (width, height) != self._header.color_size:
            raise InputError(
                where, f"its colour is {width}x{height}, unlike the header's", "download it again"
            )
        return resized_to_camera(to_rgb(image, where), self._header.camera)

    def _depth(self, data: bytes, where: str) -> Float32:
        camera = self._header.camera
        size = 2 * camera.width * camera.height
        if self._header.compression == _ZLIB:
            data = _inflated(data, size)
        if len(data) != size:
            raise InputError(
                where,
                f"damaged depth image: not {camera.width}x{camera.height} pixels of 16 bits",
                "download the file again",
            )
        image = np.frombuffer(data, "<u2").reshape(camera.height, camera.width)
        return self.encoding.metres(image)

    def _truncated(self) -> InputError:
        return self._unusable(
            f"is truncated after {len(self._places)} of {self._header.frame_count} frames",
            "download it again",
        )

    def _unusable(self, cause: str, remedy: str) -> InputError:
        return InputError(self.path, cause, remedy)


def is_sens(path: Path) -> bool:
    """Whether ``path`` has the name of a sensor stream."""
    return path.suffix == SUFFIX and path.is_file()


def _inflated(data: bytes, size: int) -> bytes:
    """The uncompressed ``data``, but at most one byte more than ``size``; b"" if damaged."""
    try:
        return zlib.decompressobj().decompress(data, size + 1)
    except zlib.error:
        return b""
