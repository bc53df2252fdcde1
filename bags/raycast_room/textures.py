"""Procedural textures: sRGB images uint8 [H, W, 3] with sides that are powers of two.

Only whole-number randomness and arithmetic that IEEE 754 rounds exactly (+ - * / sqrt floor) is
used, because sines and powers differ in the last bit between processors, and the images must not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raycast_room.maps import octahedral_direction
from rgbd_glue_ros.types import Float64, UInt8

Color = tuple[int, int, int]

PAPER: Color = (236, 228, 208)
INK: Color = (38, 42, 52)
RED: Color = (196, 62, 48)
MUSTARD: Color = (222, 166, 60)
TEAL: Color = (44, 112, 118)
NAVY: Color = (34, 58, 94)


def noise(height: int, width: int, cells_y: int, cells_x: int, seed: int) -> Float64:
    """Smooth noise in [0, 1], [height, width], that tiles; one random value per cell corner."""
    values = np.random.default_rng(seed).integers(0, 256, (cells_y, cells_x)) / 255.0
    y, x = np.arange(height) * (cells_y / height), np.arange(width) * (cells_x / width)
    row, column = np.floor(y).astype(int), np.floor(x).astype(int)
    fy, fx = (y - row)[:, None], (x - column)[None, :]
    fy, fx = fy * fy * (3.0 - 2.0 * fy), fx * fx * (3.0 - 2.0 * fx)
    below, right = (row + 1) % cells_y, (column + 1) % cells_x
    top = values[row][:, column] * (1.0 - fx) + values[row][:, right] * fx
    bottom = values[below][:, column] * (1.0 - fx) + values[below][:, right] * fx
    mixed: Float64 = top * (1.0 - fy) + bottom * fy
    return mixed


def fractal(size: int, cells: int, octaves: int, seed: int) -> Float64:
    """Noise of several octaves in [0, 1], [size, size], each twice as fine and half as strong."""
    total, weight, norm = np.zeros((size, size)), 1.0, 0.0
    for octave in range(octaves):
        total += weight * noise(size, size, cells << octave, cells << octave, seed + octave)
        norm += weight
        weight *= 0.5
    return total / norm


def blend(low: Color, high: Color, amount: Float64) -> UInt8:
    """Colours between ``low`` (amount 0) and ``high`` (amount 1), from an amount [H, W]."""
    share = np.clip(amount, 0.0, 1.0)[..., None]
    mixed = np.array(low) * (1.0 - share) + np.array(high) * share
    return np.floor(mixed + 0.5).astype(np.uint8)


def shade(image: UInt8, factor: Float64) -> UInt8:
    """The image [H, W, 3] with its brightness multiplied by a factor [H, W]."""
    return np.floor(np.clip(image * factor[..., None], 0.0, 255.0) + 0.5).astype(np.uint8)


def plain() -> UInt8:
    """One white texel: the colour comes from the material's tint alone."""
    return np.full((1, 1, 3), 255, np.uint8)


