"""Rigid transforms as float64 matrices [4, 4]; quaternions x y z w; twists (v, omega)."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from rgbd_glue_ros.compiled import compiled
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


@compiled
def quaternion(T: Float64) -> Float64:
    """The rotation of T as a unit quaternion x y z w with w >= 0, shape [4] (Shepperd 1978)."""
    # four times the squares of x, y, z and w; the largest is the divisor
    trace = T[0, 0] + T[1, 1] + T[2, 2]
    squares = 1.0 - trace + 2.0 * np.array([T[0, 0], T[1, 1], T[2, 2], trace])
    q = np.empty(4)
    a = np.argmax(squares)
    b, c = (a + 1) % 3, (a + 2) % 3
    if a == 3:
        q[:] = T[2, 1] - T[1, 2], T[0, 2] - T[2, 0], T[1, 0] - T[0, 1], squares[3]
    else:
        q[a], q[b], q[c] = squares[a], T[a, b] + T[b, a], T[a, c] + T[c, a]
        q[3] = T[c, b] - T[b, c]
    q /= math.sqrt((q * q).sum())
    return -q if q[3] < 0 else q


def inverse(T: Float64) -> Float64:
    """The inverse of T [..., 4, 4], exact in the rotation."""
    R_t = np.swapaxes(T[..., :3, :3], -1, -2)
    inverted = np.zeros_like(T)
    inverted[..., :3, :3] = R_t
    inverted[..., :3, 3] = -np.einsum("...ij,...j->...i", R_t, T[..., :3, 3])
    inverted[..., 3, 3] = 1.0
    return inverted


def with_nearest_rotation(T: Float64) -> Float64:
    """T [4, 4] with the rotation nearest to its matrix, by singular values (Arun et al. 1987)."""
    U, _, Vt = np.linalg.svd(T[:3, :3])
    return from_rotation_translation(np.asarray(U @ Vt, np.float64), T[:3, 3])


def transform(T: Float64, points: Float64) -> Float64:
    """T applied to points [N, 3]."""
    moved: Float64 = points @ T[:3, :3].T + T[:3, 3]
    return moved


def skew(v: Float64) -> Float64:
    """The cross-product matrix [3, 3] of v: ``skew(v) @ u == cross(v, u)``."""
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]], np.float64)


@compiled
def exp(twist: Float64) -> Float64:
    """The exponential map of a twist (v, omega) [6]: its motion in unit time."""
    W = np.zeros((3, 3))
    W[0, 1], W[0, 2], W[1, 2] = -twist[5], twist[4], -twist[3]
    W -= W.T
    W_squared = W @ W
    squared = twist[3] ** 2 + twist[4] ** 2 + twist[5] ** 2
    if squared < 1e-10:
        # Taylor series: the closed forms divide by the angle cubed
        sine, cosine, third = 1.0 - squared / 6, 0.5 - squared / 24, 1.0 / 6 - squared / 120
    else:
        theta = math.sqrt(squared)
        sine, cosine = math.sin(theta) / theta, (1.0 - math.cos(theta)) / squared
        third = (1.0 - sine) / squared
    T = np.eye(4)
    T[:3, :3] += sine * W + cosine * W_squared
    v = twist[:3].astype(np.float64)
    T[:3, 3] = v + (cosine * W + third * W_squared) @ v
    return T


@compiled
def rotation_vector(T: Float64) -> Float64:
    """The axis of T's rotation times its angle, radians in [0, pi]; float64 [3]."""
    q = quaternion(T)
    sine = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    return q[:3] * (2.0 * math.atan2(sine, q[3]) / sine) if sine > 0.0 else np.zeros(3)


def log(T: Float64) -> Float64:
    """The twist (v, omega) [6] with exp(twist) == T; the rotation angle is at most pi."""
    omega = rotation_vector(T)
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


def transported_covariance(T_a_b: Float64, covariance: Float64) -> Float64:
    """The covariance in frame a of a perturbation that is known in frame b.

    Args:
        T_a_b: float64 [4, 4].
        covariance: float64 [6, 6] of a perturbation exp(xi) on the left of poses in frame b.

    Returns:
        float64 [6, 6], of the perturbation on the left of the same poses in frame a.
    """
    A = adjoint(T_a_b)
    transported: Float64 = A @ covariance @ A.T
    return transported


def pose_covariance(T: Float64, covariance: Float64) -> Float64:
    """Covariance of T's position and of its rotation about the fixed axes, as in nav_msgs.

    Args:
        T: float64 [4, 4].
        covariance: float64 [6, 6] of a perturbation exp(xi) T on the left, which rotates T about
            the origin of the fixed frame.

    Returns:
        float64 [6, 6], order x y z rx ry rz, with rotations about T's own position.
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


def largest_sigmas(covariance: Float64) -> tuple[float, float]:
    """The standard deviations along the most uncertain direction and about such an axis.

    Args:
        covariance: float64 [6, 6] of a pose, x y z rx ry rz (m², rad²).
    """
    position, rotation = (
        float(np.sqrt(np.linalg.eigvalsh(covariance[rows, rows])[-1].clip(0)))
        for rows in (slice(0, 3), slice(3, 6))
    )
    return position, rotation


def rotation_angle(T: Float64) -> float:
    """The angle of T's rotation, radians in [0, pi]."""
    return float(np.linalg.norm(rotation_vector(T)))


def difference(a: Float64, b: Float64) -> float:
    """How different two views of a room are: metres plus radians, since rooms are metres wide."""
    T = inverse(a) @ b
    return float(np.linalg.norm(T[:3, 3])) + rotation_angle(T)


def differences(poses: Float64, T: Float64) -> Float64:
    """The ``difference`` between each of ``poses`` [N, 4, 4] and one [4, 4], float64 [N]."""
    apart = inverse(poses) @ T
    R = apart[:, :3, :3]
    sine = np.linalg.norm(R - np.swapaxes(R, 1, 2), axis=(1, 2)) / np.sqrt(8.0)
    cosine = (np.trace(R, axis1=1, axis2=2) - 1) / 2
    metres = np.linalg.norm(apart[:, :3, 3], axis=1)
    return np.asarray(metres + np.arctan2(sine, cosine), np.float64)
