"""From the camera's pose to the robot's: frames, covariances and twists as in REP-103/105.

The odometry estimates the pose of the camera's optical frame in its first optical frame. The node
publishes the pose of a child frame, fixed to the camera or to its robot, in the fixed frame
``odom``: ``T_fixed_child = T_fixed_odom T_odom_camera T_camera_child``.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from rgbd_glue_ros.errors import InputError
from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.messages.poses import parse_pose
from rgbd_glue_ros.types import Float64

T_BODY_OPTICAL = se3.from_rotation_translation(
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3)
)
"""Pose of a camera's optical frame (x right, y down, z forward) in its body frame (x forward,
y left, z up), which drivers call ``camera_link``."""

AXES = {"body": T_BODY_OPTICAL, "optical": np.eye(4)}
"""Pose of the optical frame in a frame with the same origin and these axes."""


@dataclass(frozen=True)
class Extrinsics:
    """The two constant transforms between the camera's motion and the published pose.

    As in ``T_odom_camera``, ``odom`` is the first optical frame; the ROS frame odom is ``fixed``.

    Attributes:
        T_fixed_odom: float64 [4, 4], pose of the first optical frame in the ROS frame odom.
        T_camera_child: float64 [4, 4], pose of the child frame in the optical frame.
    """

    T_fixed_odom: Float64
    T_camera_child: Float64

    @staticmethod
    def of_camera(axes: str) -> Extrinsics:
        """The child is the optical frame itself; odom starts at the camera with ``axes``.

        Args:
            axes: a name in AXES; with ``body`` the z axis of odom is up if the camera starts level.
        """
        return Extrinsics(AXES[axes], np.eye(4))

    @staticmethod
    def of_robot(T_robot_camera: Float64) -> Extrinsics:
        """The child is a robot frame, which starts at the origin of odom.

        Args:
            T_robot_camera: float64 [4, 4], pose of the optical frame in the robot frame.
        """
        return Extrinsics(T_robot_camera, se3.inverse(T_robot_camera))

    def starting_at(self, T_odom_start: Float64) -> Extrinsics:
        """These extrinsics for a start at ``T_odom_start`` [4, 4] instead of odom's origin."""
        return Extrinsics(T_odom_start @ self.T_fixed_odom, self.T_camera_child)

    def levelled(self, up: Float64) -> Extrinsics:
        """These extrinsics with odom levelled by the smallest rotation about its origin.

        Args:
            up: the upward direction in the first optical frame, a unit vector [3].
        """
        x, y, z = self.T_fixed_odom[:3, :3] @ up
        # about the horizontal axis perpendicular to up and z; if upside down, any horizontal axis
        axis = np.array([y, -x, 0.0]) if np.hypot(x, y) > 0 else np.array([1.0, 0.0, 0.0])
        turn = axis / np.linalg.norm(axis) * np.arctan2(np.hypot(x, y), z)
        T_level_fixed = se3.exp(np.concatenate([np.zeros(3), turn]))
        return replace(self, T_fixed_odom=T_level_fixed @ self.T_fixed_odom)

    def pose(self, T_odom_camera: Float64) -> Float64:
        """T_fixed_child [4, 4] for the camera's pose [4, 4] in its first optical frame."""
        T_fixed_child: Float64 = self.T_fixed_odom @ T_odom_camera @ self.T_camera_child
        return T_fixed_child

    def pose_covariance(self, T_odom_camera: Float64, covariance: Float64) -> Float64:
        """The covariance [6, 6] of T_fixed_child.

        Both covariances are as in ``nav_msgs/Odometry``: errors of position and rotation vector
        along the axes of the fixed frame, x y z rx ry rz, in m and rad.

        Args:
            T_odom_camera: float64 [4, 4], the camera's pose.
            covariance: float64 [6, 6], covariance of that pose.
        """
        # a rotation error of the camera also moves the child, by the lever arm
        lever = T_odom_camera[:3, :3] @ self.T_camera_child[:3, 3]
        J = np.eye(6)
        J[:3, 3:] = -se3.skew(lever)
        J = np.kron(np.eye(2), self.T_fixed_odom[:3, :3]) @ J
        mapped: Float64 = J @ covariance @ J.T
        return mapped

    def twist(self, twist: Float64) -> Float64:
        """The child frame's velocity [6] (v, omega; m/s, rad/s) in its axes; from the camera's."""
        in_child: Float64 = se3.adjoint(se3.inverse(self.T_camera_child)) @ twist
        return in_child

    def twist_covariance(self, covariance: Float64) -> Float64:
        """The covariance [6, 6] of ``twist``, from that of the camera's velocity."""
        A = se3.adjoint(se3.inverse(self.T_camera_child))
        mapped: Float64 = A @ covariance @ A.T
        return mapped


