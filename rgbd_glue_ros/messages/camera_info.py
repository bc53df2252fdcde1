"""camera_info -> intrinsics.

Drivers use many names for the same lens model, and pad its coefficients to various lengths. So all
names of a model are accepted, and zeros after the last coefficient are ignored.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.messages.fields import CameraInfo
from rgbd_glue_ros.messages.image_codecs import check_size
from rgbd_glue_ros.messages.images import is_rectified
from rgbd_glue_ros.messages.reading import check_type
from rgbd_glue_ros.types import CameraIntrinsics, Float64, LensModel

INFO_TYPES = ("CameraInfo",)
"""Names of the message types that can be read, without their package."""

# Plausible focal lengths and principal points are below this many times the longer image side;
# focal lengths are also above the side divided by this.
MAX_SIDES = 100.0
# A calibration without a size, or of another size than the image, is assumed to be for the image if
# its principal point is at most this far from the centre, as a fraction of the size.
_MAX_OFF_CENTRE = 0.2
# If it is off along both sides by the same factor, to within this, the calibration is for another
# resolution. A region of an image that is published as a whole one is off by different factors.
_SAME_FACTOR = 0.05

# What single precision leaves of computed zeros and ones: less than a hundredth of a pixel
_ROUNDING = 1e-5

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
    """The camera of an image, rectified or not.

    A camera info describes both; the name of the image's topic tells which of them applies.

    Args:
        info: camera info of the image.
        image_topic: topic of the image.
        where: topic of the info, for errors.

    Raises:
        InputError: as for the two functions below.
    """
    if is_rectified(image_topic):
        return rectified_intrinsics_from_message(info, where)
    return intrinsics_from_message(info, where)


def intrinsics_from_message(msg: CameraInfo, where: str) -> CameraIntrinsics:
    """The camera of an image that is not rectified, from K and D.

    If K is not filled, P is used, since plain rectification keeps K.

    Args:
        msg: sensor_msgs/msg/CameraInfo.
        where: its topic, for errors.

    Returns:
        The camera after cropping and binning; without size if width and height are both 0.

    Raises:
        InputError: it has another type, is not calibrated, or has an unknown distortion model.
    """
    _check_info(msg, where)
    P, K = np.reshape(msg.p, (3, 4))[:, :3], np.reshape(msg.k, (3, 3))
    camera = (
        _pinhole(K, msg, "K", where) if np.any(K) or not np.any(P) else _pinhole(P, msg, "P", where)
    )
    lens, distortion = _distortion(msg, where)
    return replace(camera, distortion=distortion, lens=lens)


def rectified_intrinsics_from_message(msg: CameraInfo, where: str) -> CameraIntrinsics:
    """The camera of a rectified image, from P, or from K if P is not filled.

    Args:
        msg: sensor_msgs/msg/CameraInfo.
        where: its topic, for errors.

    Returns:
        The camera after cropping and binning; without size if width and height are both 0.

    Raises:
        InputError: it has another type, or is not calibrated.
    """
    _check_info(msg, where)
    P, K = np.reshape(msg.p, (3, 4))[:, :3], np.reshape(msg.k, (3, 3))
    # plain rectification keeps K
    return _pinhole(P, msg, "P", where) if np.any(P) else _pinhole(K, msg, "K", where)


def of_image_size(
    camera: CameraIntrinsics, shape: tuple[int, ...], where: str, image_topic: str
) -> CameraIntrinsics:
    """The camera at the resolution of its image.

    Args:
        camera: the camera, possibly at another resolution or without a size.
        shape: shape of the image, [height, width].
        where: source of the camera, for errors.
        image_topic: source of the image, for errors.

    Raises:
        InputError: the aspect ratios differ, or the image cannot be of this camera.
    """
    height, width = shape
    if (camera.width, camera.height) == (width, height):
        return camera
    if not (camera.width or camera.height):
        return _believed(replace(camera, width=width, height=height), where, image_topic)
    remedy = "publish the camera info of these images; for a recording, give --calibration FILE"
    check_aspect((camera.height, camera.width), shape, where, image_topic, remedy)
    if _is_off_centre(camera):
        raise InputError(
            where,
            f"is for {camera.width}x{camera.height} pixels, {image_topic} has {width}x{height}, "
            f"and its centre ({camera.cx:g}, {camera.cy:g}) does not fit its own size",
            "give width and height of the images that the calibration was made with",
        )
    return camera.scaled(width, height)


def _believed(camera: CameraIntrinsics, where: str, image_topic: str) -> CameraIntrinsics:
    """The camera, whose size was taken from the image, if its centre fits that size."""
    width, height = camera.width, camera.height
    if _is_off_centre(camera) or not is_plausible(camera):
        raise InputError(
            where,
            f"has no size, and its centre ({camera.cx:g}, {camera.cy:g}) does not fit the "
            f"{width}x{height} pixels of {image_topic}",
            "give width and height of the images that the calibration was made with",
        )
    return camera


def _check_resolution(camera: CameraIntrinsics, name: str, where: str) -> None:
    """Refuses a matrix for another resolution than that of its info, before any cropping."""
    factors = camera.cx / camera.width, camera.cy / camera.height
    if _is_off_centre(camera) and abs(factors[0] - factors[1]) < _SAME_FACTOR:
        raise InputError(
            where,
            f"the centre ({camera.cx:g}, {camera.cy:g}) of {name} does not fit its own size, "
            f"{camera.width}x{camera.height}, but one of {2 * camera.cx + 1:.0f}x"
            f"{2 * camera.cy + 1:.0f}",
            "give width and height of the images that the calibration was made with; for a "
            "recording, another by --calibration FILE",
        )


def _is_off_centre(camera: CameraIntrinsics) -> bool:
    """Whether the principal point is far from the centre of the camera's image."""
    off_centre = max(abs(camera.cx / camera.width - 0.5), abs(camera.cy / camera.height - 0.5))
    return off_centre > _MAX_OFF_CENTRE


