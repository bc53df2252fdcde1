"""Rigid transforms as float64 matrices [4, 4]; quaternions x y z w; twists (v, omega)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from rgbd_glue_ros.types import Float64


def from_rotation_translation(R: Float64, t: Float64) -> Float64:
    """The transform x -> R x + t, from R [3, 3] and t [3]."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = t
    return T


def from_translation_quaternion(t: Float64, q: Float64) -> Float64:
    """The transform with translation t [3] and quaternion q [4] (x y z w, any length but 0)."""
    return from_rotation_translation(Rotation.from_quat(q).as_matrix(), t)


def quaternion(T: Float64) -> Float64:
    """The rotation of T as a unit quaternion x y z w with w >= 0, shape [4]."""
    q = np.asarray(Rotation.from_matrix(T[:3, :3]).as_quat(), np.float64)
    return -q if q[3] < 0 else q


def inverse(T: Float64) -> Float64:
    """The inverse of T [..., 4, 4], exact in the rotation."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    inverted = np.zeros_like(T)
    inverted[..., :3, :3] = R_t
    inverted[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T[..., :3, 3])
    inverted[..., 3, 3] = 1.0
    return inverted


def transform(T: Float64, points: Float64) -> Float64:
    """T applied to points [N, 3]."""
    moved: Float64 = points @ T[:3, :3].T + T[:3, 3]
    return moved


def skew(v: Float64) -> Float64:
    """The cross-product matrix [3, 3] of v: ``skew(v) @ u == cross(v, u)``."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]], np.float64)


def exp(twist: Float64) -> Float64:
    """The exponential map of a twist (v, omega) [6]: the motion it makes in unit time."""
    v, omega = twist[:3], twist[3:]
    theta = float(np.linalg.norm(omega))
    W = skew(omega)
    if theta < 1e-5:
        # Taylor series: the closed form divides by theta squared
        V = np.eye(3) + W / 2 + W @ W / 6
    else:
        V = (
            np.eye(3)
            + (1 - np.cos(theta)) / theta**2 * W
            + (theta - np.sin(theta)) / theta**3 * W @ W
        )
    return from_rotation_translation(Rotation.from_rotvec(omega).as_matrix(), V @ v)


def log(T: Float64) -> Float64:
    """The twist (v, omega) [6] with exp(twist) == T; the rotation angle is at most pi."""
    omega = np.asarray(Rotation.from_matrix(T[:3, :3]).as_rotvec(), np.float64)
    theta = float(np.linalg.norm(omega))
    W = skew(omega)
    if theta < 1e-5:
        V_inverse = np.eye(3) - W / 2 + W @ W / 12
    else:
        half = theta / 2
        V_inverse = np.eye(3) - W / 2 + (1 - half / np.tan(half)) / theta**2 * W @ W
    return np.concatenate([V_inverse @ T[:3, 3], omega])


def adjoint(T: Float64) -> Float64:
    """The matrix [6, 6] that maps a twist (v, omega) from T's source frame to its target frame."""
    R, t = T[:3, :3], T[:3, 3]
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = R
    A[:3, 3:] = skew(t) @ R
    return A


def pose_covariance(T: Float64, covariance: Float64) -> Float64:
    """Covariance of T's position and of its rotation about the fixed axes, as in nav_msgs.

    Args:
        T: float64 [4, 4].
        covariance: float64 [6, 6] of a perturbation exp(xi) T on the left, which turns T about
            the origin of the fixed frame.

    Returns:
        float64 [6, 6], order x y z rx ry rz, where rotations turn about T's own position.
    """
    A = np.eye(6)
    A[:3, 3:] = -skew(T[:3, 3])
    moved: Float64 = A @ covariance @ A.T
    return moved


def perturbation_covariance(T: Float64, covariance: Float64) -> Float64:
    """The inverse of ``pose_covariance``: of a perturbation exp(xi) T on the left, [6, 6]."""
    A = np.eye(6)
    A[:3, 3:] = skew(T[:3, 3])
    moved: Float64 = A @ covariance @ A.T
    return moved


def rotation_angle(T: Float64) -> float:
    """The angle of T's rotation, radians in [0, pi]."""
    return float(np.linalg.norm(Rotation.from_matrix(T[:3, :3]).as_rotvec()))
