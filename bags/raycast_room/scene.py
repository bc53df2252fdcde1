"""A scene: primitives with materials, packed into the arrays that rays are cast against."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from raycast_room import hierarchy
from raycast_room.raycaster import BOX, CYLINDER, FACES, ROOM, SPHERE, Tables
from rgbd_glue_ros.types import Float32, Float64, Int64, UInt8

NODE_SPACING = 0.06  # of lightmap nodes, metres
_ROUND_NODES = 17  # along each side of a sphere's map, and around a cylinder


def linear_from_srgb(value: float) -> float:
    """Linear light of an sRGB value, both in [0, 1] (IEC 61966-2-1)."""
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


# rounded, because powers differ in the last bit between processors
_LINEAR = np.array([round(linear_from_srgb(i / 255), 7) for i in range(256)], np.float32)


@dataclass(frozen=True)
class Material:
    """How a surface looks.

    Attributes:
        texture: sRGB image [H, W, 3] with sides that are powers of two.
        tint: sRGB colour that the texture is multiplied with.
        tile: metres after which the texture repeats; 0 stretches it over each face.
        emission: light of the texture's colour that a lamp sends out, 1 for the image's white.
        infrared: how much of a structured-light pattern comes back, 0 to 1.
    """

    texture: UInt8
    tint: tuple[int, int, int] = (255, 255, 255)
    tile: float = 0.0
    emission: float = 0.0
    infrared: float = 1.0


@dataclass(frozen=True)
class Primitive:
    """A solid, or the room itself.

    Attributes:
        shape: ROOM, BOX, SPHERE or CYLINDER of ``raycaster``.
        centre: in the world frame, metres.
        half: half extents along its own axes, metres; a sphere's and a cylinder's radius twice.
        materials: one for all faces, or one for each: -x +x -y +y -z +z.
        yaw: rotation about z, degrees.
    """

    shape: int
    centre: tuple[float, float, float]
    half: tuple[float, float, float]
    materials: tuple[Material, ...]
    yaw: float = 0.0


def box(
    centre: tuple[float, float, float],
    size: tuple[float, float, float],
    *materials: Material,
    yaw: float = 0.0,
) -> Primitive:
    """A box; ``centre`` is that of its bottom face, so that things stand on things."""
    x, y, z = centre
    half = (size[0] / 2, size[1] / 2, size[2] / 2)
    return Primitive(BOX, (x, y, z + half[2]), half, materials, yaw)


def cylinder(
    centre: tuple[float, float, float], radius: float, height: float, *materials: Material
) -> Primitive:
    """An upright cylinder; ``centre`` is that of its bottom face."""
    x, y, z = centre
    half = (radius, radius, height / 2)
    return Primitive(CYLINDER, (x, y, z + height / 2), half, materials)


def sphere(centre: tuple[float, float, float], radius: float, material: Material) -> Primitive:
    """A sphere."""
    return Primitive(SPHERE, centre, (radius, radius, radius), (material,))


def room(
    low: tuple[float, float, float], high: tuple[float, float, float], *materials: Material
) -> Primitive:
    """Walls, floor and ceiling: a box seen from the inside, from corner to corner."""
    centre = [(a + b) / 2 for a, b in zip(low, high, strict=True)]
    half = [(b - a) / 2 for a, b in zip(low, high, strict=True)]
    return Primitive(
        ROOM, (centre[0], centre[1], centre[2]), (half[0], half[1], half[2]), materials
    )


def pack(primitives: list[Primitive]) -> Tables:
    """The primitives as arrays, not yet lit: every lightmap node is 1."""
    materials: dict[int, Material] = {}
    rows: dict[int, int] = {}
    material = np.empty((len(primitives), FACES), np.int64)
    for index, primitive in enumerate(primitives):
        faces = primitive.materials * (FACES if len(primitive.materials) == 1 else 1)
        for face, item in enumerate(faces):
            rows.setdefault(id(item), len(rows))
            materials.setdefault(id(item), item)
            material[index, face] = rows[id(item)]
    ordered = list(materials.values())
    texture, pyramid, texels = _pack_textures([item.texture for item in ordered])
    lightmap, nodes = _lay_out_lightmaps(primitives)
    turn = _turns(primitives)
    centre = np.array([p.centre for p in primitives], np.float64)
    half = np.array([p.half for p in primitives], np.float64)
    reach = _reach(half, turn)
    bounds, skip, leaf = hierarchy.build(centre - reach, centre + reach)
    return Tables(
        shape=np.array([p.shape for p in primitives], np.int64),
        centre=centre,
        half=half,
        turn=turn,
        bounds=bounds,
        skip=skip,
        leaf=leaf,
        material=material,
        tile=np.array([item.tile for item in ordered], np.float64),
        tint=_LINEAR[np.array([item.tint for item in ordered])].astype(np.float64),
        emission=np.array([item.emission for item in ordered], np.float64),
        infrared=np.array([item.infrared for item in ordered], np.float64),
        texture=texture,
        pyramid=pyramid,
        texels=texels,
        lightmap=lightmap,
        light=np.ones((nodes, 3), np.float32),
    )


def _turns(primitives: list[Primitive]) -> Float64:
    """Cosine and sine of each yaw, [P, 2]."""
    angles = [math.radians(primitive.yaw) for primitive in primitives]
    # rounded, because sines differ in the last bit between processors
    return np.array([(round(math.cos(a), 12), round(math.sin(a), 12)) for a in angles])


def _reach(half: Float64, turn: Float64) -> Float64:
    """Half extents along the world's axes, [P, 3]; a little more, so that no rounding cuts."""
    c, s = np.abs(turn.T)
    x, y, z = half.T
    return np.column_stack([c * x + s * y, s * x + c * y, z]) + 1e-6


