"""Ray-cast places where odometry has little to go by: made in a moment, with exact truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
from raycast_room import textures
from raycast_room.motion import hand_held
from raycast_room.raycaster import Tables
from raycast_room.render import render
from raycast_room.scene import Material, box, pack, room

from rgbd_glue_ros.geometry import se3
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64, RgbdFrame, UInt8
from rigs.stored_room import stored_living_room

VGA_HALVED = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)
PHONE_LIDAR = CameraIntrinsics(256, 192, 212.0, 212.0, 127.5, 95.5)
NARROW = replace(VGA_HALVED, fx=420.0, fy=420.0)
WIDE = replace(VGA_HALVED, fx=140.0, fy=140.0)

# depth ends here, as that of most sensors does, metres
_FARTHEST = 5.0
# The distance between the two cameras of a RealSense D435, and the noise of its disparity.
_STEREO_BASE_M, _STEREO_NOISE_PX = 0.05, 0.08
# of the stairwell, metres
_FIRST_STEP_Y, _STEP_Y, _STEP_Z = 1.0, 0.28, 0.17
# a camera that looks along the world's y, with z up
_LOOKS_ALONG_Y = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class Scene:
    """A camera's way through a place.

    Attributes:
        place: makes the place.
        pose: T_world_camera [4, 4] at a time in seconds.
        camera: its intrinsics.
        rate_hz: frames a second.
        frame_count: how many.
        has_color: whether the image shows anything.
    """

    place: Callable[[], Tables]
    pose: Callable[[float], Float64]
    camera: CameraIntrinsics
    rate_hz: float
    frame_count: int
    has_color: bool = True

    def true_poses(self) -> Float64:
        """Of the frames, relative to the first, float64 [N, 4, 4]."""
        poses = np.array([self.pose(i / self.rate_hz) for i in range(self.frame_count)])
        relative: Float64 = np.linalg.inv(poses[0]) @ poses
        return relative

    def frames(self) -> Iterator[RgbdFrame]:
        """What the camera sees."""
        for i in range(self.frame_count):
            time_s = i / self.rate_hz
            color, depth = _picture(self.place, self.pose, time_s, self.camera)
            if not self.has_color:
                color = np.zeros_like(color)
            yield RgbdFrame(round(time_s * 1e9), color, depth, self.camera)

    def noisy_frames(self, seed: int, *, is_stereo: bool = False) -> Iterator[RgbdFrame]:
        """The same with the noise of a sensor: that of each depth is its own."""
        random = np.random.default_rng(seed)
        for frame in self.frames():
            sigma = 0.0012 + 0.0019 * (frame.depth - 0.4) ** 2
            if is_stereo:
                sigma = frame.depth**2 / (frame.intrinsics.fx * _STEREO_BASE_M) * _STEREO_NOISE_PX
            depth = frame.depth + sigma * random.normal(size=frame.depth.shape)
            color = frame.color + 2.0 * random.normal(size=frame.color.shape)
            yield replace(
                frame,
                color=np.clip(color, 0, 255).astype(np.uint8),
                depth=depth.astype(np.float32),
            )


@cache
def _picture(
    place: Callable[[], Tables],
    pose: Callable[[float], Float64],
    time_s: float,
    camera: CameraIntrinsics,
) -> tuple[UInt8, Float32]:
    color, depth = render(place(), pose(time_s), camera)
    depth[depth > _FARTHEST] = np.nan
    return color, depth


@cache
def corridor() -> Tables:
    """20 m long and 2 m wide: bricks that repeat, doors that are all alike, 2 m apart."""
    bricks = Material(textures.bricks(), tile=1.1)
    wood = Material(textures.wood(), (150, 118, 96), 0.8)
    floor = Material(textures.planks(), tile=1.4)
    doors = [
        box((side * 0.99, y, 0.0), (0.03, 0.9, 2.0), wood)
        for side in (-1, 1)
        for y in np.arange(1.0, 20.0, 2.0)
    ]
    walls = room((-1.0, -1.0, 0.0), (1.0, 19.0, 2.4), *[bricks] * 4, floor, _white())
    return pack([walls, *doors])


@cache
def bare_corridor() -> Tables:
    """The same without bricks and doors: a few notices, and nothing else to go by."""
    places = [(-1, 1.5), (1, 3.0), (-1, 4.5), (1, 5.5), (-1, 7.0), (1, 8.0)]
    notices = [
        box((side * 0.995, y, 1.3), (0.01, 0.3, 0.4), Material(_blots(seed)))
        for seed, (side, y) in enumerate(places)
    ]
    return pack([*_bare_walls(), *notices])


@cache
def empty_corridor() -> Tables:
    """Not even notices: where along it a camera is, nothing says."""
    return pack(_bare_walls())


@cache
def plain_room() -> Tables:
    """White walls and a grey floor: of a wall or the floor alone, nothing says which part it is."""
    white, grey = _white(), Material(textures.plain(), (150, 150, 150))
    return pack([room((-9.0, -4.0, 0.0), (9.0, 1.5, 3.0), *[white] * 4, grey, white)])


def _bare_walls() -> list[Any]:
    white, grey = _white(), Material(textures.plain(), (150, 150, 150))
    return [room((-1.0, -1.0, 0.0), (1.0, 19.0, 2.4), *[white] * 4, grey, white)]


@cache
def stairwell() -> Tables:
    """Ten steps up between plastered walls: edges that are all alike, and gaps in depth."""
    plaster = Material(textures.plaster(), tile=1.5)
    wood = Material(textures.planks(), tile=1.4)
    steps = [
        box((0.0, _FIRST_STEP_Y + _STEP_Y * i, 0.0), (1.6, _STEP_Y, _STEP_Z * (i + 1)), wood)
        for i in range(10)
    ]
    return pack([room((-0.8, -2.0, 0.0), (0.8, 6.0, 4.5), *[plaster] * 4, wood, plaster), *steps])


@cache
def blank_wall() -> Tables:
    """A white room that shows one poster on a wall, and no edge of any other wall."""
    white, poster = _white(), Material(_blots(5))
    return pack(
        [
            room((-4.0, -4.0, -3.0), (4.0, 2.0, 5.0), white),
            box((0.0, 1.99, 0.95), (0.9, 0.01, 0.6), white, white, poster, white, white, white),
        ]
    )


@cache
def _white() -> Material:
    return Material(textures.plain(), (238, 236, 230))


def _blots(seed: int) -> UInt8:
    """A poster of blots, none like another."""
    blots = textures.fractal(256, 16, 3, seed)
    return textures.blend((20, 30, 60), (250, 240, 220), (blots > np.median(blots)).astype(float))


def walk(metres_a_second: float) -> Callable[[float], Float64]:
    """Straight ahead, with a little sway."""

    def pose(time_s: float) -> Float64:
        way, sway = metres_a_second * time_s, np.sin(4.0 * time_s)
        T = se3.from_rotation_translation(
            _LOOKS_ALONG_Y, np.array([0.03 * sway, way, 1.4 + 0.02 * sway])
        )
        return T @ se3.exp(np.array([0.0, 0.0, 0.0, 0.01 * sway, 0.02 * sway, 0.0]))

    return pose


def upstairs(time_s: float) -> Float64:
    """Up the stairwell at a step and a half a second, looking down a little."""
    way, pitch = 0.42 * time_s, -0.25 + 0.02 * np.sin(6.0 * time_s)
    T = se3.from_rotation_translation(
        _LOOKS_ALONG_Y, np.array([0.0, way, 1.5 + way * _STEP_Z / _STEP_Y])
    )
    return T @ se3.exp(np.array([0.0, 0.0, 0.0, pitch, 0.0, 0.0]))


def before_the_poster(time_s: float) -> Float64:
    """From side to side and up and down, 1.2 m from the wall."""
    x, z = 0.15 * np.sin(2.0 * time_s), 1.25 + 0.08 * np.sin(3.0 * time_s)
    return se3.from_rotation_translation(_LOOKS_ALONG_Y, np.array([x, 0.8, z]))


def looking(x: float, y: float, z: float, turned_up: float = 0.0) -> Float64:
    """A camera at x, y, z that looks along the world's y, turned up by an angle."""
    T = se3.from_rotation_translation(_LOOKS_ALONG_Y, np.array([x, y, z]))
    return T @ se3.exp(np.array([0.0, 0.0, 0.0, turned_up, 0.0, 0.0]))


