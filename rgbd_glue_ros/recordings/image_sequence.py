"""A sequence whose frames are image files, decoded ahead of their use."""

from __future__ import annotations

import logging
import math
import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.closing import Closing
from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.files.reading import MAX_IMAGE, read_bytes, read_text, refuse_stand_in
from rgbd_glue_ros.geometry.depth_registration import DepthCamera
from rgbd_glue_ros.messages.camera_info import of_image_size, pinhole
from rgbd_glue_ros.messages.frame import FrameTopics, registered_images
from rgbd_glue_ros.messages.image_codecs import decode
from rgbd_glue_ros.messages.images import in_8_bits
from rgbd_glue_ros.messages.used_bits import FEWEST_BITS, bits_of
from rgbd_glue_ros.recordings.depth_encoding import DepthEncoding
from rgbd_glue_ros.recordings.faults import readable
from rgbd_glue_ros.recordings.left_out import FrameGaps, LeftOut, warn_of_left_out
from rgbd_glue_ros.recordings.prefetch import mapped_ahead
from rgbd_glue_ros.types import (
    CameraIntrinsics,
    Float32,
    Float64,
    ImuSamples,
    RgbdFrame,
    Trajectory,
    UInt8,
)

logger = logging.getLogger(__name__)

IMAGE_TYPES = frozenset(
    {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".npy", ".exr", ".pgm", ".ppm"}
)
"""Suffixes of image files, in lower case."""

_NPY_HEADERS = {
    (1, 0): np.lib.format.read_array_header_1_0,
    (2, 0): np.lib.format.read_array_header_2_0,
}

# NumPy reads headers by ast.literal_eval, which in Python 3.11 fails at random where threads use it
# at the same time: "AST constructor recursion depth mismatch".
_ONE_HEADER = threading.Lock()

_TO_RGB = {1: None, 3: cv2.COLOR_BGR2RGB, 4: cv2.COLOR_BGRA2RGB}
"""Conversion to RGB by number of channels; grey stays grey."""


# As many images at most show how many of 16 bits are used.
_LOOKED_AT = 16


@dataclass(frozen=True)
class ImagePair:
    """The files of one frame, and when each was taken."""

    stamp_ns: int
    color: Path
    depth_stamp_ns: int
    depth: Path


@dataclass(frozen=True)
class ImagePairs:
    """The frames of two kinds of images.

    Attributes:
        pairs: the files of every frame, in order of time.
        left_out: images that are in none.
    """

    pairs: tuple[ImagePair, ...]
    left_out: LeftOut

    @staticmethod
    def of(pairs: Sequence[ImagePair], images: Mapping[str, int], duplicates: int) -> ImagePairs:
        """The frames out of so many images of ``COLOR`` and ``DEPTH``, beside duplicates."""
        unpaired = {kind: count - len(pairs) for kind, count in images.items()}
        return ImagePairs(tuple(pairs), LeftOut(images, unpaired, duplicates))


