"""Pictures of the ray-cast room, without noise or blur, a quarter as large as the bundled ones."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from raycast_room.living_room import living_room
from raycast_room.motion import hand_held
from raycast_room.raycaster import Tables
from raycast_room.render import measure, render

from rgbd_glue_ros import camera
from rgbd_glue_ros.types import CameraIntrinsics, Float32, Float64, RgbdFrame, UInt8, View

CAMERA = CameraIntrinsics(320, 240, 262.5, 262.5, 159.5, 119.5)


@lru_cache(maxsize=1)
def _scene() -> Tables:
    return living_room()


def true_pose(time_s: float) -> Float64:
    """T_world_camera at a time of the hand-held motion, which comes back after 3.5 s."""
    return hand_held(time_s).matrix


def true_depth(T_world_camera: Float64) -> Float32:
    """Exact depth from any pose."""
    return measure(_scene(), T_world_camera, 0.0, CAMERA)[0].astype(np.float32)


@lru_cache(maxsize=64)
def _picture(time_s: float) -> tuple[UInt8, Float32]:
    return render(_scene(), true_pose(time_s), CAMERA)


def room_frame(time_s: float) -> RgbdFrame:
    """What the camera sees at a time; each is rendered once."""
    color, depth = _picture(time_s)
    return RgbdFrame(round(time_s * 1e9), color.copy(), depth.copy(), CAMERA)


def room_view(time_s: float) -> View:
    """The same, prepared for registration."""
    frame = room_frame(time_s)
    return View(camera.grey(frame.color), frame.depth, CAMERA)
