"""Checks of the arrays of a frame: each fault is one line that says what to do about it."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.types.arrays import Float64, Mask

END_OF_TIME_NS = 2**63
"""Stamps and differences of stamps are below this, nanoseconds."""

# Pixels: no real camera is beyond these limits, and beyond them numbers overflow.
_SHORTEST, _LONGEST = 0.01, 1e6
# The error of a single-precision rotation that was multiplied a few times.
_NOT_ORTHONORMAL = 1e-3
FARTHEST_M = 1e7
"""Limit of the coordinates of a pose that is given, metres: UTM's reach that far, and doubles
resolve nanometres there."""
FARTHEST_READ_M = 10 * FARTHEST_M
"""Limit of those of a pose that is read: an odometry moves on from the pose that it was given, and
what it writes has to be readable."""

_GUESS = "T_guess_camera"
_CAMERA, _FRAME, _IMU = "CameraIntrinsics", "RgbdFrame", "ImuSamples"
_TRAJECTORY = "Trajectory"


def check_class(where: str, value: object, expected: type | tuple[type, ...], remedy: str) -> None:
    """Refuses an argument of another class.

    Args:
        where: function or class, and name of the argument.
        value: the argument.
        expected: the class that it must have, or one of several.
        remedy: what to give.

    Raises:
        InputError: it has another class.
    """
    if not isinstance(value, expected):
        classes = expected if isinstance(expected, tuple) else (expected,)
        names = " or ".join(each.__name__ for each in classes)
        cause = f"is of class {type(value).__name__}, not {names}"
        raise InputError(where, cause, f"give {remedy}")


def check_intrinsics(width: int, height: int, fx: float, fy: float, cx: float, cy: float) -> None:
    """Refuses an impossible camera.

    Args:
        width: width of its images, pixels.
        height: height of its images, pixels.
        fx: focal length along x, pixels.
        fy: focal length along y, pixels.
        cx: principal point x, pixels.
        cy: principal point y, pixels.

    Raises:
        InputError: a size is negative, a focal length not between 0.01 and a million pixels, or
            the centre more than a million pixels away.
    """
    numbers = {"width": width, "height": height, "fx": fx, "fy": fy, "cx": cx, "cy": cy}
    for name, number in numbers.items():
        if not isinstance(number, (int, float, np.number)) or not np.isfinite(number):
            raise _fault(_CAMERA, name, f"is {number!r}", "give a number of pixels")
    for name, size in (("width", width), ("height", height)):
        if size < 0 or size != int(size):
            raise _fault(_CAMERA, name, f"is {size}", "give the size in pixels")
    for name, length in (("fx", fx), ("fy", fy)):
        if not _SHORTEST <= length <= _LONGEST:
            raise _fault(_CAMERA, name, f"is {length}", "give the focal length in pixels")
    for name, centre in (("cx", cx), ("cy", cy)):
        if not abs(centre) <= _LONGEST:
            raise _fault(_CAMERA, name, f"is {centre}", "give pixels")


def check_distortion(coefficients: Any, counts: Collection[int]) -> None:
    """Refuses coefficients that fit no lens model.

    Args:
        coefficients: of the distortion, numbers in any shape; none for a rectified image.
        counts: the possible numbers of coefficients.

    Raises:
        InputError: no model has this number of coefficients, or one is not finite.
    """
    numbers = np.ravel(coefficients)
    known = ", ".join(map(str, counts))
    if numbers.dtype.kind not in "iuf":
        raise _fault(_CAMERA, "distortion", f"is {coefficients!r}", f"give 0 or {known} numbers")
    if len(numbers) not in {0, *counts}:
        raise _fault(
            _CAMERA, "distortion", f"has {len(numbers)} coefficients", f"give 0 or {known}"
        )
    if not np.isfinite(numbers).all():
        raise _fault(_CAMERA, "distortion", f"is {coefficients}", "calibrate the camera again")


def check_stamps(stamp_ns: object, depth_delay_ns: object) -> None:
    """Refuses times that are not whole nanoseconds, or exceed 64 bits.

    Raises:
        InputError: the stamps are not whole nanoseconds, or exceed 64 bits.
    """
    for name, value in (("stamp_ns", stamp_ns), ("depth_delay_ns", depth_delay_ns)):
        if not isinstance(value, (int, np.integer)) or abs(int(value)) >= END_OF_TIME_NS:
            remedy = "give whole nanoseconds, as round(seconds * 1e9)"
            raise _fault(_FRAME, name, f"is {value!r}", remedy)


def are_rigid(T: Float64) -> Mask:
    """Which matrices [N, 4, 4] are a rotation and a translation; absurd numbers and NaN are not."""
    R = T[:, :3, :3]
    # of absurd numbers, squares are infinite
    with np.errstate(all="ignore"):
        off = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        is_rotation = (off < _NOT_ORTHONORMAL) & (np.linalg.det(R) > 0)
    is_affine = (T[:, 3] == [0.0, 0.0, 0.0, 1.0]).all(axis=1)
    return np.asarray(is_rotation & is_affine, np.bool_)


def check_guess(T_guess_camera: Any) -> None:
    """Refuses an impossible pose of a camera.

    Args:
        T_guess_camera: must be float64 [4, 4].

    Raises:
        InputError: the array has another type or shape, is not finite, or is not a rotation and
            translation.
    """
    T = T_guess_camera
    if not _is_array(T, np.float64) or T.shape != (4, 4):
        raise _fault("track", _GUESS, f"is {_described(T)}", "give float64 [4, 4]")
    if not (are_rigid(T[np.newaxis]).all() and (np.abs(T[:3, 3]) < FARTHEST_M).all()):
        remedy = "give a rotation and metres, or None if the other odometry has no pose"
        raise _fault("track", _GUESS, f"is not a pose: {T.round(3).tolist()}", remedy)


def check_frame_id(frame_id: object) -> None:
    """Refuses a name that is not a text.

    Raises:
        InputError: the name is not a text.
    """
    if not isinstance(frame_id, str):
        raise _fault(_FRAME, "frame_id", f"is {frame_id!r}", "give a text, empty if it is unknown")


def check_camera(camera: object, kind: type) -> None:
    """Refuses anything that is not a camera, such as the matrix K.

    Args:
        camera: of a frame.
        kind: the required class.

    Raises:
        InputError: ``camera`` has another class.
    """
    if not isinstance(camera, kind):
        remedy = "give CameraIntrinsics(width, height, fx, fy, cx, cy)"
        raise _fault(_FRAME, "intrinsics", f"are {_described(camera)}", remedy)


def check_frame(color: Any, depth: Any, width: int, height: int) -> None:
    """Refuses images of another type or shape than expected.

    Depth in another unit has the right type and passes: the odometry's estimate reports it.

    Args:
        color: must be uint8 [H, W, 3] or [H, W].
        depth: must be float32 [H, W].
        width: width of the images that the intrinsics are for, pixels; 0 if it is not known.
        height: height of these images, pixels.

    Raises:
        InputError: an image has another type or shape, or does not fit the others.
    """
    if not _is_array(color, np.uint8) or color.shape[2:] not in {(), (3,)} or color.ndim < 2:
        remedy = "give uint8, [H, W, 3] RGB or [H, W] grey"
        raise _fault(_FRAME, "color", f"is {_described(color)}", remedy)
    if not _is_array(depth, np.float32) or depth.ndim != 2:
        remedy = "give float32 [H, W], metres, NaN where unknown"
        if isinstance(depth, np.ndarray) and depth.dtype.kind in "iu":
            remedy += (
                "; for millimetres that is np.where(d > 0, d / 1000, np.nan).astype(np.float32)"
            )
        if isinstance(depth, np.ma.MaskedArray):
            remedy += "; that is depth.filled(np.nan)"
        raise _fault(_FRAME, "depth", f"is {_described(depth)}", remedy)
    if depth.shape != color.shape[:2]:
        cause = f"is {_described(depth)}, but color is {_described(color)}"
        raise _fault(_FRAME, "depth", cause, "give depth registered to color, pixel for pixel")
    if not depth.size:
        raise _fault(_FRAME, "depth", f"is {_described(depth)}", "give images that hold pixels")
    if (height, width) not in {depth.shape, (0, 0)}:
        cause = f"are of {width}x{height}, but the images {_size(depth)}"
        raise _fault(
            _FRAME, "intrinsics", cause, "give those of these images, for example by scaled(w, h)"
        )


def check_imu(stamps_ns: Any, angular_velocity: Any, linear_acceleration: Any) -> None:
    """Refuses IMU samples of another type or shape than expected.

    Args:
        stamps_ns: must be int64 [N], increasing.
        angular_velocity: must be float64 [N, 3].
        linear_acceleration: must be float64 [N, 3].

    Raises:
        InputError: an array has another type or shape, or the stamps do not increase.
    """
    _check_stamp_array(_IMU, stamps_ns)
    if (np.diff(stamps_ns) <= 0).any():
        remedy = "sort the samples, and remove those that repeat a stamp"
        raise _fault(_IMU, "stamps_ns", "does not increase", remedy)
    shape = (len(stamps_ns), 3)
    for name, value in (
        ("angular_velocity", angular_velocity),
        ("linear_acceleration", linear_acceleration),
    ):
        if not _is_array(value, np.float64) or value.shape != shape:
            remedy = f"give float64 {list(shape)}, NaN where not measured"
            raise _fault(_IMU, name, f"is {_described(value)}", remedy)


def check_trajectory(stamps_ns: Any, poses: Any) -> None:
    """Refuses a trajectory of another type or shape than expected.

    Args:
        stamps_ns: must be int64 [N].
        poses: must be float64 [N, 4, 4], rotations and metres.

    Raises:
        InputError: an array has another type or shape, or a matrix is not a pose.
    """
    _check_stamp_array(_TRAJECTORY, stamps_ns)
    shape = (len(stamps_ns), 4, 4)
    if not _is_array(poses, np.float64) or poses.shape != shape:
        remedy = f"give float64 {list(shape)}, one pose for each stamp"
        raise _fault(_TRAJECTORY, "poses", f"is {_described(poses)}", remedy)
    if not np.isfinite(poses).all():
        remedy = "remove stamps that have no pose"
        raise _fault(_TRAJECTORY, "poses", "is not finite", remedy)
    is_pose = are_rigid(poses)
    if not is_pose.all():
        row = int(np.argmin(is_pose))
        cause = f"is not a pose in row {row}: {poses[row].round(3).tolist()}"
        raise _fault(_TRAJECTORY, "poses", cause, "give rotations and metres, [R t; 0 0 0 1]")


def _check_stamp_array(owner: str, stamps_ns: Any) -> None:
    if not _is_array(stamps_ns, np.int64) or stamps_ns.ndim != 1:
        remedy = "give int64 [N], whole nanoseconds"
        raise _fault(owner, "stamps_ns", f"is {_described(stamps_ns)}", remedy)


def _is_array(value: Any, dtype: type) -> bool:
    is_plain = isinstance(value, np.ndarray) and not isinstance(value, np.ma.MaskedArray)
    return is_plain and value.dtype == dtype


def _described(value: Any) -> str:
    if not isinstance(value, np.ndarray):
        return f"a {type(value).__name__}"
    if isinstance(value, np.ma.MaskedArray):
        return f"a masked array, {value.dtype} {list(value.shape)}"
    return f"{value.dtype} {list(value.shape)}"


def _size(image: Any) -> str:
    return f"{image.shape[1]}x{image.shape[0]}"


def _fault(owner: str, name: str, cause: str, remedy: str) -> InputError:
    return InputError(f"{owner}.{name}", cause, remedy)
