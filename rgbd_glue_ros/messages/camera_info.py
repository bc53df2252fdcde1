"""camera_info -> intrinsics: which camera took an image, by the fields of its info.

Drivers name one lens model in many ways and pad its coefficients to many lengths. Names are taken
by family, and zeros behind the last coefficient say nothing.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.image_codecs import check_size
from rgbd_glue_ros.messages.images import is_rectified
from rgbd_glue_ros.messages.reading import reader_of
from rgbd_glue_ros.types import CameraIntrinsics, Float64, LensModel

# Focal length and centre of a camera are within so many times, and above this part of, its image.
MAX_SIDES = 100.0
# A calibration that tells no size, or another than the image has, is taken for one of the image if
# its principal point is no farther from the centre, as a part of the size.
_MAX_OFF_CENTRE = 0.2

# Where a camera matrix has its skew
_SKEW = np.array([[0.0, 1, 0], [0, 0, 0], [0, 0, 0]])

_FAMILIES: Mapping[LensModel, tuple[str, ...]] = {
    LensModel.BROWN_CONRADY: (
        "",
        "none",
        "plumb_bob",
        "rational_polynomial",
        "rational",
        "thin_prism",
        "tilted",
        "radtan",
        "radtan8",
        "radial_tangential",
        "brown_conrady",
        "modified_brown_conrady",
        "brown",
        "pinhole",
        "perspective",
        "opencv",
        "full_opencv",
        "rectified",
        "standard",
    ),
    LensModel.INVERSE_BROWN_CONRADY: ("inverse_brown_conrady",),
    LensModel.KANNALA_BRANDT: (
        "equidistant",
        "equi",
        "fisheye",
        "opencv_fisheye",
        "kannala_brandt",
        "kannala_brandt4",
        "kannala_brandt8",
        "kb4",
    ),
}


def intrinsics_of(info: CameraInfo, image_topic: str, where: str) -> CameraIntrinsics:
    """The camera of an image: rectified or not, as the name of its topic tells.

    A camera info describes both.

    Args:
        info: of the image.
        image_topic: the image's.
        where: the info's topic.

    Raises:
        InputError: as of the two functions below.
    """
    if is_rectified(image_topic):
        return rectified_intrinsics_from_message(info, where)
    return intrinsics_from_message(info, where)


def intrinsics_from_message(msg: CameraInfo, where: str) -> CameraIntrinsics:
    """The camera that took the image as it was published, by K and D: not rectified.

    Where K is not filled, it is the camera of P, which rectification alone leaves as K is.

    Args:
        msg: sensor_msgs/msg/CameraInfo.
        where: its topic.

    Returns:
        The camera after cropping and binning; without size where width and height are both 0.

    Raises:
        InputError: it is of another type, not calibrated, or of an unknown distortion model.
    """
    _check_info(msg, where)
    P, K = np.reshape(msg.p, (3, 4))[:, :3], np.reshape(msg.k, (3, 3))
    camera = (
        _pinhole(K, msg, "K", where)
        if np.any(K) or not np.any(P)
        else (_pinhole(P, msg, "P", where))
    )
    lens, distortion = _distortion(msg, where)
    return replace(camera, distortion=distortion, lens=lens)


def rectified_intrinsics_from_message(msg: CameraInfo, where: str) -> CameraIntrinsics:
    """The camera that would have taken the rectified image, by P, or by K where P is not filled.

    Args:
        msg: sensor_msgs/msg/CameraInfo.
        where: its topic.

    Returns:
        The camera after cropping and binning; without size where width and height are both 0.

    Raises:
        InputError: it is of another type, or not calibrated.
    """
    _check_info(msg, where)
    P, K = np.reshape(msg.p, (3, 4))[:, :3], np.reshape(msg.k, (3, 3))
    # rectification alone leaves K as it is
    return _pinhole(P, msg, "P", where) if np.any(P) else _pinhole(K, msg, "K", where)


def of_image_size(
    camera: CameraIntrinsics, shape: tuple[int, ...], where: str, image_topic: str
) -> CameraIntrinsics:
    """The camera at the resolution of its image.

    Args:
        camera: at another resolution, or of a size that is not told.
        shape: of the image, [height, width].
        where: what says so of the camera, for errors.
        image_topic: where the image is from, for errors.

    Raises:
        InputError: its image has another aspect, or cannot be this one.
    """
    height, width = shape
    if (camera.width, camera.height) == (width, height):
        return camera
    if not (camera.width or camera.height):
        return _believed(replace(camera, width=width, height=height), where, image_topic)
    remedy = "give the camera info of these images (--calibration FILE)"
    check_aspect((camera.height, camera.width), shape, where, image_topic, remedy)
    if _is_off_centre(camera):
        raise InputError(
            where,
            f"is of {camera.width}x{camera.height} pixels, {image_topic} of {width}x{height}, and "
            f"its centre ({camera.cx:g}, {camera.cy:g}) is not that of its own size",
            "give width and height of the images that the calibration is of",
        )
    return camera.scaled(width, height)


def _believed(camera: CameraIntrinsics, where: str, image_topic: str) -> CameraIntrinsics:
    """The camera, whose size is that of its image alone, if the centre of both agrees."""
    width, height = camera.width, camera.height
    if _is_off_centre(camera) or not is_plausible(camera):
        raise InputError(
            where,
            f"tells no size, and its centre ({camera.cx:g}, {camera.cy:g}) is not that of the "
            f"{width}x{height} pixels of {image_topic}",
            "give width and height of the images that the calibration is of",
        )
    return camera


def _is_off_centre(camera: CameraIntrinsics) -> bool:
    """Whether the principal point is far from the middle of the camera's image."""
    off_centre = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
    return off_centre > _MAX_OFF_CENTRE


