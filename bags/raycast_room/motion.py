"""How a hand carries the camera: a loop of smooth, band-limited motion with a tremor on it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rgbd_glue_ros.types import Float64

LOOP_S = 3.5  # the path is closed after this many seconds

# Sines of each coordinate: amplitude, whole cycles in a loop, phase in turns.
_Sines = tuple[tuple[float, int, float], ...]
# metres in the world frame
_X: _Sines = ((0.25, 1, 0.00), (0.03, 3, 0.31), (0.003, 9, 0.12), (0.001, 17, 0.77))
_Y: _Sines = ((0.16, 1, 0.27), (0.04, 2, 0.55), (0.003, 10, 0.48), (0.001, 19, 0.05))
_Z: _Sines = ((0.06, 2, 0.10), (0.015, 3, 0.65), (0.004, 8, 0.93), (0.001, 18, 0.36))
_CENTRE = (0.08, -1.02, 1.36)
# degrees: to the left, up, and clockwise as the camera sees it
_YAW: _Sines = ((9.0, 1, 0.03), (3.5, 2, 0.40), (0.35, 8, 0.22), (0.15, 15, 0.61))
_PITCH: _Sines = ((3.0, 1, 0.38), (2.2, 3, 0.83), (0.35, 9, 0.57), (0.15, 16, 0.19))
_ROLL: _Sines = ((2.5, 1, 0.71), (1.5, 2, 0.14), (0.30, 7, 0.44), (0.12, 14, 0.90))
_LEVEL = -14.0  # mean pitch, degrees


@dataclass(frozen=True)
class Pose:
    """Pose of the camera's optical frame in the world.

    Attributes:
        position: x y z, metres.
        quaternion: x y z w, of unit length to 1e-15.
    """

    position: tuple[float, float, float]
    quaternion: tuple[float, float, float, float]

    @property
    def matrix(self) -> Float64:
        """T_world_camera, [4, 4]."""
        x, y, z, w = self.quaternion
        T = np.eye(4)
        T[0, :3] = 1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)
        T[1, :3] = 2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)
        T[2, :3] = 2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)
        T[:3, 3] = self.position
        return T


def hand_held(time_s: float) -> Pose:
    """Where the camera is at a time."""
    turns = time_s / LOOP_S
    x, y, z = (_sum(sines, turns) for sines in (_X, _Y, _Z))
    yaw, pitch, roll = (_sum(sines, turns) for sines in (_YAW, _PITCH, _ROLL))
    quaternion = _about(2, yaw)
    # level, looking along the world's y
    for step in (_about(0, -90.0), _about(0, _LEVEL + pitch), _about(2, roll)):
        quaternion = _product(quaternion, step)
    length = math.sqrt(sum(q * q for q in quaternion))
    qx, qy, qz, qw = (q / length for q in quaternion)
    position = (_CENTRE[0] + x, _CENTRE[1] + y, _CENTRE[2] + z)
    return Pose(position, (qx, qy, qz, qw))


def _sum(sines: _Sines, turns: float) -> float:
    """Rounded, because sines differ in the last bit between processors."""
    angles = ((size, 2 * math.pi * (cycles * turns + phase)) for size, cycles, phase in sines)
    return round(sum(size * math.sin(angle) for size, angle in angles), 10)


_Quaternion = tuple[float, float, float, float]


def _about(axis: int, degrees: float) -> _Quaternion:
    """The quaternion x y z w of a rotation about a coordinate axis; rounded like ``_sum``."""
    half = math.radians(degrees) / 2
    vector = [0.0, 0.0, 0.0]
    vector[axis] = round(math.sin(half), 12)
    return vector[0], vector[1], vector[2], round(math.cos(half), 12)


def _product(a: _Quaternion, b: _Quaternion) -> _Quaternion:
    ax, ay, az, aw = a
    bx, by, bz, bw = b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )
