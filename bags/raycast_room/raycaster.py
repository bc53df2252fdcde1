"""Rays against a table of primitives, compiled; every operation is one that IEEE 754 fixes.

No fast-math, no transcendental function and no reduction whose order depends on the processor or
on threads, so that the same scene gives the same bits everywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from rgbd_glue_ros.types import Float32, Float64, Int64

ROOM, BOX, SPHERE, CYLINDER = range(4)  # a room is a box seen from the inside; cylinders stand
FACES = 6  # -x +x -y +y -z +z; a sphere has face 0, a cylinder its side 0, bottom 4 and top 5
_FAR = 1e30
_TINY = 1e-12

# a division by zero gives infinity, as in numpy
_compiled = njit(cache=True, nogil=True, error_model="numpy")
# Of what is done for every ray, a third of the time would go into handing over all of the tables.
_inlined = njit(cache=True, nogil=True, error_model="numpy", forceinline=True)


class Tables(NamedTuple):
    """A scene as arrays: P primitives, M materials, K textures, N texels, L lightmap nodes.

    Attributes:
        shape: [P], ROOM, BOX, SPHERE or CYLINDER.
        centre: [P, 3], metres in the world frame (z up).
        half: [P, 3], half extents along the primitive's own axes, metres.
        turn: [P, 2], cosine and sine of its rotation about z.
        bounds: [B, 6], of the nodes of the hierarchy; these three are as ``hierarchy.build`` says.
        skip: [B].
        leaf: [B].
        material: [P, 6], of each face.
        tile: [M], metres after which the texture repeats; 0 stretches it over each face.
        tint: [M, 3], linear RGB factor of the texture.
        emission: [M], irradiance over pi that would make a surface as bright as a lamp is.
        infrared: [M], how much of a structured-light pattern comes back, 0 to 1.
        texture: [M].
        pyramid: [K, 3], first texel, width and height of each texture's finest level.
        texels: [N, 3], linear RGB, all levels of one texture after each other.
        lightmap: [P, 6, 3], first node, nodes along u and along v of each face.
        light: [L, 3], irradiance over pi at each node, linear RGB.
    """

    shape: Int64
    centre: Float64
    half: Float64
    turn: Float64
    bounds: Float64
    skip: Int64
    leaf: Int64
    material: Int64
    tile: Float64
    tint: Float64
    emission: Float64
    infrared: Float64
    texture: Int64
    pyramid: Int64
    texels: Float32
    lightmap: Int64
    light: Float32


@_inlined
def _enter_box(half, o, d):  # type: ignore[no-untyped-def]
    """Where a ray from o along d enters and leaves a box about the origin, and the two faces."""
    near, far, entered, left = -_FAR, _FAR, 0, 0
    for axis in range(3):
        inverse = 1.0 / (d[axis] if abs(d[axis]) > _TINY else _TINY)
        low, high = (-half[axis] - o[axis]) * inverse, (half[axis] - o[axis]) * inverse
        first, second = 2 * axis, 2 * axis + 1
        if low > high:
            low, high = high, low
            first, second = second, first
        if low > near:
            near, entered = low, first
        if high < far:
            far, left = high, second
    return near, far, entered, left


@_inlined
def _enter_sphere(radius, o, d):  # type: ignore[no-untyped-def]
    """Where a ray from o along d enters and leaves a sphere about the origin."""
    a = d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    b = o[0] * d[0] + o[1] * d[1] + o[2] * d[2]
    c = o[0] * o[0] + o[1] * o[1] + o[2] * o[2] - radius * radius
    root = b * b - a * c
    if root <= 0.0:
        return _FAR, -_FAR
    root = np.sqrt(root)
    return (-b - root) / a, (-b + root) / a


@_inlined
def _enter_cylinder(radius, high, o, d):  # type: ignore[no-untyped-def]
    """Where a ray from o along d enters and leaves an upright cylinder, and the face it enters."""
    inverse = 1.0 / (d[2] if abs(d[2]) > _TINY else _TINY)
    near, far, entered = (-high - o[2]) * inverse, (high - o[2]) * inverse, 4
    if near > far:
        near, far, entered = far, near, 5
    a = d[0] * d[0] + d[1] * d[1]
    b = o[0] * d[0] + o[1] * d[1]
    c = o[0] * o[0] + o[1] * o[1] - radius * radius
    root = b * b - a * c
    if root <= 0.0 or a < _TINY * _TINY:
        # beside the cylinder, or straight down its inside
        return (_FAR, -_FAR, 0) if c > 0.0 else (near, far, entered)
    root = np.sqrt(root)
    if (-b - root) / a > near:
        near, entered = (-b - root) / a, 0
    return near, min(far, (-b + root) / a), entered


@_inlined
def _enter_primitive(tables, p, origin, direction):  # type: ignore[no-untyped-def]
    """Where a ray meets a primitive's surface, and the face; ``_FAR`` if it misses."""
    x, y = origin[0] - tables.centre[p, 0], origin[1] - tables.centre[p, 1]
    c, s = tables.turn[p, 0], tables.turn[p, 1]
    o = (c * x + s * y, c * y - s * x, origin[2] - tables.centre[p, 2])
    x, y = direction[0], direction[1]
    d = (c * x + s * y, c * y - s * x, direction[2])
    half = (tables.half[p, 0], tables.half[p, 1], tables.half[p, 2])
    shape, entered = tables.shape[p], 0
    if shape == SPHERE:
        near, far = _enter_sphere(half[0], o, d)
    elif shape == CYLINDER:
        near, far, entered = _enter_cylinder(half[0], half[2], o, d)
    else:
        near, far, entered, left = _enter_box(half, o, d)
        if shape == ROOM:
            return (far, left) if far > 0.0 else (_FAR, 0)
    if near < far and far > 0.0:
        return max(near, 0.0), entered
    return _FAR, 0


