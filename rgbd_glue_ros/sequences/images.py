"""A sequence whose frames are image files, decoded ahead of their use."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.types import CameraIntrinsics, Float32, RgbdFrame, Trajectory, UInt8

Image = NDArray[Any]

_THREADS = 2
_FRAMES_AHEAD = 4


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
        depth: Float32 = image.astype(np.float32) * np.float32(1.0 / self.units_per_metre)
        for value in self.invalid:
            depth[image == value] = np.nan
        return depth


@dataclass(frozen=True)
class ImagePair:
    """The files of one frame."""

    stamp_ns: int
    color: Path
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
        """The frames in order of time, a few decoded ahead by threads.

        Raises:
            InputError: an image is missing, corrupt, or not of the camera's size.
        """
        with ThreadPoolExecutor(_THREADS) as pool:
            ahead: deque[Future[RgbdFrame]] = deque()
            try:
                for pair in self.pairs:
                    ahead.append(pool.submit(self._read, pair))
                    if len(ahead) > _FRAMES_AHEAD:
                        yield ahead.popleft().result()
                while ahead:
                    yield ahead.popleft().result()
            finally:
                for future in ahead:
                    future.cancel()

    def _read(self, pair: ImagePair) -> RgbdFrame:
        return RgbdFrame(
            pair.stamp_ns,
            self._color(pair.color),
            self._depth(pair.depth),
            self.intrinsics,
        )

    def _color(self, path: Path) -> UInt8:
        image = _decoded(path, cv2.IMREAD_COLOR)
        self._check_size(path, image)
        cv2.cvtColor(image, cv2.COLOR_BGR2RGB, dst=image)
        return np.asarray(image, np.uint8)

    def _depth(self, path: Path) -> Float32:
        image = _decoded(path, cv2.IMREAD_UNCHANGED)
        if image.dtype != np.uint16 or image.ndim != 2:
            raise InputError(
                path,
                f"is {image.dtype} of shape {image.shape}, not a 16-bit depth image",
                "give depth as 16-bit grey PNG",
            )
        self._check_size(path, image)
        return self.encoding.metres(image)

    def _check_size(self, path: Path, image: Image) -> None:
        size = image.shape[1], image.shape[0]
        if size != (self.intrinsics.width, self.intrinsics.height):
            raise InputError(
                path,
                f"is {size[0]}x{size[1]}, but the camera is "
                f"{self.intrinsics.width}x{self.intrinsics.height}",
                "give the calibration of these images (--calibration)",
            )

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


def _decoded(path: Path, flags: int) -> Image:
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise InputError(path, f"cannot be read ({error.strerror})", "restore the file") from error
    image = cv2.imdecode(data, flags) if len(data) else None
    if image is None:
        raise InputError(path, "is no image, or a damaged one", "restore the file")
    return np.asarray(image)
