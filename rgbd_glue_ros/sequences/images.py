"""A sequence whose frames are image files, decoded ahead of their use."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.image_files import decode
from rgbd_glue_ros.sequences.ahead import mapped_ahead
from rgbd_glue_ros.types import CameraIntrinsics, Float32, RgbdFrame, Trajectory, UInt8

_TO_RGB = {1: None, 3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGB}
"""How an image of so many channels becomes RGB; grey stays grey."""


@dataclass(frozen=True)
class DepthEncoding:
    """How a 16-bit depth image says metres.

    Attributes:
        units_per_metre: a metre in units of the image.
        invalid: values that mean unknown.
    """

    units_per_metre: float
    invalid: tuple[int, ...]

    def metres(self, image: NDArray[np.uint16]) -> Float32:
        """float32 [H, W] metres with NaN for unknown, from uint16 [H, W]."""
        depth: Float32 = np.divide(image, np.float32(self.units_per_metre), dtype=np.float32)
        for value in self.invalid:
            depth[image == value] = np.nan
        return depth


@dataclass(frozen=True)
class ImagePair:
    """The files of one frame, and when each was taken."""

    stamp_ns: int
    color: Path
    depth_stamp_ns: int
    depth: Path


@dataclass(frozen=True)
class ImageSequence:
    """A ``Sequence`` of image files.

    Attributes:
        name: the data set's name.
        pairs: the files of every frame, in order of time.
        encoding: of the depth images.
        intrinsics: of all images.
        ground_truth: T_world_camera, None if not known.
    """

    name: str
    pairs: tuple[ImagePair, ...]
    encoding: DepthEncoding
    intrinsics: CameraIntrinsics
    ground_truth: Trajectory | None

    @property
    def frame_count(self) -> int:
        """How many frames it holds."""
        return len(self.pairs)

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames in order of time.

        Raises:
            InputError: an image is missing, corrupt, or not of the camera's size.
        """
        return mapped_ahead(self._read, self.pairs)

    def _read(self, pair: ImagePair) -> RgbdFrame:
        return RgbdFrame(
            pair.stamp_ns,
            self._color(pair.color),
            self._depth(pair.depth),
            self.intrinsics,
            depth_delay_ns=pair.depth_stamp_ns - pair.stamp_ns,
        )

    def _color(self, path: Path) -> UInt8:
        image = self._decoded(path)
        channels = 1 if image.ndim == 2 else image.shape[2]
        if image.dtype != np.uint8 or channels not in _TO_RGB:
            raise InputError(
                path,
                f"is {image.dtype} with {channels} channels, not a colour image",
                "give colour as 8-bit PNG or JPEG",
            )
        conversion = _TO_RGB[channels]
        return image if conversion is None else np.asarray(cv2.cvtColor(image, conversion))

    def _depth(self, path: Path) -> Float32:
        image = self._decoded(path)
        if image.dtype != np.uint16 or image.ndim != 2:
            raise InputError(
                path,
                f"is {image.dtype} of shape {image.shape}, not a depth image",
                "give depth as 16-bit grey PNG",
            )
        return self.encoding.metres(image)

    def _decoded(self, path: Path) -> NDArray[Any]:
        try:
            data = path.read_bytes()
        except OSError as error:
            raise InputError(
                path, f"cannot be read ({error.strerror})", "restore the file"
            ) from error
        image = decode(data, str(path))
        height, width = image.shape[:2]
        camera = self.intrinsics
        if (width, height) != (camera.width, camera.height):
            raise InputError(
                path,
                f"is {width}x{height}, but the camera is {camera.width}x{camera.height}",
                "give the calibration of these images (--calibration)",
            )
        return image

    def close(self) -> None:
        """Holds nothing open."""

    def __enter__(self) -> ImageSequence:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