@_inlined
def nearest_hit(tables, origin, direction, limit):  # type: ignore[no-untyped-def]
    """The first surface along a ray.

    Args:
        tables: the scene.
        origin: of the ray, three numbers, metres in the world frame.
        direction: three numbers, of any length.
        limit: hits beyond this many lengths of the direction are ignored.

    Returns:
        Lengths of the direction to the hit (``limit`` if nothing is hit, 0 if the origin is
        inside a solid), the primitive (-1 if nothing) and its face.
    """
    best, hit, face = limit, -1, 0
    ox, oy, oz = origin[0], origin[1], origin[2]
    ix = 1.0 / (direction[0] if abs(direction[0]) > _TINY else _TINY)
    iy = 1.0 / (direction[1] if abs(direction[1]) > _TINY else _TINY)
    iz = 1.0 / (direction[2] if abs(direction[2]) > _TINY else _TINY)
    node = 0
    while node < len(tables.skip):
        low, high = tables.bounds[node, :3], tables.bounds[node, 3:]
        x0, x1 = (low[0] - ox) * ix, (high[0] - ox) * ix
        y0, y1 = (low[1] - oy) * iy, (high[1] - oy) * iy
        z0, z1 = (low[2] - oz) * iz, (high[2] - oz) * iz
        near = max(min(x0, x1), min(y0, y1), min(z0, z1))
        far = min(max(x0, x1), max(y0, y1), max(z0, z1))
        if near > far or far < 0.0 or near > best:
            node = tables.skip[node]
            continue
        p = tables.leaf[node]
        if p >= 0:
            distance, entered = _enter_primitive(tables, p, origin, direction)
            if distance < best:
                best, hit, face = distance, p, entered
        node += 1
    return best, hit, face


@_inlined
def _octahedral(x, y, z):  # type: ignore[no-untyped-def]
    """Map coordinates in [0, 1] of a direction, on the octahedron unfolded into a square."""
    length = abs(x) + abs(y) + abs(z)
    u, v = x / length, y / length
    if z < 0.0:
        folded = (1.0 - abs(v)) * (-1.0 if u < 0.0 else 1.0)
        v = (1.0 - abs(u)) * (-1.0 if v < 0.0 else 1.0)
        u = folded
    return 0.5 * (u + 1.0), 0.5 * (v + 1.0)


@_inlined
def _around(x, y):  # type: ignore[no-untyped-def]
    """A turn about z in [0, 1), measured along the square |x| + |y| = 1 in place of the circle."""
    length = abs(x) + abs(y)
    if y >= 0.0:
        return 0.25 * (y / length if x >= 0.0 else 1.0 - x / length)
    return 0.25 * (2.0 - y / length if x < 0.0 else 3.0 + x / length)


