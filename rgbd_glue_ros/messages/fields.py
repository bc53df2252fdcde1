"""Plain ROS messages, which ``making`` makes.

Classes and fields have the names of ROS 2, so that this package reads them like any others.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rgbd_glue_ros.types import Float64, UInt8

# REP-118: 16UC1 depth is in millimetres
DEPTH_UNITS_PER_METRE = 1000


@dataclass(frozen=True)
class Time:
    """builtin_interfaces/msg/Time."""

    sec: int
    nanosec: int


@dataclass(frozen=True)
class Header:
    """std_msgs/msg/Header."""

    stamp: Time
    frame_id: str


@dataclass(frozen=True)
class Image:
    """sensor_msgs/msg/Image; ``data`` uint8, flat."""

    header: Header
    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: UInt8


@dataclass(frozen=True)
class CompressedImage:
    """sensor_msgs/msg/CompressedImage; ``data`` uint8, flat."""

    header: Header
    format: str
    data: UInt8


@dataclass(frozen=True)
class RegionOfInterest:
    """sensor_msgs/msg/RegionOfInterest; all zero means the whole image."""

    x_offset: int = 0
    y_offset: int = 0
    height: int = 0
    width: int = 0
    do_rectify: bool = False


@dataclass(frozen=True)
class CameraInfo:
    """sensor_msgs/msg/CameraInfo; ``d`` float64 [N], ``k`` and ``r`` [9], ``p`` [12]."""

    header: Header
    height: int
    width: int
    distortion_model: str
    d: Float64
    k: Float64
    r: Float64
    p: Float64
    binning_x: int = 0
    binning_y: int = 0
    roi: RegionOfInterest = RegionOfInterest()


@dataclass(frozen=True)
class Point:
    """geometry_msgs/msg/Point, metres."""

    x: float
    y: float
    z: float


@dataclass(frozen=True)
class Quaternion:
    """geometry_msgs/msg/Quaternion."""

    x: float
    y: float
    z: float
    w: float


@dataclass(frozen=True)
class Pose:
    """geometry_msgs/msg/Pose."""

    position: Point
    orientation: Quaternion


@dataclass(frozen=True)
class PoseStamped:
    """geometry_msgs/msg/PoseStamped."""

    header: Header
    pose: Pose


@dataclass(frozen=True)
class Vector3:
    """geometry_msgs/msg/Vector3."""

    x: float
    y: float
    z: float


@dataclass(frozen=True)
class Imu:
    """sensor_msgs/msg/Imu; covariances float64 [9], with -1 first if it is not measured."""

    header: Header
    orientation: Quaternion
    orientation_covariance: Float64
    angular_velocity: Vector3
    angular_velocity_covariance: Float64
    linear_acceleration: Vector3
    linear_acceleration_covariance: Float64


@dataclass(frozen=True)
class PoseWithCovariance:
    """geometry_msgs/msg/PoseWithCovariance; ``covariance`` float64 [36]."""

    pose: Pose
    covariance: Float64


@dataclass(frozen=True)
class Twist:
    """geometry_msgs/msg/Twist."""

    linear: Vector3 = Vector3(0.0, 0.0, 0.0)
    angular: Vector3 = Vector3(0.0, 0.0, 0.0)


@dataclass(frozen=True)
class TwistWithCovariance:
    """geometry_msgs/msg/TwistWithCovariance; ``covariance`` float64 [36]."""

    twist: Twist = Twist()
    covariance: Float64 = field(default_factory=lambda: np.zeros(36))


@dataclass(frozen=True)
class Odometry:
    """nav_msgs/msg/Odometry; all zero is the twist of a message that has only a pose."""

    header: Header
    child_frame_id: str
    pose: PoseWithCovariance
    twist: TwistWithCovariance = field(default_factory=TwistWithCovariance)