def planks() -> UInt8:
    """A floor of oak boards with staggered joints."""
    size, boards = 512, 8
    rng = np.random.default_rng(11)
    grain = noise(size, size, 128, 4, 12) * 0.6 + noise(size, size, 32, 2, 13) * 0.4
    image = blend((128, 84, 50), (196, 146, 98), grain)
    factor = np.ones((size, size))
    high = size // boards
    for board in range(boards):
        rows = slice(board * high, (board + 1) * high)
        joint = int(rng.integers(0, size))
        tone = rng.integers(-16, 17, 2) / 100.0
        image[rows] = np.roll(image[rows], int(rng.integers(0, size)), axis=1)
        columns = (np.arange(size) - joint) % size
        factor[rows] += np.where(columns < size // 2, tone[0], tone[1])
        factor[rows, (columns < 2) | (columns // 2 == size // 4)] = 0.45
        factor[board * high : board * high + 2] = 0.45
    return shade(image, factor)


def wood() -> UInt8:
    """A table top: long grain, no joints."""
    grain = noise(512, 512, 64, 3, 21) * 0.5 + noise(512, 512, 160, 6, 22) * 0.3
    return blend((120, 72, 40), (204, 146, 92), grain + 0.2 * noise(512, 512, 12, 2, 23))


def bricks() -> UInt8:
    """A brick wall under thin whitewash."""
    size, courses, per_course = 512, 16, 4
    rng = np.random.default_rng(31)
    rough = fractal(size, 16, 4, 32)
    image = blend((150, 94, 76), (214, 168, 146), rough)
    tall, wide = size // courses, size // per_course
    mortar = np.zeros((size, size), bool)
    for course in range(courses):
        for brick in range(per_course):
            start = brick * wide + (wide // 2 if course % 2 else 0)
            columns = (np.arange(wide) + start) % size
            rows = slice(course * tall, (course + 1) * tall)
            tone = 0.84 + 0.01 * int(rng.integers(0, 33))
            image[rows, columns] = shade(image[rows, columns], np.full((tall, wide), tone))
            mortar[rows, columns[:4]] = True
        mortar[course * tall : course * tall + 4] = True
    image[mortar] = blend((176, 168, 158), (214, 208, 198), rough)[mortar]
    wash = np.clip((fractal(size, 4, 4, 36) - 0.45) * 3.0, 0.0, 0.7)[..., None]
    washed = image * (1.0 - wash) + np.array((226, 220, 210)) * wash
    return np.floor(washed + 0.5).astype(np.uint8)


def plaster() -> UInt8:
    """A painted wall: nearly plain, so that only geometry tells where one is."""
    return blend((247, 247, 247), (255, 255, 255), fractal(256, 8, 4, 41))


def rug() -> UInt8:
    """A woven rug: nested borders around a field of diamonds."""
    high, wide = 512, 512
    y, x = np.mgrid[0:high, 0:wide]
    edge = np.minimum(np.minimum(y, high - 1 - y), np.minimum(x, wide - 1 - x))
    image = np.empty((high, wide, 3), np.uint8)
    image[:] = NAVY
    cell = 64
    distance = np.abs((x % cell) - cell // 2) + np.abs((y % cell) - cell // 2)
    odd = ((x // cell) + (y // cell)) % 2
    image[distance < 26] = RED
    image[(distance < 26) & (odd == 1)] = TEAL
    image[distance < 15] = PAPER
    image[distance < 7] = MUSTARD
    for inner, color in ((72, PAPER), (66, RED), (44, MUSTARD), (38, NAVY), (14, PAPER), (8, RED)):
        image[edge < inner] = color
    zigzag = (edge >= 16) & (edge < 36)
    image[zigzag & (np.abs((x + y) % 32 - 16) < 6)] = PAPER
    return shade(image, 0.85 + 0.2 * noise(high, wide, 128, 128, 51))


def geometric_poster() -> UInt8:
    """Quarter circles and triangles on a grid, in the manner of the 1920s."""
    columns, rows, cell = 4, 8, 64
    high, wide = rows * cell, columns * cell
    rng = np.random.default_rng(61)
    palette = (PAPER, INK, RED, MUSTARD, TEAL, NAVY)
    image = np.empty((high, wide, 3), np.uint8)
    y, x = np.mgrid[0:cell, 0:cell]
    for row in range(rows):
        for column in range(columns):
            ground, figure = rng.permutation(len(palette))[:2]
            tile = np.empty((cell, cell, 3), np.uint8)
            tile[:] = palette[ground]
            shape, turns = int(rng.integers(0, 4)), int(rng.integers(0, 4))
            if shape == 0:
                tile[x * x + y * y < cell * cell] = palette[figure]
            elif shape == 1:
                tile[x + y < cell] = palette[figure]
            elif shape == 2:
                tile[(x - 32) ** 2 + (y - 32) ** 2 < 24 * 24] = palette[figure]
            else:
                tile[(x // 8) % 2 == 0] = palette[figure]
            place = slice(row * cell, (row + 1) * cell), slice(column * cell, (column + 1) * cell)
            image[place] = np.rot90(tile, turns)
    image[:16], image[-16:], image[:, :12], image[:, -12:] = PAPER, PAPER, PAPER, PAPER
    return image


def landscape_poster() -> UInt8:
    """Ridges in mist under a low sun."""
    high, wide = 256, 512
    y, x = np.mgrid[0:high, 0:wide]
    image = blend((244, 196, 132), (250, 236, 208), 1.0 - y / high)
    image[(x - 350) ** 2 + (y - 84) ** 2 < 34 * 34] = (236, 112, 72)
    ridges = 5
    for ridge in range(ridges):
        line = 70 + 34 * ridge
        crest = line + 90.0 * (noise(1, wide, 1, 5 + 2 * ridge, 70 + ridge)[0] - 0.5)
        crest += 16.0 * (noise(1, wide, 1, 40, 80 + ridge)[0] - 0.5)
        tone = blend((150, 176, 184), (22, 50, 66), np.full((1, 1), ridge / (ridges - 1)))[0, 0]
        image[y > crest[None, :]] = tone
    image[:10], image[-10:], image[:, :10], image[:, -10:] = PAPER, PAPER, PAPER, PAPER
    return image


def cardboard() -> UInt8:
    """A moving box with tape, a label and stacking arrows."""
    size = 256
    image = blend((158, 116, 74), (190, 148, 102), noise(size, size, 128, 8, 91))
    image[:, 112:144] = blend((176, 146, 98), (206, 178, 128), noise(size, 32, 32, 4, 92))
    image[150:220, 24:100] = PAPER
    for line, length in enumerate((58, 44, 62, 30)):
        image[160 + 14 * line : 165 + 14 * line, 32 : 32 + length] = INK
    for left in (168, 208):
        for row in range(20):
            image[170 + row, left + 12 - row // 2 : left + 13 + row // 2] = INK
        image[190:216, left + 8 : left + 17] = INK
    return image


def cereal() -> UInt8:
    """The front of a packet: a name, a bowl, small print."""
    high, wide = 512, 256
    y, x = np.mgrid[0:high, 0:wide]
    image = blend((232, 150, 40), (206, 66, 40), y / high)
    rays = ((x - 128) * 3 // (np.abs(y - 330) + 24)) % 2 == 0
    image[rays & (y < 330)] = (240, 176, 64)
    image[((x - 128) ** 2 < 96 * 96) & (y > 330) & ((x - 128) ** 2 + (y - 330) ** 2 < 9216)] = NAVY
    image[((x - 128) ** 2 + 9 * (y - 326) ** 2) < 96 * 96] = PAPER
    rng = np.random.default_rng(95)
    for _ in range(70):
        cx, cy = int(rng.integers(56, 200)), int(rng.integers(304, 344))
        if (cx - 128) ** 2 + 9 * (cy - 326) ** 2 < 80 * 80:
            image[(x - cx) ** 2 + (y - cy) ** 2 < 49] = (206, 142, 58)
            image[(x - cx) ** 2 + (y - cy) ** 2 < 6] = PAPER
    image[48:148, 14:242] = PAPER
    image[60:136, 26:230][_lettering("OATS", 8, 76, 204)] = NAVY
    for line in range(5):
        image[440 + 12 * line : 445 + 12 * line, 24 : 24 + int(rng.integers(90, 200))] = PAPER
    return image


# rows of five dots, most significant bit on the left
_GLYPHS = {
    "O": (14, 17, 17, 17, 17, 17, 14),
    "A": (14, 17, 17, 31, 17, 17, 17),
    "T": (31, 4, 4, 4, 4, 4, 4),
    "S": (15, 16, 16, 14, 1, 1, 30),
}


def _lettering(text: str, dot: int, height: int, width: int) -> NDArray[np.bool_]:
    """A mask [height, width] of ``text`` in letters of 5 x 7 dots, from the upper left."""
    mask = np.zeros((height, width), bool)
    for place, letter in enumerate(text):
        bits = [[(row >> (4 - column)) & 1 for column in range(5)] for row in _GLYPHS[letter]]
        glyph = np.kron(np.array(bits, bool), np.ones((dot + 2, dot), bool))
        left = place * 6 * dot + 8
        part = mask[4 : 4 + glyph.shape[0], left : left + glyph.shape[1]]
        part |= glyph[: part.shape[0], : part.shape[1]]
    return mask


def spine(seed: int) -> UInt8:
    """The back of a book, white but for bands and a title: the tint gives its colour."""
    high, wide = 128, 32
    rng = np.random.default_rng(seed)
    image = np.full((high, wide, 3), 225, np.uint8)
    for top in (8, 14, 108):
        image[top : top + int(rng.integers(2, 5))] = 90 if seed % 2 else 255
    row = int(rng.integers(24, 34))
    while row < 90:
        image[row : row + 3, 8 : 8 + int(rng.integers(8, 17))] = 255 if seed % 3 else 70
        row += int(rng.integers(5, 9))
    return image


def pages() -> UInt8:
    """The cut edge of a book."""
    return blend((200, 190, 168), (244, 238, 222), noise(128, 128, 64, 2, 98))


def fabric() -> UInt8:
    """A coarse weave."""
    y, x = np.mgrid[0:128, 0:128]
    over = ((x // 4 + y // 4) % 2) * 0.35 + 0.3
    return blend((150, 150, 150), (255, 255, 255), over + 0.4 * noise(128, 128, 64, 64, 99))


def _directions(size: int) -> Float64:
    """Unit vectors [size, size, 3] of the texels of an octahedral map of the sphere."""
    v, u = (np.mgrid[0:size, 0:size] + 0.5) / size
    return np.stack(octahedral_direction(u, v), axis=-1)


def globe() -> UInt8:
    """An octahedral map of a planet: seas, land, ice at the poles, a graticule."""
    size, cells = 256, 6
    directions = _directions(size)
    height = np.zeros((size, size))
    for octave, weight in enumerate((0.5, 0.25, 0.15, 0.1)):
        height += weight * _solid_noise(directions * (1.0 + octave), cells, 110 + octave)
    image = blend((40, 84, 132), (84, 140, 176), height * 1.6)
    land = height > 0.52
    image[land] = blend((112, 140, 74), (206, 178, 112), (height - 0.52) * 6.0)[land]
    image[np.abs(directions[..., 2]) > 0.88] = (238, 240, 240)
    for level in (-0.7071, -0.3827, 0.0, 0.3827, 0.7071):
        image[np.abs(directions[..., 2] - level) < 0.012] = (214, 204, 180)
    return image


def _solid_noise(points: Float64, cells: int, seed: int) -> Float64:
    """Smooth noise in [0, 1] at points [..., 3]; it repeats every ``cells`` units."""
    values = np.random.default_rng(seed).integers(0, 256, (cells, cells, cells)) / 255.0
    scaled = points * 1.5 + cells
    corner = np.floor(scaled).astype(int)
    f = scaled - corner
    f = f * f * (3.0 - 2.0 * f)
    total = np.zeros(points.shape[:-1])
    for index in range(8):
        step = np.array([index & 1, (index >> 1) & 1, index >> 2])
        i, j, k = np.moveaxis((corner + step) % cells, -1, 0)
        share = np.where(step == 1, f, 1.0 - f)
        total += values[i, j, k] * share[..., 0] * share[..., 1] * share[..., 2]
    return total


def ball() -> UInt8:
    """An octahedral map of a beach ball: eight coloured segments and white caps."""
    directions = _directions(128)
    x, y, z = np.moveaxis(directions, -1, 0)
    octant = (x > 0).astype(int) * 4 + (y > 0).astype(int) * 2 + (np.abs(x) > np.abs(y))
    palette = np.array([RED, PAPER, PAPER, MUSTARD, PAPER, TEAL, NAVY, PAPER], np.uint8)
    image: UInt8 = palette[octant]
    image[np.abs(z) > 0.93] = (245, 245, 240)
    return image


def leaves() -> UInt8:
    """Foliage: light and dark patches of green."""
    return blend((22, 46, 24), (128, 164, 78), (fractal(128, 16, 3, 120) - 0.25) * 2.0)