@_inlined
def surface(tables, p, face, point):  # type: ignore[no-untyped-def]
    """Where on a primitive's face a world point lies.

    Returns:
        Map coordinates u, v in [0, 1] (v downwards on upright faces), the face's size along u
        and v in metres, and the outward normal in the world frame.
    """
    x, y = point[0] - tables.centre[p, 0], point[1] - tables.centre[p, 1]
    z = point[2] - tables.centre[p, 2]
    c, s = tables.turn[p, 0], tables.turn[p, 1]
    x, y = c * x + s * y, c * y - s * x
    hx, hy, hz = tables.half[p, 0], tables.half[p, 1], tables.half[p, 2]
    shape = tables.shape[p]
    nx, ny, nz = 0.0, 0.0, 0.0
    if shape == SPHERE:
        u, v = _octahedral(x, y, z)
        wide, tall = 4.0 * hx, 4.0 * hx
        nx, ny, nz = x / hx, y / hx, z / hx
    elif shape == CYLINDER and face == 0:
        u, v = _around(x, y), 0.5 * (hz - z) / hz
        wide, tall = 6.2832 * hx, 2.0 * hz
        nx, ny = x / hx, y / hx
    elif face < 2:
        u, v = 0.5 * (hy + y) / hy, 0.5 * (hz - z) / hz
        wide, tall = 2.0 * hy, 2.0 * hz
        nx = 2.0 * face - 1.0
        if face == 0:
            u = 1.0 - u
    elif face < 4:
        u, v = 0.5 * (hx + x) / hx, 0.5 * (hz - z) / hz
        wide, tall = 2.0 * hx, 2.0 * hz
        ny = 2.0 * face - 5.0
        if face == 3:
            u = 1.0 - u
    else:
        u, v = 0.5 * (hx + x) / hx, 0.5 * (hy - y) / hy
        wide, tall = 2.0 * hx, 2.0 * hy
        nz = 2.0 * face - 9.0
    if shape == ROOM:
        nx, ny, nz = -nx, -ny, -nz
    return u, v, wide, tall, c * nx - s * ny, c * ny + s * nx, nz


@_inlined
def light_at(tables, p, face, u, v, out):  # type: ignore[no-untyped-def]
    """Irradiance over pi at map coordinates u, v: bilinear between lightmap nodes, into out [3]."""
    first, across, down = tables.lightmap[p, face]
    x = min(max(u, 0.0), 1.0) * (across - 1)
    y = min(max(v, 0.0), 1.0) * (down - 1)
    i, j = min(int(x), across - 2), min(int(y), down - 2)
    fx, fy = x - i, y - j
    node = first + j * across + i
    for k in range(3):
        top = tables.light[node, k] * (1.0 - fx) + tables.light[node + 1, k] * fx
        node_below = node + across
        bottom = tables.light[node_below, k] * (1.0 - fx) + tables.light[node_below + 1, k] * fx
        out[k] = top * (1.0 - fy) + bottom * fy


@_inlined
def _add_level(texels, size, uv, repeat, weight, out):  # type: ignore[no-untyped-def]
    """Adds ``weight`` times one level of a texture, [size y x size x, 3], at uv to out [3]."""
    wide, tall = size
    x, y = uv[0] * wide - 0.5, uv[1] * tall - 0.5
    fi, fj = np.floor(x), np.floor(y)
    fx, fy = x - fi, y - fj
    i, j = int(fi), int(fj)
    if repeat:
        i, j, right, below = i % wide, j % tall, (i + 1) % wide, (j + 1) % tall
    else:
        right, below = min(max(i + 1, 0), wide - 1), min(max(j + 1, 0), tall - 1)
        i, j = min(max(i, 0), wide - 1), min(max(j, 0), tall - 1)
    upper, lower = j * wide, below * wide
    for k in range(3):
        top = texels[upper + i, k] * (1.0 - fx) + texels[upper + right, k] * fx
        bottom = texels[lower + i, k] * (1.0 - fx) + texels[lower + right, k] * fx
        out[k] += weight * (top * (1.0 - fy) + bottom * fy)