def check_aspect(
    shape: tuple[int, ...], image_shape: tuple[int, ...], where: str, image_topic: str, remedy: str
) -> None:
    """Checks that two images have the same aspect ratio, to within a pixel.

    Args:
        shape: [height, width].
        image_shape: [height, width] of the image to compare with.
        where: source of ``shape``, for errors.
        image_topic: source of the image, for errors.
        remedy: what to do if the ratios differ.

    Raises:
        InputError: the aspect ratios differ.
    """
    (height, width), (image_height, image_width) = shape, image_shape
    if round(width * image_height / image_width) != height and (
        round(height * image_width / image_height) != width
    ):
        raise InputError(
            where,
            f"has {width}x{height} pixels, but {image_topic} has {image_width}x{image_height}",
            remedy,
        )


def _check_info(msg: CameraInfo, where: str) -> None:
    check_type(INFO_TYPES, msg, where)
    if not _is_without_size(msg):
        check_size(msg.width, msg.height, where)


def _is_without_size(msg: CameraInfo) -> bool:
    """Whether the info gives no image size."""
    return not any((msg.width, msg.height, msg.roi.width, msg.roi.height)) and (
        max(msg.binning_x, msg.binning_y) < 2
    )


def pinhole(matrix: Float64, width: int, height: int, name: str, where: str) -> CameraIntrinsics:
    """The camera of a matrix [3, 3], without distortion.

    Args:
        matrix: fx 0 cx, 0 fy cy, 0 0 1, up to rounding; pixels.
        width: width of its images, pixels; width and height are 0 if unknown.
        height: height of its images, pixels.
        name: name of the matrix, for errors.
        where: source of the matrix, for errors.

    Raises:
        InputError: it is not such a matrix, has skew, or is implausible for images of that size.
    """
    if not matrix.any():
        raise InputError(
            where,
            f"{name} is all zeros: the camera is not calibrated",
            "calibrate it and give the file to its driver (camera_info_url); for a "
            "recording, give --calibration FILE",
        )
    no_matrix = f"{name} is {matrix.tolist()}, not fx 0 cx, 0 fy cy, 0 0 1"
    if not np.isfinite(matrix).all():
        raise _no_camera(no_matrix, where)
    fx, fy, cx, cy = (float(matrix[at]) for at in ((0, 0), (1, 1), (0, 2), (1, 2)))
    expected = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    focal = max(abs(fx), abs(fy))
    is_off = np.abs(matrix - expected) > _ROUNDING * np.array([[focal], [focal], [1]])
    skew = float(matrix[0, 1])
    if is_off[0, 1] and is_off.sum() == 1:
        raise InputError(
            where,
            f"{name} has a skew of {skew:g} pixels, which is not supported",
            "calibrate the camera without skew, as camera_calibration and OpenCV do, and give "
            "that calibration to the driver; for a recording, give --calibration FILE",
        )
    if is_off.any():
        raise _no_camera(no_matrix, where)
    try:
        camera = CameraIntrinsics(width, height, fx, fy, cx, cy)
    except InputError as fault:
        number = fault.where.rpartition(".")[2]
        raise _no_camera(f"{number} of {name} {fault.cause}", where) from fault
    if (width or height) and not is_plausible(camera):
        raise _no_camera(
            f"fx = {fx:g}, fy = {fy:g}, cx = {cx:g}, cy = {cy:g} of {name} are implausible for "
            f"images of {width}x{height} pixels",
            where,
        )
    return camera


def _no_camera(cause: str, where: str) -> InputError:
    remedy = "give values in pixels of the images; for a recording, another by --calibration FILE"
    return InputError(where, cause, remedy)


def _pinhole(matrix: Float64, msg: CameraInfo, name: str, where: str) -> CameraIntrinsics:
    """The camera of ``matrix`` [3, 3], cropped and binned, without distortion."""
    camera = pinhole(matrix, msg.width, msg.height, name, where)
    if _is_without_size(msg):
        return camera
    _check_resolution(camera, name, where)
    return _binned(_cropped(camera, msg, where), msg, where)


def is_plausible(camera: CameraIntrinsics) -> bool:
    """Whether focal lengths and principal point are plausible for images of the camera's size."""
    side = max(camera.width, camera.height)
    return side / MAX_SIDES < min(camera.fx, camera.fy) and (
        max(camera.fx, camera.fy, abs(camera.cx), abs(camera.cy)) < side * MAX_SIDES
    )


def _distortion(msg: CameraInfo, where: str) -> tuple[LensModel, tuple[float, ...]]:
    """The lens model and its coefficients; no coefficients if all are zero."""
    d: Float64 = np.asarray(msg.d, np.float64)
    if not np.isfinite(d).all():
        raise InputError(where, f"D is {d.tolist()}", "calibrate the camera again")
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
            f"rectify the images, or calibrate with one of {known}",
        )
    length = len(d) if len(d) in lengths else lengths[0]
    padded = np.zeros(max(length, len(d)))
    padded[: len(d)] = d
    return lens, tuple(padded[:length].tolist())


def _lens_named(model: str) -> LensModel | None:
    """The lens model of a name, whatever its case and punctuation; None if unknown."""
    plain = _plain(model)
    return next((lens for lens, names in _FAMILIES.items() if plain in map(_plain, names)), None)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


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
