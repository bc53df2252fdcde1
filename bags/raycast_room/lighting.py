"""Lights a scene once: lamps with soft shadows and two bounces, into lightmaps."""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from raycast_room.maps import points_on
from raycast_room.raycaster import ROOM, Tables, gather_light
from raycast_room.scene import faces_of
from rgbd_glue_ros.types import Float32, Float64

BOUNCES = 2
_DIRECTIONS = 64
_LAMP_GRID = 5  # samples along each side of a lamp
_OFF_SURFACE = 1e-4  # metres
_INSET = 2e-3  # metres that the outermost nodes keep from the edge of a wall
_CHUNK = 2000


def lit(tables: Tables) -> Tables:
    """The scene with its lightmaps filled."""
    points, normals = _nodes(tables)
    lamps = _lamp_samples(tables)
    directions = _hemisphere(_DIRECTIONS)
    dark = np.zeros((len(points), 3), np.float32)
    light = _gather(tables._replace(light=dark), points, normals, lamps, directions, bounced=False)
    direct = light
    for _ in range(BOUNCES):
        scene = tables._replace(light=light)
        light = direct + _gather(scene, points, normals, lamps[:0], directions, bounced=True)
    return tables._replace(light=light)


def _gather(
    tables: Tables,
    points: Float64,
    normals: Float64,
    lamps: Float64,
    directions: Float64,
    *,
    bounced: bool,
) -> Float32:
    out = np.empty((len(points), 3), np.float32)

    def work(start: int) -> None:
        rows = slice(start, start + _CHUNK)
        gather_light(tables, points[rows], normals[rows], lamps, directions, bounced, out[rows])

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        list(pool.map(work, range(0, len(points), _CHUNK)))
    return out


def _nodes(tables: Tables) -> tuple[Float64, Float64]:
    """Positions just off the surface and normals of all lightmap nodes, [L, 3] each."""
    positions, normals = np.empty((len(tables.light), 3)), np.empty((len(tables.light), 3))
    for primitive, shape in enumerate(tables.shape):
        for face in faces_of(int(shape)):
            first, across, down = tables.lightmap[primitive, face]
            v, u = np.mgrid[0:down, 0:across]
            rows = slice(first, first + across * down)
            points, normal = points_on(
                tables, primitive, face, u.ravel() / (across - 1.0), v.ravel() / (down - 1.0)
            )
            positions[rows] = points + normal * _OFF_SURFACE
            if shape == ROOM:
                inward = tables.centre[primitive] - points
                positions[rows] += np.clip(inward, -_INSET, _INSET) * (normal == 0.0)
            normals[rows] = normal
    return positions, normals


def _lamp_samples(tables: Tables) -> Float64:
    """Points on all glowing faces, [Q, 9]: position, normal, linear RGB power over pi."""
    samples = []
    grid = (np.arange(_LAMP_GRID) + 0.5) / _LAMP_GRID
    u, v = np.tile(grid, _LAMP_GRID), np.repeat(grid, _LAMP_GRID)
    for primitive, shape in enumerate(tables.shape):
        for face in faces_of(int(shape)):
            material = tables.material[primitive, face]
            if tables.emission[material] <= 0.0:
                continue
            points, normals = points_on(tables, primitive, face, u, v)
            corners, _ = points_on(
                tables, primitive, face, np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
            )
            across, down = corners[1] - corners[0], corners[2] - corners[0]
            area = np.sqrt((across * across).sum() * (down * down).sum())
            power = tables.emission[material] * area / (len(u) * math.pi)
            colour = np.broadcast_to(tables.tint[material] * power, (len(u), 3))
            samples.append(np.concatenate([points, normals, colour], axis=1))
    return np.concatenate(samples) if samples else np.empty((0, 9))


def _hemisphere(count: int) -> Float64:
    """Directions about z with density proportional to their cosine, [count, 3]."""
    # points even in the disc, lifted onto the hemisphere; whole numbers drawn, so the same anywhere
    drawn = np.random.default_rng(7).integers(-(1 << 20), 1 << 20, (4 * count, 2)) / (1 << 20)
    square = drawn[:, 0] * drawn[:, 0] + drawn[:, 1] * drawn[:, 1]
    disc = drawn[square < 1.0][:count]
    height = np.sqrt(1.0 - disc[:, 0] * disc[:, 0] - disc[:, 1] * disc[:, 1])
    return np.column_stack([disc, height])