@_inlined
def albedo_at(tables, material, u, v, wide, tall, footprint, out):  # type: ignore[no-untyped-def]
    """Colour of a surface, linear RGB into out [3], averaged over ``footprint`` metres."""
    texture = tables.texture[material]
    first, across, down = tables.pyramid[texture]
    tile = tables.tile[material]
    repeat = tile > 0.0
    if repeat:
        u, v = u * wide / tile, v * tall / tile
        texel = tile / across
    else:
        texel = max(wide / across, tall / down)
    ratio = footprint / texel
    while ratio >= 2.0 and (across > 1 or down > 1):
        first += across * down
        across, down = max(across // 2, 1), max(down // 2, 1)
        ratio *= 0.5
    out[:] = 0.0
    coarse = min(max(ratio - 1.0, 0.0), 1.0) if across > 1 or down > 1 else 0.0
    _add_level(tables.texels[first:], (across, down), (u, v), repeat, 1.0 - coarse, out)
    if coarse > 0.0:
        first += across * down
        across, down = max(across // 2, 1), max(down // 2, 1)
        _add_level(tables.texels[first:], (across, down), (u, v), repeat, coarse, out)
    for k in range(3):
        out[k] *= tables.tint[material, k]


@_compiled
def cast_color(tables, poses, offsets, camera, image):  # type: ignore[no-untyped-def]
    """Averages sub-exposures of the scene into image float32 [H, W, 3], linear RGB.

    Args:
        tables: the scene.
        poses: T_world_camera of each sub-exposure, [S, 4, 4].
        offsets: position within the pixel of each sub-exposure's ray, [S, 2], pixels.
        camera: fx, fy, cx, cy, pixels.
        image: the result.
    """
    height, width = image.shape[:2]
    fx, fy, cx, cy = camera
    albedo, light = np.empty(3), np.empty(3)
    share = 1.0 / len(poses)
    for row in range(height):
        for column in range(width):
            red, green, blue = 0.0, 0.0, 0.0
            for sample in range(len(poses)):
                T = poses[sample]
                x = (column + offsets[sample, 0] - cx) / fx
                y = (row + offsets[sample, 1] - cy) / fy
                origin = (T[0, 3], T[1, 3], T[2, 3])
                dx = T[0, 0] * x + T[0, 1] * y + T[0, 2]
                dy = T[1, 0] * x + T[1, 1] * y + T[1, 2]
                dz = T[2, 0] * x + T[2, 1] * y + T[2, 2]
                depth, p, face = nearest_hit(tables, origin, (dx, dy, dz), _FAR)
                if p < 0:
                    continue
                point = (
                    origin[0] + depth * dx,
                    origin[1] + depth * dy,
                    origin[2] + depth * dz,
                )
                u, v, wide, tall, nx, ny, nz = surface(tables, p, face, point)
                material = tables.material[p, face]
                length = np.sqrt(dx * dx + dy * dy + dz * dz)
                cosine = abs(nx * dx + ny * dy + nz * dz) / length
                # a footprint between the short and the long side of the pixel's ellipse
                footprint = depth / fx / np.sqrt(max(cosine, 0.05))
                albedo_at(tables, material, u, v, wide, tall, 0.8 * footprint, albedo)
                light_at(tables, p, face, u, v, light)
                glow = tables.emission[material]
                red += albedo[0] * (light[0] + glow)
                green += albedo[1] * (light[1] + glow)
                blue += albedo[2] * (light[2] + glow)
            image[row, column, 0] = red * share
            image[row, column, 1] = green * share
            image[row, column, 2] = blue * share


@_compiled
def cast_depth(tables, T, projector, camera, depth, echo):  # type: ignore[no-untyped-def]
    """Depth along the optical axis at every pixel centre, and how well a projector lights it.

    Args:
        tables: the scene.
        T: T_world_camera, [4, 4].
        projector: its position in the world frame, [3].
        camera: fx, fy, cx, cy, pixels.
        depth: the result, float64 [H, W], metres.
        echo: the result, float64 [H, W]: infrared reflectivity x cosine of incidence / z^2, and
            0 where the projector does not see the surface.
    """
    height, width = depth.shape
    fx, fy, cx, cy = camera
    origin = (T[0, 3], T[1, 3], T[2, 3])
    for row in range(height):
        for column in range(width):
            x, y = (column - cx) / fx, (row - cy) / fy
            dx = T[0, 0] * x + T[0, 1] * y + T[0, 2]
            dy = T[1, 0] * x + T[1, 1] * y + T[1, 2]
            dz = T[2, 0] * x + T[2, 1] * y + T[2, 2]
            z, p, face = nearest_hit(tables, origin, (dx, dy, dz), _FAR)
            depth[row, column], echo[row, column] = z, 0.0
            if p < 0:
                continue
            wx, wy, wz = origin[0] + z * dx, origin[1] + z * dy, origin[2] + z * dz
            nx, ny, nz = surface(tables, p, face, (wx, wy, wz))[4:]
            sx, sy, sz = wx - projector[0], wy - projector[1], wz - projector[2]
            distance = np.sqrt(sx * sx + sy * sy + sz * sz)
            cosine = -(nx * sx + ny * sy + nz * sz) / distance
            if cosine <= 0.0:
                continue
            # the ray stops short of the surface itself
            blocked = nearest_hit(tables, projector, (sx, sy, sz), 1.0 - 2e-3)[1] >= 0
            if not blocked:
                strength = tables.infrared[tables.material[p, face]]
                echo[row, column] = strength * cosine / (z * z)


@_compiled
def gather_light(tables, points, normals, lamps, directions, bounced, out):  # type: ignore[no-untyped-def]
    """Irradiance over pi at points [N, 3] with normals [N, 3], into out float32 [N, 3].

    Args:
        tables: the scene; its light is what surfaces send on when ``bounced``.
        points: just off the surfaces, metres.
        normals: unit vectors.
        lamps: samples of the area lights [Q, 9]: position, outward normal, linear RGB power.
        directions: cosine-distributed on the hemisphere about z, [D, 3].
        bounced: whether light reflected by other surfaces is added to that of the lamps.
        out: the result.
    """
    albedo, light = np.empty(3), np.empty(3)
    for n in range(len(points)):
        origin = (points[n, 0], points[n, 1], points[n, 2])
        nx, ny, nz = normals[n, 0], normals[n, 1], normals[n, 2]
        red, green, blue = 0.0, 0.0, 0.0
        for q in range(len(lamps)):
            dx, dy = lamps[q, 0] - origin[0], lamps[q, 1] - origin[1]
            dz = lamps[q, 2] - origin[2]
            square = dx * dx + dy * dy + dz * dz
            here = nx * dx + ny * dy + nz * dz
            there = -(lamps[q, 3] * dx + lamps[q, 4] * dy + lamps[q, 5] * dz)
            if here <= 0.0 or there <= 0.0:
                continue
            if nearest_hit(tables, origin, (dx, dy, dz), 0.999)[1] >= 0:
                continue
            # cos cos / r^2, held finite for a point that touches a lamp
            share = here * there / (square * max(square, 0.01))
            red += share * lamps[q, 6]
            green += share * lamps[q, 7]
            blue += share * lamps[q, 8]
        if bounced:
            # any tangent frame about the normal
            if abs(nz) < 0.9:
                tx, ty, tz = -ny, nx, 0.0
            else:
                tx, ty, tz = nz, 0.0, -nx
            length = np.sqrt(tx * tx + ty * ty + tz * tz)
            tx, ty, tz = tx / length, ty / length, tz / length
            bx, by, bz = ny * tz - nz * ty, nz * tx - nx * tz, nx * ty - ny * tx
            weight = 1.0 / len(directions)
            for d in range(len(directions)):
                i, j, k = directions[d, 0], directions[d, 1], directions[d, 2]
                dx, dy = i * tx + j * bx + k * nx, i * ty + j * by + k * ny
                dz = i * tz + j * bz + k * nz
                t, p, face = nearest_hit(tables, origin, (dx, dy, dz), _FAR)
                if p < 0 or t <= 0.0:
                    continue
                point = (origin[0] + t * dx, origin[1] + t * dy, origin[2] + t * dz)
                u, v, wide, tall = surface(tables, p, face, point)[:4]
                albedo_at(tables, tables.material[p, face], u, v, wide, tall, 1e3, albedo)
                light_at(tables, p, face, u, v, light)
                red += weight * albedo[0] * light[0]
                green += weight * albedo[1] * light[1]
                blue += weight * albedo[2] * light[2]
        out[n, 0], out[n, 1], out[n, 2] = red, green, blue
