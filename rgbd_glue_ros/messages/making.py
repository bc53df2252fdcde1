"""Makes plain ROS messages, to be written to a bag or copied into rclpy messages."""

from __future__ import annotations

import struct
from array import array
from dataclasses import fields, is_dataclass
from typing import TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.fields import (
    DEPTH_UNITS_PER_METRE,
    CameraInfo,
    CompressedImage,
    Header,
    Image,
    Imu,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    Time,
    Vector3,
)
from rgbd_glue_ros.messages.image_codecs import encode_jpeg, encode_png, quantised
from rgbd_glue_ros.types import (
    NANOSECONDS,
    CameraIntrinsics,
    Float32,
    Float64,
    ImuSamples,
    LensModel,
    UInt8,
)

Message = TypeVar("Message")

# the covariance of a quantity that the sensor does not measure, as in sensor_msgs/Imu
_NOT_MEASURED = np.array([-1.0] + [0.0] * 8)


def check_recordable(stamp_ns: int) -> None:
    """Refuses a time that a bag cannot store: builtin_interfaces/Time ends in 2038.

    Raises:
        InputError: the stamp is before 1970 or after 2038.
    """
    if not 0 <= stamp_ns < 2**31 * NANOSECONDS:
        raise InputError(
            "the recording",
            f"has a stamp of {stamp_ns / NANOSECONDS:.9g} s, but bags store only 0 to 2^31 s",
            "shift its stamps, or correct the line with this one",
        )


def header(stamp_ns: int, frame_id: str) -> Header:
    """A header with the stamp split into seconds and nanoseconds."""
    return Header(Time(*divmod(stamp_ns, NANOSECONDS)), frame_id)


def color_image(color: UInt8, head: Header) -> Image:
    """A colour image [H, W, 3] RGB or a grey one [H, W], as rgb8 or mono8."""
    return _image(color, "rgb8" if color.ndim == 3 else "mono8", head)


def depth_image(depth: Float32, head: Header) -> Image:
    """Depth [H, W] in metres, NaN where unknown, as 32FC1, without loss."""
    return _image(depth.astype("<f4"), "32FC1", head)


def millimetre_image(depth: Float32, head: Header) -> Image:
    """Depth [H, W] in metres, NaN where unknown, as 16UC1, as most drivers publish it.

    Depth beyond 65.535 m becomes unknown.
    """
    return _image(quantised(depth, DEPTH_UNITS_PER_METRE).astype("<u2"), "16UC1", head)


def compressed_color_image(color: UInt8, head: Header, quality: int = 95) -> CompressedImage:
    """A colour image [H, W, 3] RGB or a grey one [H, W], as JPEG."""
    if color.ndim == 2:
        return CompressedImage(head, "mono8; jpeg compressed ", _flat(encode_jpeg(color, quality)))
    data = encode_jpeg(cv2.cvtColor(color, cv2.COLOR_RGB2BGR), quality)
    return CompressedImage(head, "rgb8; jpeg compressed bgr8", _flat(data))


def compressed_depth_image(depth: Float32, head: Header) -> CompressedImage:
    """Depth [H, W] in metres, NaN where unknown, as compressedDepth: a PNG of whole millimetres.

    Depth beyond 65.535 m becomes unknown.
    """
    # the three numbers before the PNG are used for 32FC1 only
    head_of_data = struct.pack("<iff", 0, 0.0, 0.0)
    data = head_of_data + encode_png(quantised(depth, DEPTH_UNITS_PER_METRE))
    return CompressedImage(head, "16UC1; compressedDepth png", _flat(data))


def camera_info(intrinsics: CameraIntrinsics, head: Header) -> CameraInfo:
    """The camera info of an image without rectification: P repeats K, R is the identity."""
    p = np.zeros((3, 4))
    p[:, :3] = intrinsics.matrix
    return CameraInfo(
        header=head,
        height=intrinsics.height,
        width=intrinsics.width,
        distortion_model=distortion_model(intrinsics),
        d=np.array(intrinsics.distortion or (0.0,) * 5, np.float64),
        k=intrinsics.matrix.ravel(),
        r=np.eye(3).ravel(),
        p=p.ravel(),
    )


def distortion_model(intrinsics: CameraIntrinsics) -> str:
    """The name of the lens model in ROS, for its number of coefficients."""
    if intrinsics.lens is LensModel.BROWN_CONRADY and len(intrinsics.distortion) > 5:
        return "rational_polynomial"
    return intrinsics.lens.value


def pose_stamped(T: Float64, head: Header) -> PoseStamped:
    """The pose T [4, 4] of a body in the header's frame."""
    x, y, z = (float(value) for value in T[:3, 3])
    qx, qy, qz, qw = (float(value) for value in se3.quaternion(T))
    return PoseStamped(head, Pose(Point(x, y, z), Quaternion(qx, qy, qz, qw)))


def imu(samples: ImuSamples, index: int, frame_id: str) -> Imu:
    """The message of one sample, in the axes of the frame; NaN means not measured."""
    measured, covariances = [], []
    for vectors in (samples.angular_velocity, samples.linear_acceleration):
        is_known = bool(np.isfinite(vectors[index]).all())
        x, y, z = (float(value) if is_known else 0.0 for value in vectors[index])
        measured.append(Vector3(x, y, z))
        covariances.append(np.zeros(9) if is_known else _NOT_MEASURED)
    return Imu(
        header(int(samples.stamps_ns[index]), frame_id),
        Quaternion(0.0, 0.0, 0.0, 1.0),
        _NOT_MEASURED,
        measured[0],
        covariances[0],
        measured[1],
        covariances[1],
    )


def copy_fields(source: object, target: Message) -> Message:
    """Copies a plain message into an rclpy message of the same type, and returns that."""
    for item in fields(source):  # type: ignore[arg-type]
        value = getattr(source, item.name)
        if is_dataclass(value):
            copy_fields(value, getattr(target, item.name))
        elif isinstance(value, np.ndarray):
            # of the types that rclpy accepts, only array.array needs no loop in Python
            values = array(value.dtype.char)
            values.frombytes(value.data.cast("B"))
            setattr(target, item.name, values)
        else:
            setattr(target, item.name, value)
    return target


def _image(pixels: NDArray[np.uint8] | NDArray[np.float32], encoding: str, head: Header) -> Image:
    height, width = pixels.shape[:2]
    return Image(
        header=head,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=0,
        step=pixels[0].nbytes,
        data=np.ascontiguousarray(pixels).reshape(-1).view(np.uint8),
    )


def _flat(data: bytes) -> UInt8:
    return np.frombuffer(data, np.uint8)