def check_aspect(
    shape: tuple[int, ...], image_shape: tuple[int, ...], where: str, image_topic: str, remedy: str
) -> None:
    """Refuses what is of another aspect than the image, to within a pixel.

    Args:
        shape: [height, width].
        image_shape: of the image.
        where: what has that shape, for errors.
        image_topic: where the image is from, for errors.
        remedy: what to do about it.

    Raises:
        InputError: it is.
    """
    (height, width), (image_height, image_width) = shape, image_shape
    if round(width * image_height / image_width) != height and (
        round(height * image_width / image_height) != width
    ):
        raise InputError(
            where,
            f"is of {width}x{height} pixels, but {image_topic} of {image_width}x{image_height}",
            remedy,
        )


def _check_info(msg: CameraInfo, where: str) -> None:
    reader_of(_INFO_READERS, msg, where)
    if not _is_without_size(msg):
        check_size(msg.width, msg.height, where)


def _is_without_size(msg: CameraInfo) -> bool:
    """Whether the info leaves it to the image how large that is."""
    return not any((msg.width, msg.height, msg.roi.width, msg.roi.height)) and (
        max(msg.binning_x, msg.binning_y) < 2
    )


def pinhole(matrix: Float64, width: int, height: int, name: str, where: str) -> CameraIntrinsics:
    """The camera of a matrix [3, 3], without distortion.

    Args:
        matrix: fx 0 cx, 0 fy cy, 0 0 1; pixels.
        width: of its images, pixels; 0 with ``height`` where that is not known.
        height: the same.
        name: of the matrix, for errors.
        where: it is from, for errors.

    Raises:
        InputError: it is another matrix, askew, or that of no camera with such images.
    """
    if not matrix.any():
        raise InputError(
            where,
            f"{name} is all zeros: the camera is not calibrated",
            "calibrate it and give the file to its driver (camera_info_url); for a "
            "recording, give --calibration",
        )
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    expected = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    skew = float(matrix[0, 1])
    if skew and np.isfinite(skew) and np.array_equal(matrix - expected, skew * _SKEW):
        raise InputError(
            where,
            f"{name} has a skew of {skew:g} pixels, and images are only read without",
            "calibrate the camera without skew, as camera_calibration and OpenCV do, and give "
            "that (--calibration FILE)",
        )
    if not np.isfinite(matrix).all() or not np.array_equal(matrix, expected):
        raise _no_camera(f"{name} is {matrix.tolist()}, not fx 0 cx, 0 fy cy, 0 0 1", where)
    try:
        camera = CameraIntrinsics(width, height, fx, fy, cx, cy)
    except InputError as fault:
        number = fault.where.rpartition(".")[2]
        raise _no_camera(f"{number} of {name} {fault.cause}", where) from fault
    if (width or height) and not is_plausible(camera):
        raise _no_camera(
            f"fx = {fx:g}, fy = {fy:g}, cx = {cx:g}, cy = {cy:g} of {name} are no camera's whose "
            f"images have {width}x{height} pixels",
            where,
        )
    return camera