def at_a_wall(time_s: float) -> Float64:
    """Still, a metre from a wall."""
    del time_s
    return looking(0.0, 0.5, 1.5)


def turning_at_a_wall(time_s: float) -> Float64:
    """To the right and back to the left, by up to 17 degrees."""
    turn = 0.3 * np.sin(1.5 * time_s)
    return at_a_wall(time_s) @ se3.exp(np.array([0.0, 0.0, 0.0, 0.0, turn, 0.0]))


def above_the_floor(time_s: float) -> Float64:
    """A quarter of a metre above the floor, looking down, at half a metre a second."""
    return looking(0.5 * time_s, 0.0, 0.25, turned_up=-np.pi / 2)


def along_the_edge(time_s: float) -> Float64:
    """Along the edge of a wall and the floor, at half a metre a second."""
    return looking(0.5 * time_s, 0.0, 0.6, turned_up=-0.2)


def carried_by_hand(time_s: float) -> Float64:
    """The motion of the bundled recording."""
    return hand_held(time_s).matrix


SCENES = {
    "a corridor walked along": Scene(corridor, walk(1.5), VGA_HALVED, 30.0, 24),
    "a corridor at 10 Hz": Scene(corridor, walk(1.0), VGA_HALVED, 10.0, 18),
    "a bare corridor at 10 Hz": Scene(bare_corridor, walk(1.0), VGA_HALVED, 10.0, 18),
    "a bare corridor at 30 Hz": Scene(bare_corridor, walk(1.0), VGA_HALVED, 30.0, 40),
    "an empty corridor at 10 Hz": Scene(empty_corridor, walk(1.0), VGA_HALVED, 10.0, 12),
    "an empty corridor at 30 Hz": Scene(empty_corridor, walk(1.0), VGA_HALVED, 30.0, 24),
    "stairs": Scene(stairwell, upstairs, VGA_HALVED, 15.0, 18),
    "a blank wall with one poster": Scene(blank_wall, before_the_poster, VGA_HALVED, 15.0, 15),
    "a bare wall": Scene(plain_room, at_a_wall, VGA_HALVED, 30.0, 30),
    "a bare wall, turning": Scene(plain_room, turning_at_a_wall, VGA_HALVED, 30.0, 30),
    "a bare floor": Scene(plain_room, above_the_floor, VGA_HALVED, 30.0, 30),
    "the edge of a bare wall": Scene(plain_room, along_the_edge, VGA_HALVED, 30.0, 30),
    "the depth of a phone": Scene(stored_living_room, carried_by_hand, PHONE_LIDAR, 30.0, 24),
    "the depth of a phone alone": Scene(
        stored_living_room, carried_by_hand, PHONE_LIDAR, 30.0, 24, has_color=False
    ),
    "five frames a second": Scene(stored_living_room, carried_by_hand, VGA_HALVED, 5.0, 10),
    "a narrow field of view": Scene(stored_living_room, carried_by_hand, NARROW, 10.0, 12),
    "a wide field of view": Scene(stored_living_room, carried_by_hand, WIDE, 10.0, 12),
}