@dataclass(frozen=True)
class PlanarExtrinsics(Extrinsics):
    """Extrinsics of a wheeled robot, whose child frame stays in the plane that it starts in.

    Height, roll and pitch of the odometry are drift, and are removed. The published pose has x and
    y of the child frame, and the yaw of its x axis seen from above the plane. The odometry itself
    is not constrained: it would mistake a bump, or an extrinsic that is a degree off, for motion
    along the plane.
    """

    @staticmethod
    def of_robot(T_robot_camera: Float64) -> PlanarExtrinsics:
        """As ``Extrinsics.of_robot``, for a robot that stays in its plane."""
        return PlanarExtrinsics(T_robot_camera, se3.inverse(T_robot_camera))

    def starting_at(self, T_odom_start: Float64) -> PlanarExtrinsics:
        """As ``Extrinsics.starting_at``; the x and y axes of the start span the plane."""
        return PlanarExtrinsics(T_odom_start @ self.T_fixed_odom, self.T_camera_child)

    @property
    def _T_fixed_start(self) -> Float64:
        """Pose of the child frame at the start; its z axis is the plane's normal."""
        T: Float64 = self.T_fixed_odom @ self.T_camera_child
        return T

    def pose(self, T_odom_camera: Float64) -> Float64:
        """T_fixed_child [4, 4], restricted to motion in the plane."""
        start = self._T_fixed_start
        return np.asarray(start @ in_plane(se3.inverse(start) @ super().pose(T_odom_camera)))

    def pose_covariance(self, T_odom_camera: Float64, covariance: Float64) -> Float64:
        """The covariance [6, 6], with almost no variance of height, roll and pitch."""
        R = np.kron(np.eye(2), self._T_fixed_start[:3, :3])
        free = super().pose_covariance(T_odom_camera, covariance)
        return np.asarray(R @ _kept_in_plane(R.T @ free @ R) @ R.T)

    def twist(self, twist: Float64) -> Float64:
        """The child frame's velocity [6]: forward, sideways, and about its z axis."""
        return np.where(_IN_PLANE, super().twist(twist), 0.0)

    def twist_covariance(self, covariance: Float64) -> Float64:
        """The covariance [6, 6] of ``twist``, with almost no variance outside the plane."""
        return _kept_in_plane(super().twist_covariance(covariance))


# x, y and yaw among x y z rx ry rz
_IN_PLANE = np.array([True, True, False, False, False, True])
# Variance of height, roll and pitch, m² and rad²: almost none, yet filters can invert it.
_CERTAIN = 1e-6


def in_plane(T: Float64) -> Float64:
    """The motion [4, 4] without height, roll and pitch: z is 0, the x axis lies in the plane.

    If the x axis is perpendicular to the plane, yaw is undefined and set to 0.
    """
    yaw = np.arctan2(T[1, 0], T[0, 0])
    moved = np.eye(4)
    moved[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    moved[:2, 3] = T[:2, 3]
    return moved


def _kept_in_plane(covariance: Float64) -> Float64:
    """The part of a covariance [6, 6] within the plane, and almost no variance of the rest."""
    kept = np.where(np.outer(_IN_PLANE, _IN_PLANE), covariance, 0.0)
    return np.asarray(kept + _CERTAIN * np.diag(~_IN_PLANE))


def robot_extrinsics(T_robot_camera: Float64, *, planar: bool) -> Extrinsics:
    """The extrinsics of a robot from its camera's pose [4, 4]; ``planar`` for a wheeled one."""
    kind = PlanarExtrinsics if planar else Extrinsics
    return kind.of_robot(T_robot_camera)


def parse_extrinsics(
    frame_id: str, camera_pose: str, camera_axes: str, *, planar: bool = False
) -> Extrinsics:
    """The extrinsics from the parameters of the same names.

    Args:
        frame_id: robot frame whose pose is published; "" for the camera's optical frame.
        camera_pose: pose of the camera in ``frame_id``, read by ``parse_pose``; "" if not given.
        camera_axes: a name in AXES: the camera axes that ``camera_pose`` refers to and, without a
            robot frame, the axes that odom starts with.
        planar: whether the robot stays in a plane.

    Raises:
        InputError: one of ``frame_id`` and ``camera_pose`` is given without the other, ``planar``
            without ``frame_id``, or ``camera_pose`` cannot be read. Extrinsics are never assumed
            to be the identity.
    """
    if planar and not frame_id:
        raise InputError(
            "planar",
            "keeps the robot's frame in its plane, but frame_id, which names it, is not set",
            "set frame_id, for example base_footprint, or leave planar out",
        )
    if not frame_id:
        if camera_pose:
            raise InputError(
                "camera_pose",
                "is the camera's pose in frame_id, which is not set",
                "set frame_id, for example base_link, or leave camera_pose out",
            )
        return Extrinsics.of_camera(camera_axes)
    if not camera_pose:
        raise InputError(
            "camera_pose",
            f"is not set, so the camera's pose in {frame_id!r} is unknown",
            f"give the camera's pose in {frame_id!r} as 'x y z roll pitch yaw' (m, rad), get "
            "it from TF (needs tf2_msgs, which scripts/tf2-msgs of a clone builds if ROS is not "
            "from apt), or leave frame_id empty to publish the camera's own pose",
        )
    T_robot_camera = parse_pose("camera_pose", camera_pose) @ AXES[camera_axes]
    return robot_extrinsics(T_robot_camera, planar=planar)
