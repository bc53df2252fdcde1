"""The furnished room of the bundled bag. World frame: z up, floor at 0, metres."""

from __future__ import annotations

from functools import cache

import numpy as np

from raycast_room import textures
from raycast_room.lighting import lit
from raycast_room.raycaster import Tables
from raycast_room.scene import Material, Primitive, box, cylinder, pack, room, sphere

_PLAIN = textures.plain()
_WHITE = Material(_PLAIN, (238, 236, 230))
_DARK_WOOD = Material(textures.wood(), (150, 118, 96), 0.8)
_OAK = Material(textures.wood(), (255, 236, 214), 0.9)
_PAGES = Material(textures.pages(), tile=0.1)
_BRASS = Material(_PLAIN, (176, 140, 78), infrared=0.5)
# black gloss sends next to no pattern back: a hole in the depth image
_GLOSS = Material(_PLAIN, (26, 26, 30), infrared=0.03)


@cache
def living_room() -> Tables:
    """The room, lit; made once and then kept."""
    return lit(
        pack([*_shell(), *_bookcase(), *_table(), *_table_top(), *_drawers(), *_on_the_floor()])
    )


def _shell() -> list[Primitive]:
    bricks = Material(textures.bricks(), tile=1.1)
    wall = Material(textures.plaster(), (222, 214, 198), tile=1.5)
    sage = Material(textures.plaster(), (176, 190, 172), tile=1.5)
    floor = Material(textures.planks(), tile=1.4)
    ceiling = Material(_PLAIN, (240, 240, 236))
    daylight = Material(_PLAIN, (226, 238, 255), emission=16.0, infrared=0.0)
    evening = Material(_PLAIN, (255, 226, 190), emission=14.0, infrared=0.0)
    big = Material(textures.geometric_poster())
    wide = Material(textures.landscape_poster())
    parts = [
        room((-1.75, -2.3, 0.0), (1.9, 1.8, 2.5), bricks, sage, wall, wall, floor, ceiling),
        # the window and the ceiling lamp are behind the camera and light what it sees
        box((1.89, -0.75, 0.85), (0.02, 1.3, 1.25), daylight, *[_WHITE] * 5),
        box((0.0, -0.3, 2.47), (0.5, 0.5, 0.02), *[_WHITE] * 4, evening, _WHITE),
        # skirting boards
        box((0.075, 1.79, 0.0), (3.65, 0.02, 0.09), _WHITE),
        box((-1.74, -0.25, 0.0), (0.02, 4.08, 0.09), _WHITE),
        box((1.89, -0.25, 0.0), (0.02, 4.08, 0.09), _WHITE),
    ]
    for x, z, width, height, front in (
        (-0.32, 1.2, 0.42, 0.84, big),
        (0.68, 1.36, 0.9, 0.45, wide),
    ):
        parts.append(box((x, 1.785, z - 0.02), (width + 0.05, 0.028, height + 0.04), _DARK_WOOD))
        parts.append(box((x, 1.78, z), (width, 0.03, height), *[_WHITE] * 2, front, *[_WHITE] * 3))
    return parts


def _bookcase() -> list[Primitive]:
    """A case in the corner by the brick wall, with rows of books of all sizes."""
    left, right, front, back, top = -1.7, -0.82, 1.5, 1.79, 1.86
    middle, depth, width = (left + right) / 2, back - front, right - left
    parts = [
        box((left + 0.015, (front + back) / 2, 0.0), (0.03, depth, top), _OAK),
        box((right - 0.015, (front + back) / 2, 0.0), (0.03, depth, top), _OAK),
        box((middle, back - 0.01, 0.05), (width - 0.06, 0.02, top - 0.06), _OAK),
    ]
    levels = (0.05, 0.42, 0.79, 1.14, 1.48, top - 0.03)
    parts += [
        box((middle, (front + back) / 2 - 0.005, z), (width - 0.06, depth - 0.03, 0.025), _OAK)
        for z in levels
    ]
    rng = np.random.default_rng(201)
    tints = (
        (150, 48, 40), (38, 74, 110), (206, 154, 66), (56, 98, 78),
        (222, 214, 196), (92, 58, 84), (62, 62, 70), (196, 112, 70),
    )  # fmt: skip
    for shelf, z in enumerate(levels[:-1]):
        x = left + 0.035
        stop = right - 0.05 - 0.01 * int(rng.integers(0, 26))
        while x < stop:
            thick = 0.022 + 0.002 * int(rng.integers(0, 14))
            tall = 0.19 + 0.01 * int(rng.integers(0, 9))
            deep = 0.15 + 0.01 * int(rng.integers(0, 7))
            if x + thick > right - 0.035:
                break
            tint = tints[int(rng.integers(0, len(tints)))]
            cover = Material(_PLAIN, tint)
            spine = Material(textures.spine(int(rng.integers(1, 30))), tint)
            place = (x + thick / 2, back - 0.03 - deep / 2, z + 0.026)
            faces = (cover, cover, spine, cover, cover, _PAGES)
            parts.append(box(place, (thick - 0.001, deep, tall), *faces))
            x += thick
        if shelf == 2:
            parts.append(
                sphere(
                    (right - 0.1, front + 0.12, z + 0.085), 0.06, Material(_PLAIN, (210, 196, 170))
                )
            )
    return parts


def _table() -> list[Primitive]:
    yaw, top = 6.0, 0.73
    c, s = 0.9945, 0.1045
    x, y = 0.12, 0.62
    parts = [box((x, y, top - 0.035), (1.25, 0.72, 0.035), _OAK, yaw=yaw)]
    for across in (-0.57, 0.57):
        for along in (-0.3, 0.3):
            foot = (x + c * across - s * along, y + s * across + c * along, 0.0)
            parts.append(box(foot, (0.055, 0.055, top - 0.036), _DARK_WOOD, yaw=yaw))
    return parts


