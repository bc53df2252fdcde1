"""From map coordinates on a face to points: ``raycaster.surface`` undone, for whole arrays."""

from __future__ import annotations

import numpy as np

from raycast_room.raycaster import CYLINDER, ROOM, SPHERE, Tables
from rgbd_glue_ros.types import Float64

Vectors = tuple[Float64, Float64, Float64]  # their coordinates, each of one shape


def points_on(
    tables: Tables, primitive: int, face: int, u: Float64, v: Float64
) -> tuple[Float64, Float64]:
    """World points [N, 3] and outward normals [N, 3] at map coordinates; undoes ``surface``."""
    hx, hy, hz = tables.half[primitive]
    zero, one = np.zeros_like(u), np.ones_like(u)
    shape = tables.shape[primitive]
    across, up = 2.0 * u - 1.0, 1.0 - 2.0 * v
    if shape == SPHERE:
        normal = octahedral_direction(u, v)
        local = (hx * normal[0], hx * normal[1], hx * normal[2])
    elif shape == CYLINDER and face == 0:
        normal = _around(u)
        local = (hx * normal[0], hx * normal[1], hz * up)
    else:
        sign = 1.0 if face % 2 else -1.0
        if face < 2:
            local, normal = (sign * hx * one, sign * hy * across, hz * up), (sign * one, zero, zero)
        elif face < 4:
            local = (-sign * hx * across, sign * hy * one, hz * up)
            normal = (zero, sign * one, zero)
        else:
            local, normal = (hx * across, hy * up, sign * hz * one), (zero, zero, sign * one)
        if shape == ROOM:
            normal = (-normal[0], -normal[1], -normal[2])
    c, s = tables.turn[primitive]
    points = (c * local[0] - s * local[1], s * local[0] + c * local[1], local[2])
    normals = (c * normal[0] - s * normal[1], s * normal[0] + c * normal[1], normal[2])
    return np.stack(points, axis=-1) + tables.centre[primitive], np.stack(normals, axis=-1)


def octahedral_direction(u: Float64, v: Float64) -> Vectors:
    """Unit vectors at map coordinates in [0, 1] on the octahedron unfolded into a square."""
    x, y = 2.0 * u - 1.0, 2.0 * v - 1.0
    z = 1.0 - np.abs(x) - np.abs(y)
    folded_x = np.where(z < 0, (1.0 - np.abs(y)) * np.where(x < 0, -1.0, 1.0), x)
    folded_y = np.where(z < 0, (1.0 - np.abs(x)) * np.where(y < 0, -1.0, 1.0), y)
    length = np.sqrt(folded_x * folded_x + folded_y * folded_y + z * z)
    return folded_x / length, folded_y / length, z / length


def _around(u: Float64) -> Vectors:
    """Unit vectors across z at map coordinates in [0, 1] around a cylinder."""
    quarter = np.minimum(np.floor(4.0 * u), 3.0)
    f = 4.0 * u - quarter
    x = np.choose(quarter.astype(int), [1.0 - f, -f, f - 1.0, f])
    y = np.choose(quarter.astype(int), [f, 1.0 - f, -f, f - 1.0])
    length = np.sqrt(x * x + y * y)
    return x / length, y / length, np.zeros_like(u)
