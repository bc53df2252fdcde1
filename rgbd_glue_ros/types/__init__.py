"""The data that flows through the package, frozen: frames in, correspondences, poses out.

Conventions: ``T_a_b`` maps points in frame b to frame a. Camera frames are optical frames
(REP-103: x right, y down, z forward). Metres, radians, seconds; stamps are integer nanoseconds.
"""

from __future__ import annotations

from rgbd_glue_ros.types.arrays import NANOSECONDS, Float32, Float64, Int64, Mask, UInt8
from rgbd_glue_ros.types.camera import CameraIntrinsics, LensModel
from rgbd_glue_ros.types.frames import RgbdFrame, View
from rgbd_glue_ros.types.imu import ImuCalibration, ImuSamples, ImuUse
from rgbd_glue_ros.types.odometry import (
    DepthSummary,
    OdometryEstimate,
    TrackingState,
)
from rgbd_glue_ros.types.pose_graph import EdgeOrigin, PoseGraph, PoseGraphEdge
from rgbd_glue_ros.types.registration import (
    Correspondences,
    RegistrationResult,
    RegistrationStatus,
    TransformPrior,
)
from rgbd_glue_ros.types.trajectory import Trajectory

__all__ = [
    "NANOSECONDS",
    "CameraIntrinsics",
    "Correspondences",
    "DepthSummary",
    "EdgeOrigin",
    "Float32",
    "Float64",
    "ImuCalibration",
    "ImuSamples",
    "ImuUse",
    "Int64",
    "LensModel",
    "Mask",
    "OdometryEstimate",
    "PoseGraph",
    "PoseGraphEdge",
    "RegistrationResult",
    "RegistrationStatus",
    "RgbdFrame",
    "TrackingState",
    "Trajectory",
    "TransformPrior",
    "UInt8",
    "View",
]