def _table_top() -> list[Primitive]:
    top = 0.731
    packet = Material(textures.cereal())
    side = Material(_PLAIN, (204, 70, 44))
    covers = [Material(_PLAIN, tint) for tint in ((38, 74, 110), (196, 112, 70), (222, 214, 196))]
    spines = [
        Material(np.rot90(textures.spine(seed)).copy(), cover.tint)
        for seed, cover in zip((3, 8, 13), covers, strict=True)
    ]
    parts = []
    z = top
    sizes = ((0.25, 0.18, 0.04, 14.0), (0.22, 0.16, 0.032, -9.0), (0.19, 0.135, 0.026, 26.0))
    for cover, spine, (wide, deep, tall, yaw) in zip(covers, spines, sizes, strict=True):
        faces = (_PAGES, _PAGES, spine, _PAGES, cover, cover)
        parts.append(box((-0.24, 0.52, z), (wide, deep, tall), *faces, yaw=yaw))
        z += tall + 0.0005
    parts += [
        cylinder((-0.05, 0.86, top), 0.075, 0.018, _BRASS),
        cylinder((-0.05, 0.86, top), 0.012, 0.09, _BRASS),
        sphere((-0.05, 0.86, top + 0.205), 0.135, Material(textures.globe())),
        box((0.35, 0.86, top), (0.2, 0.07, 0.3), side, side, packet, packet, side, side, yaw=-14.0),
        cylinder((0.13, 0.5, top), 0.042, 0.1, Material(_PLAIN, (44, 112, 118))),
        box((0.6, 0.72, top), (0.17, 0.15, 0.2), _GLOSS, yaw=-24.0),
        sphere((0.38, 0.5, top + 0.04), 0.04, Material(_PLAIN, (206, 60, 44))),
        sphere((0.47, 0.53, top + 0.038), 0.038, Material(_PLAIN, (206, 176, 60))),
    ]
    blocks = ((-0.42, 0.78, 0.0, 20.0, (196, 62, 48)), (-0.35, 0.84, 0.0, -15.0, (44, 112, 118)))
    for x, y, z, yaw, tint in (*blocks, (-0.39, 0.81, 0.061, 40.0, (222, 166, 60))):
        paint = Material(_PLAIN, tint)
        parts.append(box((x, y, top + z), (0.06, 0.06, 0.06), paint, yaw=yaw))
    return parts


def _drawers() -> list[Primitive]:
    """A chest of drawers against the plain wall, a lamp and a plant on it."""
    blue = Material(_PLAIN, (70, 100, 116))
    front = Material(_PLAIN, (86, 118, 134))
    shade = Material(_PLAIN, (255, 222, 170), emission=1.0)
    leaves = Material(textures.leaves(), tile=0.25)
    clay = Material(_PLAIN, (186, 106, 74))
    parts = [
        box((1.38, 1.56, 0.06), (0.9, 0.42, 0.78), blue),
        box((1.38, 1.555, 0.84), (0.94, 0.46, 0.025), _OAK),
    ]
    for z in (0.1, 0.35, 0.6):
        parts.append(box((1.38, 1.345, z), (0.82, 0.02, 0.22), front))
        parts += [cylinder((1.38 + x, 1.33, z + 0.1), 0.012, 0.02, _BRASS) for x in (-0.22, 0.22)]
    top = 0.866
    parts += [
        cylinder((1.12, 1.58, top), 0.07, 0.02, _BRASS),
        cylinder((1.12, 1.58, top + 0.02), 0.011, 0.26, _BRASS),
        cylinder((1.12, 1.58, top + 0.24), 0.12, 0.19, shade, *[_WHITE] * 5),
        cylinder((1.58, 1.55, top), 0.085, 0.15, clay),
    ]
    for x, y, z, r in (
        (0.0, 0.0, 0.27, 0.11), (-0.1, -0.03, 0.33, 0.085), (0.09, -0.04, 0.36, 0.09),
        (0.0, 0.03, 0.45, 0.085), (-0.03, -0.07, 0.24, 0.07),
    ):  # fmt: skip
        parts.append(sphere((1.58 + x, 1.55 + y, top + z), r, leaves))
    return parts


def _on_the_floor() -> list[Primitive]:
    rug = Material(textures.rug())
    carton = Material(textures.cardboard())
    cushion = Material(textures.fabric(), (196, 112, 70), tile=0.18)
    parts = [
        box((0.1, 0.25, 0.0), (1.9, 1.5, 0.012), rug, yaw=-3.0),
        box((-1.12, 0.72, 0.0), (0.42, 0.34, 0.32), carton, yaw=24.0),
        box((-1.1, 0.74, 0.321), (0.28, 0.24, 0.2), carton, yaw=-12.0),
        sphere((-0.62, 0.18, 0.172), 0.16, Material(textures.ball())),
        cylinder((1.12, 0.28, 0.42), 0.19, 0.06, cushion),
        cylinder((1.12, 0.28, 0.4), 0.18, 0.02, _DARK_WOOD),
        cylinder((1.6, 0.75, 0.0), 0.13, 0.34, Material(textures.fabric(), (176, 168, 150), 0.3)),
    ]
    for x, y in ((-0.12, -0.12), (0.12, -0.12), (-0.12, 0.12), (0.12, 0.12)):
        parts.append(cylinder((1.12 + x, 0.28 + y, 0.0), 0.018, 0.4, _DARK_WOOD))
    return parts