@dataclass(frozen=True)
class ImageSequence(Closing):
    """A ``Recording`` of image files.

    Attributes:
        name: the data set's name.
        pairs: the files of every frame, in order of time.
        encoding: of the depth images.
        intrinsics: of all images.
        ground_truth: T_world_camera, None if not known.
        color_size: width and height of colour images larger than depth, which are reduced to it.
        frame_id: the camera's optical frame, "" if not known.
        depth_camera: the one that took the depth images; None if they are registered to colour.
        imu: samples in the axes of the optical frame, None if there are none.
        left_out: images that are in no frame.
    """

    name: str
    pairs: tuple[ImagePair, ...]
    encoding: DepthEncoding
    intrinsics: CameraIntrinsics
    ground_truth: Trajectory | None
    color_size: tuple[int, int] | None = None
    frame_id: str = ""
    depth_camera: DepthCamera | None = None
    imu: ImuSamples | None = None
    left_out: LeftOut = field(default_factory=LeftOut)

    @property
    def frame_count(self) -> int:
        """The number of frames."""
        return len(self.pairs)

    def with_depth_scale(self, metres_per_unit: float | None) -> ImageSequence:
        """This sequence with depth in other units; None leaves them unchanged."""
        return replace(self, encoding=self.encoding.with_scale(metres_per_unit))

    def with_calibration_depth_scale(self, metres_per_unit: float | None) -> ImageSequence:
        """This sequence with depth in the units of a calibration file; None leaves them."""
        if metres_per_unit == 1 and _holds_whole_numbers(self.pairs[0].depth):
            logger.warning(
                "%s: its calibration gives a depth scale of 1, but depth is in whole numbers, so a "
                "unit of %g m is assumed; if it is another, give --depth-scale",
                self.name,
                1 / self.encoding.units_per_metre,
            )
        return replace(self, encoding=self.encoding.with_calibration_depth_scale(metres_per_unit))

    def with_depth_camera(self, depth_camera: DepthCamera | None) -> ImageSequence:
        """This sequence with depth from another camera than colour; None leaves it registered."""
        return replace(self, depth_camera=depth_camera)

    def __iter__(self) -> Iterator[RgbdFrame]:
        """The frames in order of time; those that cannot be read are skipped, counted and logged.

        Raises:
            InputError: at the end, if none could be read: images are missing, corrupt, or do not
                have the camera's size.
        """
        gaps = FrameGaps()
        frames = mapped_ahead(self._try_read, self.pairs)
        yield from readable(self.name, frames, len(self.pairs), gaps)
        warn_of_left_out(self.name, self.left_out, gaps)

    def select(self, indices: Iterable[int]) -> Iterator[RgbdFrame]:
        """The frames with these numbers, counted from 0, without reading any other.

        Raises:
            InputError: one of them cannot be read.
        """
        return mapped_ahead(self._read, (self.pairs[i] for i in indices if i < self.frame_count))

    def _try_read(self, pair: ImagePair) -> RgbdFrame | InputError:
        try:
            return self._read(pair)
        except InputError as error:
            return error

    def _read(self, pair: ImagePair) -> RgbdFrame:
        return self.frame(pair, self._color(pair.color))

    def frame(self, pair: ImagePair, color: UInt8) -> RgbdFrame:
        """The frame of a pair whose colour image is already decoded.

        Args:
            pair: one of the sequence.
            color: [H, W(, 3)], RGB or grey.

        Raises:
            InputError: the depth image cannot be read, or the sizes do not fit.
        """
        size = (self.intrinsics.height, self.intrinsics.width)
        shape = size if any(size) else color.shape[:2]
        told = f"the calibration of {self.name}"
        camera = of_image_size(self.intrinsics, shape, told, str(pair.color))
        color = resized_to_camera(color, camera)
        depth_size = camera if self.depth_camera is None else self.depth_camera.intrinsics
        depth = self._depth(pair.depth, (depth_size.width, depth_size.height))
        if self.depth_camera is not None:
            files = FrameTopics(
                str(pair.color), str(pair.depth), self.name, "the given depth calibration"
            )
            color, depth, camera = registered_images(color, depth, camera, self.depth_camera, files)
        return RgbdFrame(
            pair.stamp_ns,
            color,
            depth,
            camera,
            self.frame_id,
            depth_delay_ns=pair.depth_stamp_ns - pair.stamp_ns,
        )

    def _color(self, path: Path) -> UInt8:
        own = self.intrinsics.width, self.intrinsics.height
        image = self._decoded(path, self.color_size or own)
        if image.dtype == np.uint16:
            image = in_8_bits(image, self._color_bits)
        return to_rgb(image, str(path))

    @cached_property
    def _color_bits(self) -> int:
        """The bits that colour of 16 bits uses, in a few images from all over the sequence.

        A frame is the same whichever of the others are read.
        """
        step = -(-len(self.pairs) // _LOOKED_AT)
        bits = [FEWEST_BITS]
        for pair in self.pairs[::step]:
            with suppress(InputError):  # reported where it becomes a frame
                image = read_image(pair.color)
                if image.dtype == np.uint16:
                    bits.append(bits_of(image))
        return max(bits)

    def _depth(self, path: Path, size: tuple[int, int]) -> Float32:
        image = self._decoded(path, size)
        if image.ndim == 3 and image.dtype.kind == "f":
            image = _one_of_equal_channels(image)
        if image.ndim != 2 or image.dtype.kind not in "iuf" or image.dtype.itemsize == 1:
            raise InputError(
                path,
                f"is {image.dtype} of shape {image.shape}, not a depth image",
                "give depth as 16-bit grey PNG, or as NPY, TIFF or EXR of metres",
            )
        return self.encoding.metres(image)

    def _decoded(self, path: Path, expected: tuple[int, int]) -> NDArray[Any]:
        """The image, with the expected width and height; any size if the calibration gives none."""
        image = read_image(path)
        height, width = image.shape[:2]
        if any(expected) and (width, height) != expected:
            raise InputError(
                path,
                f"is {width}x{height}, but the camera is {expected[0]}x{expected[1]}",
                "give the calibration of these images (--calibration)",
            )
        return image

    def close(self) -> None:
        """Does nothing: no file is kept open."""


def _one_of_equal_channels(image: NDArray[Any]) -> NDArray[Any]:
    """One of the equal channels that renderers write to an EXR file, besides opacity."""
    same = np.array_equal(image[..., 0], image[..., 1], equal_nan=True)
    return image[..., 0] if same and image.shape[2] in {3, 4} else image


def _holds_whole_numbers(path: Path) -> bool:
    try:
        return read_image(path).dtype.kind in "iu"
    except InputError:
        return False  # reported where it is read


def read_image(path: Path) -> NDArray[Any]:
    """The image in a file: by ``decode``, or the array in an NPY file, with colours as B G R.

    Raises:
        InputError: the file is missing, damaged, or not an image.
    """
    data = read_bytes(path, MAX_IMAGE)
    refuse_stand_in(data, path)
    if path.suffix.lower() == ".npy":
        return _of_array(_array(data, path), path)
    return decode(data, str(path))


def first_readable(pairs: Iterable[ImagePair]) -> tuple[ImagePair, NDArray[Any], NDArray[Any]]:
    """The first frame of which both images can be read, with colour and depth as in their files.

    Raises:
        InputError: there is none; about the first image that cannot be read.
    """
    first: InputError | None = None
    for pair in pairs:
        try:
            color, depth = read_image(pair.color), read_image(pair.depth)
        except InputError as error:
            first = first or error
            continue
        return pair, color, depth
    raise first or InputError("frames", "there are none", "give a recording")


def _array(data: bytes, path: Path) -> NDArray[Any]:
    """The array in the bytes of an NPY file; its size is checked before memory is allocated."""
    file = BytesIO(data)
    try:
        read_header = _NPY_HEADERS[np.lib.format.read_magic(file)]
        with _ONE_HEADER:
            shape, is_by_columns, dtype = read_header(file)
        if dtype.hasobject or min(shape, default=0) < 0:
            raise ValueError(f"{dtype} {shape}")  # noqa: TRY301 - as what NumPy refuses
        numbers = np.frombuffer(data, dtype, math.prod(shape), file.tell())
        array: NDArray[Any] = numbers.reshape(shape, order="F" if is_by_columns else "C").copy()
    except Exception as error:
        raise InputError(path, f"holds no array ({error})", "restore the file") from error
    return array


def _of_array(array: NDArray[Any], path: Path) -> NDArray[Any]:
    """An array in OpenCV's convention: one channel without a third axis, colours as B G R."""
    image: NDArray[Any] = array.squeeze()
    if image.ndim == 3 and image.shape[2] == 3:
        return np.ascontiguousarray(image[..., ::-1])
    if image.ndim != 2:
        raise InputError(path, f"is an array of shape {array.shape}", "give images [H, W(, 3)]")
    return image


def to_rgb(image: NDArray[Any], where: str) -> UInt8:
    """A decoded image as uint8 [H, W, 3] RGB, or [H, W] if it is grey.

    Raises:
        InputError: the image does not have 8 bits, or not 1, 3 or 4 channels.
    """
    channels = 1 if image.ndim == 2 else image.shape[2]
    if image.dtype != np.uint8 or channels not in _TO_RGB:
        raise InputError(
            where,
            f"is {image.dtype} with {channels} channels, not a colour image",
            "give colour as PNG of 8 or 16 bits, or JPEG",
        )
    conversion = _TO_RGB[channels]
    return image if conversion is None else np.asarray(cv2.cvtColor(image, conversion))


def resized_to_camera(color: UInt8, camera: CameraIntrinsics) -> UInt8:
    """A larger colour image of the same view, averaged to the size of ``camera``."""
    size = camera.width, camera.height
    if color.shape[1::-1] == size:
        return color
    return np.asarray(cv2.resize(color, size, interpolation=cv2.INTER_AREA))


def matrix(path: Path, size: int) -> Float64:
    """The numbers in a text file as a matrix [size, size]; they need not be finite.

    Raises:
        InputError: the file cannot be read, or contains anything else.
    """
    words = read_text(path).split()
    try:
        numbers = np.array([float(word) for word in words])
    except ValueError as error:
        raise InputError(path, f"cannot be read ({error})", "restore the file") from error
    if numbers.size != size * size:
        raise InputError(path, f"is not a {size}x{size} matrix", "restore the file")
    return numbers.reshape(size, size)


def camera_of_matrix(where: object, K: Float64, width: int, height: int) -> CameraIntrinsics:
    """The camera of a matrix [3, 3], or of the upper left of a larger one.

    Raises:
        InputError: the matrix is not a camera, as in ``pinhole``.
    """
    return pinhole(K[:3, :3], width, height, "K", str(where))


def ground_truth(files: Iterable[tuple[int, Path]]) -> Trajectory | None:
    """The poses in files of one matrix [4, 4] each, by the stamps of their frames.

    A missing file, or one with a pose that is not finite (tracking was lost), gives none.

    Returns:
        None if there is no pose at all.

    Raises:
        InputError: a file is malformed.
    """
    poses = [(stamp, matrix(path, 4)) for stamp, path in files if path.is_file()]
    known = [(stamp, T) for stamp, T in poses if np.isfinite(T).all()]
    if not known:
        return None
    stamps, matrices = zip(*known, strict=True)
    return Trajectory(np.array(stamps, np.int64), np.stack(matrices))