def _no_camera(cause: str, where: str) -> InputError:
    remedy = "give numbers in pixels of the images, or another calibration (--calibration FILE)"
    return InputError(where, cause, remedy)


def _pinhole(matrix: Float64, msg: CameraInfo, name: str, where: str) -> CameraIntrinsics:
    """The camera of ``matrix`` [3, 3], cropped and binned, without distortion."""
    camera = pinhole(matrix, msg.width, msg.height, name, where)
    if _is_without_size(msg):
        return camera
    return _binned(_cropped(camera, msg, where), msg, where)


def is_plausible(camera: CameraIntrinsics) -> bool:
    """Whether a camera with these numbers can have taken images of this size."""
    side = max(camera.width, camera.height)
    return side / MAX_SIDES < min(camera.fx, camera.fy) and (
        max(camera.fx, camera.fy, abs(camera.cx), abs(camera.cy)) < side * MAX_SIDES
    )


def _distortion(msg: CameraInfo, where: str) -> tuple[LensModel, tuple[float, ...]]:
    """The lens and its coefficients; none where they are all zero."""
    d: Float64 = np.asarray(msg.d, np.float64)
    if not np.isfinite(d).all():
        raise InputError(where, f"D holds {d.tolist()}", "calibrate the camera again")
    if not d.any():
        return LensModel.BROWN_CONRADY, ()
    lens = _lens_named(msg.distortion_model)
    needed = int(d.nonzero()[0][-1]) + 1
    lengths = [n for n in lens.counts if n >= needed] if lens else []
    if lens is None or not lengths:
        known = ", ".join(name for names in _FAMILIES.values() for name in names if name)
        raise InputError(
            where,
            f"{len(d)} coefficients of distortion model {msg.distortion_model!r} are not supported",
            f"rectify the images, or calibrate by one of {known}",
        )
    length = len(d) if len(d) in lengths else lengths[0]
    padded = np.zeros(max(length, len(d)))
    padded[: len(d)] = d
    return lens, tuple(padded[:length].tolist())


def _lens_named(model: str) -> LensModel | None:
    """The lens model of a name, written in whatever way."""
    plain = _plain(model)
    return next((lens for lens, names in _FAMILIES.items() if plain in map(_plain, names)), None)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


_INFO_READERS: Mapping[str, Callable[[Any, str], CameraIntrinsics]] = {
    "CameraInfo": intrinsics_from_message
}

INFO_TYPES = tuple(_INFO_READERS)
"""Names of the types of messages read here, without their package."""


def _cropped(camera: CameraIntrinsics, msg: CameraInfo, where: str) -> CameraIntrinsics:
    roi = msg.roi
    if roi.width == 0 and roi.height == 0:
        return camera
    if (
        min(roi.width, roi.height) < 1
        or roi.x_offset + roi.width > camera.width
        or roi.y_offset + roi.height > camera.height
    ):
        raise InputError(
            where,
            f"the region of interest {roi.width}x{roi.height} at ({roi.x_offset}, {roi.y_offset}) "
            f"is not within {camera.width}x{camera.height} pixels",
            "correct the publisher",
        )
    return replace(
        camera,
        width=roi.width,
        height=roi.height,
        cx=camera.cx - roi.x_offset,
        cy=camera.cy - roi.y_offset,
    )


def _binned(camera: CameraIntrinsics, msg: CameraInfo, where: str) -> CameraIntrinsics:
    # both 0 and 1 mean no binning
    width = camera.width // max(msg.binning_x, 1)
    height = camera.height // max(msg.binning_y, 1)
    check_size(width, height, where)
    return camera.scaled(width, height)
