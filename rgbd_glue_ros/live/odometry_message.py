"""Estimates as nav_msgs/Odometry, as the node publishes them."""

from __future__ import annotations

from rgbd_glue_ros.live.extrinsics import Extrinsics
from rgbd_glue_ros.messages import fields
from rgbd_glue_ros.types import Float64, OdometryEstimate


def odometry_message(
    estimate: OdometryEstimate, extrinsics: Extrinsics, pose: fields.PoseStamped, child: str
) -> fields.Odometry | None:
    """The pose and the twist of the child frame, with their covariances.

    Args:
        estimate: of the camera.
        extrinsics: between the camera and the published frames.
        pose: of the child frame, as published.
        child: name of that frame.

    Returns:
        None without a twist: consumers would trust an invented one.
    """
    if (
        estimate.T_odom_camera is None
        or estimate.covariance is None
        or estimate.twist is None
        or estimate.twist_covariance is None
    ):
        return None
    of_pose = extrinsics.pose_covariance(estimate.T_odom_camera, estimate.covariance)
    of_twist = extrinsics.twist_covariance(estimate.twist_covariance)
    return fields.Odometry(
        pose.header,
        child,
        fields.PoseWithCovariance(pose.pose, of_pose.ravel()),
        fields.TwistWithCovariance(_twist(extrinsics.twist(estimate.twist)), of_twist.ravel()),
    )


def _twist(velocity: Float64) -> fields.Twist:
    x, y, z, rx, ry, rz = (float(value) for value in velocity)
    return fields.Twist(fields.Vector3(x, y, z), fields.Vector3(rx, ry, rz))