def _pack_textures(images: list[UInt8]) -> tuple[Int64, Int64, Float32]:
    """Index of each image's texture [M], and the table and texels of the distinct ones."""
    rows: dict[int, int] = {}
    pyramid: list[tuple[int, int, int]] = []
    levels: list[Float32] = []
    count = 0
    for image in images:
        if id(image) in rows:
            continue
        rows[id(image)] = len(rows)
        level = _LINEAR[image]
        pyramid.append((count, level.shape[1], level.shape[0]))
        while True:
            levels.append(level.reshape(-1, 3))
            count += len(levels[-1])
            if level.shape[:2] == (1, 1):
                break
            level = _halved(level)
    texture = np.array([rows[id(image)] for image in images], np.int64)
    return texture, np.array(pyramid, np.int64), np.concatenate(levels)


def _halved(image: Float32) -> Float32:
    """The image at half size along each side that is longer than 1."""
    if image.shape[0] > 1:
        image = (image[0::2] + image[1::2]) * np.float32(0.5)
    if image.shape[1] > 1:
        image = (image[:, 0::2] + image[:, 1::2]) * np.float32(0.5)
    return image


def _lay_out_lightmaps(primitives: list[Primitive]) -> tuple[Int64, int]:
    """First node and node counts of each face [P, 6, 3], and the number of nodes."""
    table = np.zeros((len(primitives), FACES, 3), np.int64)
    count = 0
    for index, primitive in enumerate(primitives):
        for face in faces_of(primitive.shape):
            across, down = _node_counts(primitive, face)
            table[index, face] = count, across, down
            count += across * down
    return table, count


def faces_of(shape: int) -> tuple[int, ...]:
    """The faces that a shape has."""
    if shape == SPHERE:
        return (0,)
    return (0, 4, 5) if shape == CYLINDER else tuple(range(FACES))


def _node_counts(primitive: Primitive, face: int) -> tuple[int, int]:
    across, down = (max(2, math.ceil(side / NODE_SPACING) + 1) for side in _sides(primitive, face))
    if primitive.shape == SPHERE:
        return _ROUND_NODES, _ROUND_NODES
    if primitive.shape == CYLINDER and face == 0:
        return _ROUND_NODES, down
    return across, down


def _sides(primitive: Primitive, face: int) -> tuple[float, float]:
    """Size of a flat face along u and v, metres."""
    hx, hy, hz = primitive.half
    if face >= 4:
        return 2 * hx, 2 * hy
    return (2 * hy, 2 * hz) if face < 2 else (2 * hx, 2 * hz)
